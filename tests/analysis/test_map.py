"""Maps of the mass on a belt (characteristic A, set PEND): regions, boundaries, and that the work can be cut anyhow."""

import json
import signal
from pathlib import Path

import numpy as np
import pytest

import rig
from rig.analysis import map as maps
from rig.analysis.axis import Axis
from rig.analysis.map import figure
from rig.analysis.map.chart import REGIONS
from rig.analysis.map.compute import MapUnits
from rig.analysis.map.job import ROOT, RUNS, SOURCES, Job, Settings, Unit
from rig.analysis.map.row import Row
from rig.analysis.map.steady_state import (
    BLANK,
    NAMES,
    SLIDING,
    STICK_SLIP,
    STUCK,
    UNDECIDED,
    VIBRATION,
    Judge,
    Point,
    Window,
    extremes,
    sticking,
)
from rig.analysis.map.track import Track
from rig.analysis.pool import Store, local
from rig.errors import Singular, UsageError

KROGER = json.loads((Path(__file__).parents[1] / "reference" / "kroger.json").read_text())
SPEEDS = "drive.speed=0.05:0.8:16"
FEW = "drive.speed=0.05:0.45:3"


@pytest.fixture(scope="module")
def belt(tmp_path_factory):
    return rig.map("belt", SPEEDS, folder=tmp_path_factory.mktemp("maps"))


@pytest.fixture(scope="module")
def job():
    """Four rows of three points: seconds of work."""
    return maps.job(rig.load("belt"), FEW, "load.force=15:30:4", runs=("up", "down"))


@pytest.fixture(scope="module")
def whole(job):
    """Its units in one batch, in this process."""
    return computed(job)


def computed(job):
    work = MapUnits(job)
    return {unit: work.compute(unit) for unit in range(work.total)}


def same(a, b):
    def equal(one, other):
        return np.array_equal(one, other, equal_nan=one.dtype.kind == "f")

    return a.keys() == b.keys() and all(equal(a[u][n], b[u][n]) for u in a for n in a[u])


def test_regions_over_the_speed_are_those_of_the_reference(belt):
    """Sliding is stable above one speed, stick-slip lives up to another: both between them."""
    stable, lives = KROGER["A_linear_stability_v0"], KROGER["A_stick_slip_exists_up_to_v0"]
    expected = ["III" if x < stable else "II" if x < lives else "I" for x in belt.job.x.values]
    assert [REGIONS[r] for r in belt.regions[0]] == expected
    assert not belt.disagreement.any()


def test_the_eigenvalue_boundary_is_found_between_the_points(belt):
    assert belt.onsets[0] == pytest.approx([KROGER["A_linear_stability_v0"]], abs=5e-6)


def test_the_run_up_loses_the_cycle_at_the_end_of_the_branch(belt):
    """To two of the least steps of the speed, a thirty-second of the gap between two points: a step takes spare too."""
    (last, lost), down = belt.ends[:, 0]
    assert lost - last == pytest.approx(0.05 / 32)
    assert last < KROGER["A_stick_slip_exists_up_to_v0"] < last + 2.0 * (lost - last)
    assert np.isnan(down).all()


def test_amplitude_and_stick_share_are_those_of_the_limit_cycle(belt):
    at = belt.job.x.values.index(pytest.approx(0.1))
    cycle = rig.limit_cycle(rig.load("belt", {"drive.speed": belt.job.x.values[at]}))
    for run in RUNS:
        number = RUNS.index(run)
        assert belt.amplitude[number, 0, at] == pytest.approx(cycle.amplitude["displacement"], rel=1e-5)
        assert belt.tables["share"][number, 0, at] == pytest.approx(cycle.stick_share["contact"], rel=1e-5)
        assert belt.tables["period"][number, 0, at] == pytest.approx(cycle.period, rel=1e-6)


def test_a_bifurcation_diagram_keeps_the_maxima_of_each_point(belt):
    section = belt.tables["section"][RUNS.index("up"), 0]
    highest = belt.tables["high"][RUNS.index("up"), 0]
    one = section[5][~np.isnan(section[5])]
    assert len(one) >= 5
    assert one == pytest.approx(highest[5], rel=1e-3)


