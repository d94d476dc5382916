"""Studies: the points, the measures, what is wrong with a study, its results and its figures."""

import json
import math
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy import stats

import rig as lab
from rig.analysis.studies import prepared
from rig.analysis.studies.factors import Distribution
from rig.analysis.studies.result import gathered
from rig.analysis.studies.runs import StudyRuns, random_parts
from rig.errors import SceneError, UsageError

OVER = {"load.force": [10.0, 20.0], "drive.speed": "0.05 m/s:0.1 m/s:2"}
WANTED = ["cycle.amplitude", "cycle.period", "motion.period", "modes.growth", "run.rms.velocity"]


def fastest(run):
    return run.signals["velocity"].max(), "m/s"


def broken(run):
    return 1.0 / (run.time[0] * 0)


@pytest.fixture(scope="module")
def belt():
    return lab.load("belt")


@pytest.fixture(scope="module")
def grid(belt, tmp_path_factory):
    """Four points, in two processes."""
    folder = tmp_path_factory.mktemp("studies")
    return lab.study(belt, OVER, [*WANTED, fastest], duration=0.7, folder=folder, workers=2)


def test_each_value_is_what_the_other_commands_find(belt, grid):
    for k in range(4):
        at = grid.work.plan.values(k)
        scene = lab.load("belt", at)
        cycle = lab.limit_cycle(scene)
        run = lab.simulate(scene, 0.7)
        expected = [
            cycle.amplitude["displacement"],
            cycle.period,
            run.signals["velocity"].std(),
            run.signals["velocity"].max(),
        ]
        assert grid.values[k, [0, 1, 4, 5]].tolist() == expected
        assert grid.values[k, 3] == pytest.approx(lab.modes(scene).sliding.growth, rel=1e-9)
    assert grid.values[:, 2] == pytest.approx(grid.values[:, 1], rel=1e-8)
    assert grid.units == ("m", "s", "s", "1/s", "m/s", "m/s")
    assert set(grid.reasons) == {""}


def test_the_points_are_those_of_the_grid_each_with_a_seed(belt, grid):
    assert grid.points.tolist() == [[10.0, 0.05], [10.0, 0.1], [20.0, 0.05], [20.0, 0.1]]
    assert [record["seed"] for record in grid.records()] == [belt.seed + k for k in range(4)]
    assert grid.values_of("cycle.period").shape == (2, 2)


def test_one_process_finds_the_same_bits_and_a_finished_study_is_not_computed_again(belt, grid, tmp_path, monkeypatch):
    alone = lab.study(belt, OVER, [*WANTED, fastest], duration=0.7, folder=tmp_path, workers=1)
    assert np.array_equal(alone.values, grid.values)
    monkeypatch.setattr(StudyRuns, "compute", None)
    again = lab.study(belt, OVER, [*WANTED, fastest], duration=0.7, folder=tmp_path, workers=1)
    assert np.array_equal(again.values, grid.values)


def test_the_dataset_has_units_coordinates_and_provenance(grid, tmp_path):
    xarray = pytest.importorskip("xarray")
    found = grid.to_xarray()
    assert found["cycle.amplitude"].dims == ("load.force", "drive.speed")
    assert found["cycle.amplitude"].attrs["units"] == "m"
    assert found["load.force"].attrs == {"units": "N", "long_name": "load"}
    assert float(found["cycle.period"].sel({"load.force": 20.0, "drive.speed": 0.05})) == grid.values[2, 1]
    assert {"provenance_commit", "provenance_processor", "study_seed"} <= found.attrs.keys()
    assert json.loads(found.attrs["scene_json"])["name"] == "belt"
    grid.save(tmp_path / "found.nc")
    with xarray.open_dataset(tmp_path / "found.nc", engine="h5netcdf") as back:
        assert back.coords
        assert not [name for name, one in back.coords.items() if "_FillValue" in one.encoding]
        assert np.array_equal(back["cycle.period"].values, found["cycle.period"].values)
        assert json.loads(str(back["scene_json"].values))["name"] == "belt"


