"""Maps of the mass on a belt (characteristic A, set PEND): regions and boundaries."""

import json
from pathlib import Path

import numpy as np
import pytest

import rig
from rig.analysis import map as maps
from rig.analysis.map.job import RUNS
from rig.analysis.map.result import REGIONS
from rig.analysis.map.steady_state import NAMES, SLIDING, STICK_SLIP, STUCK, VIBRATION
from rig.errors import UsageError

KROGER = json.loads((Path(__file__).parents[1] / "reference" / "kroger.json").read_text())
SPEEDS = "drive.speed=0.05:0.8:16"
FEW = "drive.speed=0.05:0.45:3"


@pytest.fixture(scope="module")
def belt(tmp_path_factory):
    return rig.map("belt", SPEEDS, out=tmp_path_factory.mktemp("maps"))


def test_regions_over_the_speed_are_those_of_the_reference(belt):
    """Sliding is stable above one speed, stick-slip lives up to another: both between them."""
    stable, lives = KROGER["A_linear_stability_v0"], KROGER["A_stick_slip_exists_up_to_v0"]
    expected = ["III" if x < stable else "II" if x < lives else "I" for x in belt.job.x.values]
    assert [REGIONS[r] for r in belt.regions[0]] == expected
    assert not belt.disagreement.any()
    assert belt.onsets[0] == pytest.approx([stable], abs=5e-6)


def test_the_run_up_loses_the_cycle_at_the_end_of_the_branch(belt):
    """The branch is followed to its grazing fold, which rig.branches gives too."""
    end, down = belt.ends[:, 0]
    assert end == pytest.approx([0.675032752, 0.675032752], abs=1e-8)
    assert end.mean() == pytest.approx(KROGER["A_stick_slip_exists_up_to_v0"], abs=5e-6)
    assert belt.text().split()[-3:] == ["0.207944154", "0.675032752", "-"]
    assert np.isnan(down).all()


def test_amplitude_and_stick_share_are_those_of_the_limit_cycle(belt):
    at = belt.job.x.values.index(pytest.approx(0.1))
    cycle = rig.limit_cycle(rig.load("belt", {"drive.speed": belt.job.x.values[at]}))
    section = belt.tables["section"][RUNS.index("up"), 0, at]
    [highest] = section[~np.isnan(section)]
    assert highest == pytest.approx(cycle.extremes["displacement"][1], rel=1e-3)
    for number in range(len(RUNS)):
        assert belt.amplitude[number, 0, at] == pytest.approx(cycle.amplitude["displacement"], rel=1e-5)
        assert belt.tables["share"][number, 0, at] == pytest.approx(cycle.stick_share["contact"], rel=1e-5)
        assert belt.tables["period"][number, 0, at] == pytest.approx(cycle.period, rel=1e-6)


def test_a_run_that_is_carried_slowly_keeps_the_stick_slip_of_an_undamped_belt(tmp_path):
    """Slip is an arc about rest under kinetic friction. It begins at the belt's speed, away from rest by the drop of
    friction over the stiffness.
    """
    found = rig.map("belt_c", "drive.speed=0.02:0.2:7", out=tmp_path, runs=("up", "down"))
    p = rig.load("belt_c").parameters
    drop = (p.friction.mu_static - p.friction.mu_kinetic) * p.load.force / p.body.stiffness
    arcs = np.hypot(drop, np.array(found.job.x.values) * np.sqrt(p.body.mass / p.body.stiffness))
    for run in ("up", "down"):
        assert (found.state[RUNS.index(run), 0] == STICK_SLIP).all()
        assert found.amplitude[RUNS.index(run), 0] == pytest.approx(arcs, rel=1e-7)


def test_a_parameter_that_cannot_be_ramped_is_an_axis_too(tmp_path):
    """Less static friction, less stick-slip: over mu_static the cycle ends on the way down."""
    found = rig.map("belt", "friction.mu_static=0.19:0.5:4", out=tmp_path, runs=("up", "down"))
    assert found.state[RUNS.index("down"), 0, -1] == STICK_SLIP
    assert found.state[RUNS.index("up"), 0, 0] == SLIDING
    cycle = rig.limit_cycle(rig.load("belt"))
    assert found.amplitude[RUNS.index("up"), 0, -1] == pytest.approx(cycle.amplitude["displacement"], rel=1e-5)


def test_a_pin_leaves_sliding_beyond_its_limit_of_friction(tmp_path):
    """Tilted pin: damping is used up at 0.727389; at 0.96 the vibration grows with 63 1/s until it sticks."""
    found = rig.map("pin", "friction.mu=0.6:0.96:3", out=tmp_path, runs=("near",), workers=1)
    near = found.state[RUNS.index("near"), 0].tolist()
    assert near[0] == SLIDING
    assert near[2] in (STICK_SLIP, VIBRATION)
    assert found.onsets[0] == pytest.approx([0.727389], abs=6e-7)


def test_points_at_which_a_pin_jams_are_told_and_the_map_goes_on(tmp_path):
    """From 0.988 on it jams; the lowest value of the other axis is one at which it does not begin to move at all."""
    found = rig.map("pin", "friction.mu=0.7:1.1:3", out=tmp_path)
    jammed = found.job.x.values.index(1.1)
    assert [NAMES[state] for state in found.state[:, 0, jammed]] == ["stopped"] * 4
    assert all("jams: friction takes up all of the inertia" in why for why in found.why[:, 0, jammed])
    assert REGIONS[found.regions[0, 0]] == "I"
    assert "a run had to stop at 1 of 3 points; first at friction.mu = 1.1: " in found.text()
    [point] = [one for one in found.to_json()["points"] if one["up_state"] == "stopped"]
    assert "jam" in point["up_why"]


def test_a_boundary_next_to_a_point_without_sliding_is_found(tmp_path):
    """slope(v0) F0 = d at 1.0375 N; at 0 N nothing presses."""
    found = rig.map(
        "belt", "load.force=0:40:5", "drive.speed=0.03:0.06:2", runs=("near",), longest=1.0, out=tmp_path, workers=1
    )
    loads = [2.0 / (6.4 * np.exp(-speed / 0.05)) for speed in (0.03, 0.06)]
    assert [row.tolist() for row in found.onsets] == [[pytest.approx(load, rel=1e-8)] for load in loads]
    lines = found.text().splitlines()[-2:]
    assert [line.split() for line in lines] == [
        [f"{speed:g}", f"{load:.9g}", "-", "-"] for speed, load in zip((0.03, 0.06), loads)
    ]


def test_a_drive_that_stands_still_is_stuck(tmp_path):
    found = rig.map("belt", "drive.speed=0:0.1:3", out=tmp_path, runs=("up", "down"))
    assert [REGIONS[r] for r in found.regions[0]] == ["stuck", "III", "III"]
    assert found.state[0, 0, 0] == STUCK
    assert np.isnan(found.growth[0, 0])


def test_what_is_wrong_is_told():
    with pytest.raises(UsageError, match=r"did you mean displacement(.|\n)*sideways is unknown(.|\n)*greater than 0 s"):
        maps.job(rig.load("belt"), FEW, output="displacment", runs=("up", "sideways"), longest=-1.0)
    with pytest.raises(UsageError, match="-p dither=none"):
        maps.job(rig.load("belt_dither", {"dither.enable": True}), FEW)


def test_a_scene_with_a_shunt_is_mapped_over_a_command(tmp_path):
    """Its system has a check with parameters of its own, which is compared between two values of the command."""
    found = rig.map("belt_shunt", "drive.speed=0.05:0.3:3", out=tmp_path, runs=("near", "up"), workers=1)
    assert (found.regions > 0).all()