def test_no_curve_of_a_bifurcation_diagram_joins_vibration_and_sliding(belt, tmp_path, monkeypatch):
    drawn = []
    monkeypatch.setattr(figure, "put", lambda made, path: drawn.append(made))
    figure.draw(belt, tmp_path / "map.png")
    for axes in drawn[0].axes:
        for name, run in (("run-up", "up"), ("run-down", "down")):
            [loss] = np.flatnonzero(np.diff(belt.moves[RUNS.index(run), 0]))
            before, after = belt.job.x.values[loss : loss + 2]
            for line in axes.lines:
                if (
                    line.get_color() != figure.RUN_STYLES[run][0]
                    or line.get_linewidth() == 0.0
                    or line.get_marker() == "."
                ):
                    continue
                x = line.get_xdata()
                assert len(x) == len(belt.job.x.values) + 1, name
                assert np.isnan(x[np.searchsorted(x[: loss + 1], before) + 1]), name
                assert after in x, name


def test_a_coulomb_belt_has_no_region_without_sliding(tmp_path):
    """Its sliding is stable at any speed; stick-slip ends where a mass that is let go just reaches the belt's speed."""
    found = rig.map("belt_c_damped", "drive.speed=0.02:0.1:9", folder=tmp_path, runs=("up", "near"))
    expected = ["II" if x < 0.0779535 else "I" for x in found.job.x.values]
    assert [REGIONS[r] for r in found.regions[0]] == expected
    assert not len(found.onsets[0])
    assert found.ends[0, 0] == pytest.approx(0.0779535, abs=2.0 * 0.01 / 32)


def test_a_parameter_that_cannot_be_ramped_is_an_axis_too(tmp_path):
    """Less static friction, less stick-slip: over mu_static the cycle ends on the way down."""
    found = rig.map("belt", "friction.mu_static=0.19:0.5:6", folder=tmp_path, runs=("up", "down"))
    assert found.state[RUNS.index("down"), 0, -1] == STICK_SLIP
    assert found.state[RUNS.index("up"), 0, 0] == SLIDING
    cycle = rig.limit_cycle(rig.load("belt"))
    assert found.amplitude[RUNS.index("up"), 0, -1] == pytest.approx(cycle.amplitude["displacement"], rel=1e-5)


def test_a_pin_leaves_sliding_beyond_its_limit_of_friction(tmp_path):
    """Tilted pin: damping is used up at 0.727389; at 0.96 the vibration grows with 63 1/s until it sticks."""
    found = rig.map("pin", "friction.mu=0.6:0.96:3", folder=tmp_path, runs=("near",), workers=1)
    near = found.state[RUNS.index("near"), 0].tolist()
    assert near[0] == SLIDING
    assert near[2] in (STICK_SLIP, VIBRATION)
    assert found.onsets[0] == pytest.approx([0.727389], abs=6e-7)


def test_points_at_which_a_pin_jams_are_told_and_the_map_goes_on(tmp_path):
    """From 0.988 on it jams; the lowest value of the other axis is one at which it does not begin to move at all."""
    found = rig.map("pin", "friction.mu=0.7:1.1:3", folder=tmp_path)
    jammed = found.job.x.values.index(1.1)
    assert [NAMES[state] for state in found.state[:, 0, jammed]] == ["stopped"] * 4
    assert all("jams: friction takes up all of the inertia" in why for why in found.why[:, 0, jammed])
    assert REGIONS[found.regions[0, 0]] == "I"
    assert "a run had to stop at 1 of 3 points; first at friction.mu = 1.1: " in found.text()
    [point] = [one for one in found.to_json()["points"] if one["up_state"] == "stopped"]
    assert "jam" in point["up_why"]