def test_the_report_lists_points_and_the_range_of_each_measure(grid, tmp_path):
    text = grid.text()
    assert "4 points (2 x 2) over load.force 2 values, drive.speed 2 values" in text
    assert f"{grid.values[:, 0].max():.5g}" in text
    head, *lines = grid.csv().splitlines()
    assert head.startswith("load.force [N],drive.speed [m/s],seed,cycle.amplitude [")
    assert len(lines) == 4
    assert json.dumps(grid.to_json())
    assert [path.name for path in grid.draw(tmp_path)] == ["heat_map.png"]


def test_a_point_without_a_value_is_a_row_with_its_reason(belt, tmp_path):
    """At 1 m/s nothing sticks any more; a function that fails tells its line."""
    found = lab.study(
        belt, {"drive.speed": [0.1, 1.0]}, ["cycle.period", broken], duration=0.1, folder=tmp_path, workers=1
    )
    assert np.isfinite(found.values[:, 0]).tolist() == [True, False]
    assert np.isnan(found.values[:, 1]).all()
    assert "broken is inf" in found.reasons[0] or "broken: " in found.reasons[0]
    assert found.reasons[1].startswith("slides steadily") or "sliding" in found.reasons[1]
    assert "1 of 2 points" in found.text() or "2 of 2 points" in found.text()


def test_a_motion_that_settles_in_a_cycle_has_the_measures_of_the_cycle(tmp_path):
    """The lever halves its distance from the cycle in a period: 30 s of simulation leave 1e-7 of it."""
    kinds = ("period", "frequency", "amplitude.arm_displacement", "stick_share")
    wanted = [f"{source}.{kind}" for kind in kinds for source in ("motion", "cycle")]
    wanted += ["motion.energy_per_cycle", "cycle.energy", "motion.growth_rate"]
    [values] = lab.study(lab.load("lever"), {"load.force": [20.0]}, wanted, folder=tmp_path, workers=1).values
    assert values[:10:2] == pytest.approx(values[1:10:2], rel=1e-9)
    assert values[10] == 0.0


def test_a_motion_that_settles_in_no_cycle_says_why(tmp_path):
    scene = lab.load("lever", {"drive.speed": "8 rpm"})
    study = lab.study(scene, {"load.force": [20.0]}, ["motion.period", "motion.rms"], folder=tmp_path, workers=1)
    [reason] = study.reasons
    assert reason.startswith("no motion.period, which is a motion of kind smooth: no limit cycle found from the start")
    assert study.values[0, 1] > 0.0


def test_numbers_of_controllers_and_sensors_are_parameters_too():
    over = {"controllers.nf.gain": "100:300 N*s/m:3", "sensors.vibrometer.noise": [1e-5, 2e-5]}
    scene = lab.load("pendulum")
    work = prepared(scene, over | {"drive.speed": "1 rpm:2:2"}, ["run.rms"])
    assert len(work.items) == 12
    last = work.scene_of(11)
    assert last.controllers["nf"].gain == 300.0
    assert last.sensors["vibrometer"].noise == 2e-5
    assert work.plan.factors[2].axis.shown_values.tolist() == pytest.approx([1.0, 2.0])
    assert last.seed == scene.seed + 11


def test_samples_of_a_distribution_are_drawn_from_the_seed(belt):
    over = {"load.force": [10.0, 20.0], "friction.mu_static": lab.normal(0.4, 0.02), "body.damping": lab.uniform(1, 3)}
    plans = {
        how: prepared(belt, over, ["cycle.period"], samples=64, sampling=how).plan
        for how in ("random", "latin", "sobol", "saltelli")
    }
    for how, plan in plans.items():
        assert plan.dimensions == {"load.force": 2, "sample": 64 * (4 if how == "saltelli" else 1)}
        assert plan.draws[:, 0].mean() == pytest.approx(0.4, abs=0.01)
        assert plan.draws[:, 0].std() == pytest.approx(0.02, rel=0.3)
        assert ((plan.draws[:, 1] > 1.0) & (plan.draws[:, 1] < 3.0)).all()
        assert plan.values(0) == plan.values(plan.rows) | {"load.force": 10.0}
        again = prepared(belt, over, ["cycle.period"], samples=64, sampling=how).plan
        assert np.array_equal(plan.draws, again.draws)
        other = prepared(belt, over, ["cycle.period"], samples=64, sampling=how, seed=99).plan
        assert not np.array_equal(plan.draws, other.draws)
    counts = np.histogram(plans["latin"].shares[:, 0], 64, (0.0, 1.0))[0]
    assert (counts == 1).all()
    a, b, ab = np.split(plans["saltelli"].shares, [64, 128])
    assert np.array_equal(ab[:64], np.column_stack([b[:, 0], a[:, 1]]))