def test_a_point_with_singular_equations_is_told_and_the_map_goes_on(tmp_path, monkeypatch):
    own = Track.sliding

    def sliding(track, value):
        if value == 0.7:
            raise Singular("jams: just here", "contact slip+", jams=True)
        return own(track, value)

    monkeypatch.setattr(Track, "sliding", sliding)
    found = rig.map("pin", "friction.mu=0.6:0.8:3", runs=("up", "near"), folder=tmp_path, workers=1)
    assert NAMES[found.state[RUNS.index("near"), 0, 0]] == "sliding"
    assert NAMES[found.state[RUNS.index("near"), 0, 1]] == "stopped"
    assert "first at friction.mu = 0.7: jams: just here" in found.text()


def test_an_axis_that_begins_where_the_rig_jams_has_a_map_too(tmp_path):
    """A pin of 0.05 kg jams at mu = 0.75: below 0.109 kg friction takes up all of the inertia."""
    found = rig.map("pin", "pin.mass=0.05:0.25:3", runs=("up", "near"), folder=tmp_path)
    first, *_, last = (NAMES[state] for state in found.state[RUNS.index("up"), 0])
    assert first == "stopped"
    assert last in ("sliding", "stick-slip")


def test_time_windows_do_not_grow_from_point_to_point_where_nothing_settles():
    track = Track(rig.load("pin"), Axis.of("friction.mu", (0.7, 0.8), rig.load("pin")), Settings("displacement"))
    track.judged = lambda *_: Point(UNDECIDED, BLANK, 0.0)
    before = track.window_ticks
    track.settle()
    assert track.window_ticks == before


def test_a_boundary_next_to_a_point_without_sliding_is_found(tmp_path):
    """slope(v0) F0 = d at 1.0375 N; at 0 N nothing presses. The columns of the report keep apart."""
    found = rig.map("belt", "load.force=0:40:5", "drive.speed=0.03:0.06:2", runs=("near",), longest=1.0,
                    folder=tmp_path, workers=1)  # fmt: skip
    loads = [2.0 / (6.4 * np.exp(-speed / 0.05)) for speed in (0.03, 0.06)]
    assert [row.tolist() for row in found.onsets] == [[pytest.approx(load, rel=1e-8)] for load in loads]
    lines = found.text().splitlines()
    head = next(line for line in lines if "sliding loses stability" in line)
    assert all(line[head.index("sliding") :].startswith(f"{load:.6g} N  ") for line, load in zip(lines[-2:], loads))


def test_a_drive_that_stands_still_is_stuck(tmp_path):
    found = rig.map("belt", "drive.speed=0:0.1:3", folder=tmp_path, runs=("up", "down"))
    assert [REGIONS[r] for r in found.regions[0]] == ["stuck", "III", "III"]
    assert found.state[0, 0, 0] == STUCK
    assert np.isnan(found.growth[0, 0])


def test_numbers_do_not_depend_on_how_the_work_is_cut(job, whole, tmp_path):
    work = MapUnits(job)
    assert same(whole, {unit: work.compute(unit) for unit in reversed(range(work.total))})
    assert same(whole, computed(Job.from_json(job.to_json())))


def test_numbers_do_not_depend_on_the_number_of_workers(job, whole, tmp_path):
    told = []
    found = maps.chart(job, tmp_path, workers=2, progress=lambda done, total: told.append((done, total)))
    assert same(whole, Store(found.folder).load())
    assert told[0] == (0, 4)
    assert told[-1] == (4, 4)


def test_a_map_with_one_axis_is_cut_into_parts_that_find_what_the_whole_row_finds():
    """The carried runs are one unit, which holds the growth rates; near and far starts are cut into parts."""
    scene = rig.load("belt")
    axis = Axis.parse("drive.speed=0.1:0.5:12", scene)
    job = Job(scene, axis, None, Settings("displacement"))
    assert job.units == (
        Unit(0, 0, 12, ("up", "down")),
        Unit(0, 0, 10, ("near", "far"), curve=False),
        Unit(0, 10, 12, ("near", "far"), curve=False),
    )
    found = maps.gathered(job, computed(job), Path())
    row = Row(Track(scene, axis, job.settings), Unit(0, 0, 12, RUNS)).run()
    for name in ("high", "share", "spent"):
        assert np.array_equal(found.tables[name][:, 0], row[name], equal_nan=True)
    assert np.array_equal(found.state[:, 0], row["state"])
    assert np.array_equal(found.onsets[0], row["onset"])


def test_the_growth_rates_of_parts_are_those_of_the_whole_row():
    scene = rig.load("belt")
    axis = Axis.parse("drive.speed=0.1:0.5:30", scene)
    job = Job(scene, axis, None, Settings("displacement", runs=("near",)))
    assert [(u.first, u.last) for u in job.units if u.curve] == [(0, 25), (25, 30)]
    found = maps.gathered(job, computed(job), Path())
    row = Row(Track(scene, axis, job.settings), Unit(0, 0, 30, ("near",))).run()
    assert np.array_equal(found.growth[0], row["growth"])
    assert np.array_equal(found.onsets[0], row["onset"])


def test_a_broken_run_goes_on_where_it_was(job, whole, tmp_path, monkeypatch):
    store = maps.store_of(job, tmp_path)
    with store.open(MapUnits(job)):
        store.save({1: whole[1], 2: whole[2]})
    (store.folder / "000003.npz").write_bytes(b"half a file")
    asked = []

    def compute(self, unit):
        asked.append(unit)
        return whole[unit]

    monkeypatch.setattr(MapUnits, "compute", compute)
    found = maps.chart(job, tmp_path, workers=1)
    assert asked == [0, 3]
    assert same(whole, Store(found.folder).load())
    maps.chart(job, tmp_path, workers=1)
    assert asked == [0, 3]


def test_another_scene_axis_or_setting_is_another_folder(job, tmp_path):
    scene = rig.load("belt")
    others = [
        maps.job(rig.load("belt", {"body.damping": 2.5}), FEW, "load.force=15:30:4", runs=("up", "down")),
        maps.job(scene, FEW, "load.force=15:31:4", runs=("up", "down")),
        maps.job(scene, FEW, "load.force=15:30:4", runs=("up",)),
    ]
    folders = {maps.store_of(one, tmp_path).folder for one in (job, *others)}
    assert len(folders) == 4
    assert maps.store_of(maps.job(scene, FEW, "load.force=15:30:4", runs=("up", "down")), tmp_path).folder in folders


def test_the_batch_of_a_worker_that_is_killed_is_computed_by_another_one(job, whole, tmp_path, monkeypatch):
    started = []
    original = local.Child

    def child(*arguments, **named):
        started.append(original(*arguments, **named))
        return started[-1]

    monkeypatch.setattr(local, "Child", child)

    def kill(done, total):
        if done == 1:
            started[0].send(signal.SIGKILL)

    found = maps.chart(job, tmp_path, workers=2, progress=kill)
    assert started[0].code == -signal.SIGKILL
    assert all(one.code is not None for one in started)
    assert same(whole, Store(found.folder).load())


def test_a_row_that_ends_its_worker_twice_is_told_and_the_map_goes_on(job, tmp_path):
    work = MapUnits(job)
    row = work.failed(2, "ended its worker twice: worker 1 was killed by SIGSEGV")
    found = maps.gathered(job, {unit: work.compute(unit) if unit != 2 else row for unit in range(4)}, tmp_path)
    assert NAMES[found.state[0, 2, 0]] == "stopped"
    assert "a run had to stop at 3 of 12 points" in found.text()
    assert "ended its worker twice: worker 1 was killed by SIGSEGV" in found.text()


def test_an_interruption_ends_the_workers(job, tmp_path, monkeypatch):
    started = []
    original = local.Child
    monkeypatch.setattr(local, "Child", lambda *a, **n: started.append(original(*a, **n)) or started[-1])

    def interrupt(done, total):
        if len(started) == 2:
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        maps.chart(job, tmp_path, workers=2, progress=interrupt)
    assert all(one.code is not None for one in started)


def test_two_runs_of_one_map_keep_apart(job, tmp_path):
    with (
        maps.store_of(job, tmp_path).open(MapUnits(job)),
        pytest.raises(UsageError, match="another process computes this at the moment"),
    ):
        maps.chart(job, tmp_path)