def test_sobol_indices_of_a_sum_are_its_shares_of_the_variance(belt, tmp_path):
    """Nothing is simulated: the values of a measure are put in. y = 3 a + b: 9/10 and 1/10."""
    over = {"load.force": lab.uniform(10, 11), "body.damping": lab.uniform(2, 3)}
    work = prepared(belt, over, ["cycle.period"], samples=256, sampling="saltelli")
    found = {
        k: {"values": np.array([3.0 * a + b]), "units": np.array(["s"]), "reason": np.array("")}
        for k, (a, b) in enumerate(work.plan.draws.tolist())
    }
    result = gathered(work, found, {}, tmp_path)
    assert result.indices.first[0] == pytest.approx([0.9, 0.1], abs=0.01)
    assert result.indices.whole[0] == pytest.approx([0.9, 0.1], abs=0.01)
    assert "0.90 alone, 0.90 in all" in result.text()
    assert [path.name for path in result.draw(tmp_path)] == ["scatter.png", "tornado.png"]
    found[7]["values"][0] = math.nan
    assert np.isnan(gathered(work, found, {}, tmp_path).indices.first).all()


DRAWN = {
    "normal(2, 0.5)": stats.norm(2.0, 0.5),
    "normal(2, 0.5, low=1, high=2.2)": stats.truncnorm(-2.0, 0.4, 2.0, 0.5),
    "normal(0, 1, low=20, high=21)": stats.truncnorm(20.0, 21.0),  # far from the mean
    "lognormal(3, 0.2)": stats.lognorm(0.2, scale=3.0),
    "uniform(-1, 1)": stats.uniform(-1.0, 2.0),
    "triangular(0, 0.2, 1)": stats.triang(0.2),
}


@given(st.sampled_from([*DRAWN]), st.lists(st.floats(1e-6, 1.0 - 1e-6), min_size=2, max_size=20))
def test_quantiles_are_those_of_scipy_and_rise(text, shares):
    found = Distribution.parse(text).quantile(np.sort(shares), "N")
    assert np.allclose(found, DRAWN[text].ppf(np.sort(shares)), rtol=1e-9)
    assert (np.diff(found) >= 0.0).all()


WRONG = [
    ({"load.forse": [1.0]}, {}, r"load.forse: is not a numeric parameter of this scene; did you mean load.force or"),
    ({"load.force": ["10 kg"]}, {}, r"load.force: is '10 kg'"),
    ({}, {}, "no parameter is varied"),
    ({"load.force": "uniform(1 N, 2 N)"}, {"samples": 10, "sampling": "sobol"}, "must be a power of 2"),
    ({"load.force": [1.0]}, {"repeat": 2}, "all measures are those of the plant without noise"),
    ({"load.force": [1.0]}, {"measure": ["cycle.amplitud"]}, "cycle.amplitud: unknown; did you mean cycle.amplitude"),
    ({"load.force": [1.0]}, {"keep": "cycle.amplitude > 5 mm"}, "cycle.amplitude is not a measure of this study"),
]


@pytest.mark.parametrize(("over", "more", "told"), WRONG, ids=[told for *_, told in WRONG])
def test_what_is_wrong_is_named(belt, over, more, told):
    with pytest.raises((SceneError, UsageError), match=told):
        prepared(belt, over, **{"measure": ["cycle.period"], **more})


def test_values_without_a_unit_take_that_of_the_others(belt):
    for text in ("10, 20 kN", "10 kN, 20", "10, 20kN", "10kN:20:2", "10:20kN:2"):
        [axis] = [one.axis for one in prepared(belt, {"load.force": text}, ["cycle.period"]).plan.factors]
        assert (axis.values, axis.shown) == ((10e3, 20e3), "kN"), text
    assert Distribution.parse("uniform(10, 20kN)").in_si("N") == {"low": 10e3, "high": 20e3}
    assert Distribution.parse("lognormal(10 kN, 0.2, high=20)").in_si("N")["high"] == 20e3


def test_every_fault_is_told_at_once():
    wrong = {"samples": 0, "sampling": "latim", "seed": -1, "repeat": 3}
    with pytest.raises(UsageError) as fault:
        prepared(lab.load("belt_c_damped"), {"load.forse": [1.0], "body.mass": [-1.0]}, ["nothing", 3], **wrong)
    for text in (
        "load.forse",
        "body.mass",
        "measure nothing",
        "measure 3: expected",
        "nothing in it is random",
        "sampling latim: unknown",
        "samples = 0: must be",
        "seed = -1: must be",
    ):
        assert text in str(fault.value)


def test_seeds_alone_give_the_runs_of_these_seeds_and_their_spread(tmp_path):
    scene = lab.load("belt_c_damped", {"noise.force": "0.01"})
    found = lab.study(scene, {}, ["run.rms.velocity"], repeat=3, duration=0.5, folder=tmp_path, workers=1)
    assert found.work.plan.dimensions == {"repeat": 3}
    for k, value in enumerate(found.values[:, 0].tolist()):
        run = lab.simulate(replace(scene, seed=scene.seed + k), 0.5)
        assert value == run.signals["velocity"].std()
    assert len({*found.values[:, 0]}) == 3
    assert "3 points (3) over seeds" in found.text()
    with pytest.raises(UsageError, match=r"plate: nothing in it is random.*-p noise.force="):
        prepared(lab.load("plate"), {}, ["run.rms"], repeat=4)
    assert random_parts(lab.load("pendulum")) != ()  # noise of sensors
    assert random_parts(lab.load("belt", {"noise.force": "0"})) == random_parts(lab.load("belt"))


def test_recordings_of_chosen_points_are_kept_and_repeat(belt, tmp_path):
    found = lab.study(
        belt,
        {"load.force": [10.0, 20.0]},
        ["run.highest.displacement"],
        duration=0.5,
        keep="run.highest.displacement > 3 mm",
        folder=tmp_path,
        workers=1,
    )
    assert found.values[:, 0].tolist() == sorted(found.values[:, 0])
    expected = [k for k, v in enumerate(found.values[:, 0]) if v > 3e-3]
    assert 0 < len(expected) < 3
    assert list(found.recordings) == expected
    run = lab.open(found.recordings[expected[-1]])
    assert run.signals["displacement"].max() == found.values[expected[-1], 0]


def test_a_study_of_the_command_line_writes_its_files(rig, tmp_path):
    (tmp_path / "own.py").write_text("def one(run):\n    return 1.0\n")
    varied = ("--over", "load.force=10 N, 20 N", "--over", "drive.speed=0.05, 0.1 m/s", "-p", "body.damping=2 N*s/m")
    measured = ("--measure", "cycle.period", "--measure", f"{tmp_path / 'own.py'}:one", "--duration", "10 ms")
    asked = ("belt", *varied, *measured)
    code, out, err = rig("study", *asked, "--workers", 1, "--out", tmp_path / "studies", "--to", tmp_path / "found.nc")
    assert (code, "4 points (2 x 2)" in out) == (0, True), err
    assert (tmp_path / "found.nc").exists()
    folder = next((tmp_path / "studies").iterdir())
    assert {"study.csv", "heat_map.png"} <= {path.name for path in folder.iterdir()}
    code, _, err = rig("study", *asked, "--workers", 1, "--out", tmp_path / "studies")
    assert (code, "has study.csv" in err) == (2, True)
    code, out, _ = rig("study", *asked, "--workers", 1, "--out", tmp_path / "studies", "--force", "--json")
    assert json.loads(out)["dimensions"] == {"load.force": 2, "drive.speed": 2}


def test_a_study_without_any_value_fails(rig, tmp_path):
    sliding = ("study", "belt", "--measure", "cycle.period", "--workers", 1, "--out", tmp_path)
    code, out, _ = rig(*sliding, "--over", "drive.speed=2 m/s, 3 m/s")  # no limit cycle at these speeds
    assert code == 1
    why = "1 of 2 points have missing values: no limit cycle: displacement exceeds its limit of 0.05 m at "
    assert (f"{why}0.026 s; first at drive.speed = 2 m/s" in out, f"{why}0.017 s" in out) == (True, True)
    assert rig(*sliding, "--over", "drive.speed=0.06 m/s, 2 m/s")[0] == 0