@pytest.mark.parametrize(
    ("settings", "told"),
    [
        ({"output": "displacment"}, "did you mean displacement"),
        ({"runs": ("up", "sideways")}, "sideways is unknown; known: up, down, near, far"),
        ({"runs": ()}, "name at least one of"),
        ({"longest": -1.0}, "must be greater than 0 s"),
    ],
)
def test_what_is_wrong_is_told(settings, told):
    with pytest.raises(UsageError, match=told):
        maps.job(rig.load("belt"), FEW, **settings)


def test_a_dithered_scene_has_no_steady_sliding_to_map():
    with pytest.raises(UsageError, match="-p dither=none"):
        maps.job(rig.load("belt_dither", {"dither.enable": True}), FEW)


def window(travel, slip=1.0, share=0.0, moving=True):
    return Window(-travel, travel, travel, travel, slip, share, 5 if share else 0, 0.3, moving)


def judged(windows, near=False):
    judge = Judge(0.01, near)
    return [NAMES[judge.take(w)] for w in windows]


def test_a_cycle_must_agree_twice():
    assert judged([window(1.0, share=0.3), window(1.0, share=0.3)]) == ["undecided"] * 2
    assert judged([window(1.0, share=0.3)] * 3)[-1] == "stick-slip"
    assert judged([window(1.0 - 1e-3 * k, share=0.3) for k in range(9)])[-1] == "undecided"
    assert judged([window(1.0)] * 3)[-1] == "vibration"


def test_a_near_start_that_hardly_moves_is_not_yet_a_vibration():
    assert judged([window(1.0, slip=0.01)] * 9, near=True)[-1] == "undecided"
    assert judged([window(1.0, slip=0.001), window(0.9, slip=0.0009)], near=True)[-1] == "sliding"


@pytest.mark.parametrize(
    ("travel", "verdict"),
    [
        (1.0 + 0.3 * np.sin(3.0 * np.arange(40.0)), "stick-slip"),
        (1.0 - 0.01 * np.arange(40.0), "undecided"),
        (1.0 + 1.0 / (2.0 + np.arange(40.0)), "undecided"),
    ],
)
def test_at_the_end_of_the_time_a_drift_is_undecided_and_irregular_motion_is_not(travel, verdict):
    judge = Judge(0.01, near=False)
    for value in travel:
        judge.take(window(float(value), share=0.3))
    assert NAMES[judge.at_last()] == verdict


def over_sectors(windows):
    judge = Judge(0.01, near=False, pushed=True)
    return [NAMES[judge.take(w)] for w in windows]


def test_over_sectors_a_cycle_must_live_through_five_turns():
    sticks, slides = window(1.0, share=0.3), window(1.0)
    assert over_sectors([sticks] * 5) == ["undecided"] * 4 + ["stick-slip"]
    assert over_sectors([sticks, sticks, slides, slides])[-1] == "sliding"
    assert over_sectors([window(1.0, slip=0.1), window(1.0, slip=0.2)])[-1] == "undecided"


def test_extremes_are_read_between_samples_but_not_beside_a_corner():
    t = np.arange(0.0, 3.0, 0.01)
    assert extremes(np.sin(2.0 * np.pi * (t + 0.0031))) == pytest.approx((-1.0, 1.0), abs=1e-6)
    corner = np.minimum(np.abs(np.mod(t + 0.0031, 1.0) - 0.5), 0.3)
    assert extremes(corner)[1] == 0.3
    assert 0.0 <= extremes(corner)[0] <= 0.01


def test_the_share_of_sticking_is_that_of_whole_cycles():
    times = np.array([0.5, 1.0, 2.5, 3.0, 4.5, 5.0])  # sticks from 0.5 to 1, 2.5 to 3, 4.5 to 5
    stuck = np.array([False, True, False, True, False, True])
    found = sticking(times, stuck, after=False, span=5.2)
    assert (found.share, found.begins, found.period) == (0.25, 3, 2.0)
    assert sticking(np.zeros(0), np.zeros(0, dtype=bool), after=True, span=2.0).share == 1.0


@pytest.mark.parametrize("source", SOURCES)
def test_kept_results_depend_on_sources_that_exist(source):
    assert list(ROOT.glob(f"{source}.py"))
