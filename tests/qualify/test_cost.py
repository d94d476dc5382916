"""What accuracy costs: measures against closed forms, references against each other, and the setting that is taken."""

import math
from dataclasses import replace

import numpy as np
import pytest
from scipy import stats

import rig
from rig.analysis.cycles.motion_measures import Setting, eligible, errors, ladder, observe, problem
from rig.errors import UsageError
from rig.model import assembly
from rig.qualify.cost import Row, Table, cost, folder_of, recommended
from rig.qualify.cost.measuring import steps_of_film
from rig.qualify.cost.report import heads, lines, notes
from rig.qualify.cost.table import runs_needed
from rig.qualify.cost.timing import QUIET, Cost, Spread, spread
from rig.scenes.protocol import Hold
from rig.stability.report import FILM_LIMIT, RK4_LIMIT, fastest_state, stability_report


def row(error, p99, share=0.0, method="rk4", floor=0.0):
    one = Spread(p99, p99, p99)
    return Row(Setting(method), {"period": error}, {"period": floor}, Cost(one, one, one, one), share)


@pytest.fixture(scope="module")
def belt(tmp_path_factory):
    folder = tmp_path_factory.mktemp("cost")
    scene = rig.load("belt_c")
    told = []
    return scene, folder, cost(scene, folder, lambda done, total: told.append((done, total)), rounds=1), told


def test_errors_of_a_fixed_step_fall_with_its_fourth_power(belt):
    found = belt[2]
    assert found.kind == "cycle"
    assert found.orders["rk4"] == pytest.approx(4.0, abs=0.1)
    assert {r.setting.method for r in found.rows} == {"exact", "rk4"}
    assert "exact propagator" in found.left_out["dopri5"]


def test_the_exact_method_is_judged_by_another_and_both_by_the_closed_form(belt):
    found = belt[2]
    a, b, w = 0.15 * 20.0 / 2500.0, 0.06 / math.sqrt(500.0), math.sqrt(500.0)
    period = 2.0 * a / 0.06 + (2.0 * math.pi - 2.0 * math.atan2(a, b)) / w
    assert found.values["period"] == pytest.approx(period, rel=1e-13)
    assert found.values["amplitude displacement"] == pytest.approx(math.hypot(a, b), rel=1e-12)
    assert found.values["stick share contact"] == pytest.approx(2.0 * a / 0.06 / period, rel=1e-12)
    [exact] = [r for r in found.rows if r.setting.method == "exact"]
    assert 0.0 < exact.error("worst") < 1e-11


SETTINGS = (Setting("dopri5", 1e-3), Setting("dopri5", 1e-8), Setting("rk4", step_ns=100_000), Setting("exact"))


@pytest.mark.parametrize("name", ["belt", "belt_c"])
def test_a_row_moves_as_a_run_with_its_setting_does(name):
    """Mode changes of the run, and its state at the end, are those that the row was judged by, bit by bit."""
    mass = 0.9 * rig.load(name).parameters.body.mass
    asked = problem(rig.load(name, {"body.mass": mass, "limits": {}}))
    assert not asked.values  # nothing is moved: the run begins where the row does
    able = eligible(asked.system)
    for setting in SETTINGS:
        if able[setting.method]:
            continue
        seen = observe(asked, setting)
        run = rig.simulate(setting.applied(asked.scene), asked.seconds)
        met = [event for event in run.events if event["kind"] == "contact"]
        events = [((e["data"]["tick"] + e["data"]["place"]) * asked.step, e["text"]) for e in met]
        assert (seen.count, list(seen.events)) == (len(events), events[: len(seen.events)])
        orbit = asked.orbit(setting)
        while orbit.motion.tick < asked.length:
            orbit.block(asked.length - orbit.motion.tick)
        values = dict(zip(orbit.outputs, orbit.motion.outputs_now().tolist()))
        assert {output: run.signals[output][-1] for output in values if output in run.signals} == {
            output: value for output, value in values.items() if output in run.signals
        }


@pytest.mark.parametrize("law", ["lugre", "elasto_plastic", "dahl", "maxwell_slip", "rate_state", "stick_time"])
def test_no_step_of_rk4_is_measured_with_which_a_run_is_refused(law):
    scene = rig.load(f"belt_{law}")
    system, step = scene.assemble().system(), scene.step_ns * 1e-9
    for setting in ladder("rk4", scene, fastest_state(system)):
        found = stability_report(system, "rk4", step, scene.step_ns // setting.step_ns)
        assert not [finding for finding in found if finding.level == "error"]


@pytest.mark.slow
def test_where_no_step_of_rk4_is_stable_the_references_are_dopri5_and_rosenbrock():
    found = cost(rig.load("belt_rate_state"), None, rounds=1)
    assert "is stable" in found.left_out["rk4"]
    assert {row.setting.method for row in found.rows} == {"dopri5", "rosenbrock"}
    tight = [row.error("worst") for row in found.rows if row.setting.tolerance == 1e-11]
    assert max(tight) < 1e-9
    assert not any(row.fault for row in found.rows)


def test_a_state_with_missed_events_is_no_small_error(belt):
    asked = problem(belt[0])
    seen = observe(asked, Setting("exact"))
    assert errors(asked, seen, seen)["event times"] == 0.0
    fewer = type(seen)(seen.values, seen.events[1:], seen.count - 1, seen.mean)
    assert math.isinf(errors(asked, fewer, seen)["event times"])


def test_the_setting_taken_is_the_cheapest_that_is_enough():
    rows = [row(1e-2, 10.0, 0.01), row(1e-4, 20.0, 0.02), row(1e-6, 40.0, 0.04), row(1e-5, 21.0, 0.021)]
    assert recommended(rows, "period", 1e-3, None) is rows[3]  # a twentieth more, and ten times as accurate
    assert recommended(rows, "period", None, 0.03) is rows[3]
    assert recommended(rows, "period", None, None) is rows[2]
    with pytest.raises(UsageError, match="no setting reaches a relative error of 1e-08"):
        recommended(rows, "period", 1e-8, None)
    with pytest.raises(UsageError, match=r"no setting fits 0\.1 %"):
        recommended(rows, "period", 1e-3, 0.001)


@pytest.mark.parametrize("share", [QUIET, 0.99])
def test_an_interval_contains_its_estimate_and_mostly_the_true_quantile(share):
    draw = np.random.default_rng(5)
    for count in (*range(1, 60), 1050):
        found = spread(draw.exponential(size=count), share)
        assert found.low <= found.value <= found.high, count
    intervals = [spread(draw.random(1050), share) for _ in range(400)]
    assert 0.92 < np.mean([one.low <= share <= one.high for one in intervals]) < 0.99


def test_the_cost_of_a_rig_that_rests_is_refused():
    with pytest.raises(UsageError, match=r"belt_c: nothing moves from its initial state"):
        cost(rig.load("belt_c", {"drive.speed": 0.0, "start.velocity": 0.0}), None)


def test_a_run_takes_what_the_table_of_this_machine_recommends(belt):
    from rig.qualify.cost import chosen

    scene, folder, *_ = belt
    told = []
    taken = chosen(scene, 1e-6, None, told.append, folder)
    assert taken.clock.method in told[-1]
    assert "of a frame at p99" in told[-1]
    with pytest.raises(UsageError, match=r"no setting (provably )?reaches a relative error of 1e-30"):
        chosen(scene, 1e-30, None, told.append, folder)
    with pytest.raises(UsageError, match="no setting fits"):
        chosen(scene, None, 1e-6, told.append, folder)


def test_what_is_recommended_holds_when_it_is_judged_anew():
    """A rig of the trial, with a seed of its own; what it costs is for a quiet machine to say."""
    from benchmarks.holdout import SCENES, drawn, judged

    scene, target = next(rig for rig in drawn(len(SCENES), seed=7) if rig[0].name == "belt_c")
    found = judged(scene, target, rounds=1)
    assert found.error <= found.target
    assert found.ratio >= 1.0


@pytest.mark.parametrize(("half", "target"), [(0.02, 1e-3), (3e-3, 1e-3), (1e-3, 2e-3), (0.5, 1e-2)])
def test_the_runs_that_a_target_needs_are_the_fewest_whose_interval_meets_it(half, target):
    needed, spread = runs_needed(8, half, target), half * np.sqrt(8.0) / stats.t.ppf(0.975, 14)
    halves = [stats.t.ppf(0.975, 2 * runs - 2) * spread / np.sqrt(runs) for runs in (needed, max(needed - 1, 2))]
    assert halves[0] <= target
    assert needed == 2 or halves[1] > target


@pytest.mark.parametrize("own", ["5 us", "0.7 us", "40 us"])
def test_the_step_of_the_scene_is_among_those_compared(own):
    scene = rig.load("structure", {"structure.film": True, "clock.rk4_step": own})
    rate = assembly.fastest(scene.assemble().system(), float(scene.clock.rk4_step) * 1e-9) * RK4_LIMIT / FILM_LIMIT
    steps = [setting.step_ns for setting in steps_of_film(scene, rate)]
    assert int(scene.clock.rk4_step) in steps[:-1]
    assert steps == sorted(steps, reverse=True)
    assert 2 * steps[-1] <= steps[-2]


def test_a_film_of_points_is_measured_by_statistics_of_several_runs(tmp_path):
    changes = {"structure.film": True, "start.velocity": 0.3, "drive.speed": 1.0, "sensors.vibrometer.rate": "10 kHz"}
    scene = replace(rig.load("structure", changes), protocol=(Hold(step="hold", time="300 ms"),))
    table = cost(scene, tmp_path, rounds=1)
    assert table.statistical
    assert len(ladder("kick", rig.load("plate"), 8e5)) >= 3  # a segment of a film covers several steps
    assert {"first opening", "mean contact_fraction", "rms pad_velocity"} <= set(table.values)
    steps = [row.setting.step_ns for row in table.rows]
    assert steps == sorted(steps, reverse=True)
    assert int(scene.clock.rk4_step) in steps
    for row in table.rows:
        assert row.timed
        assert all(0.0 <= row.floors[name] <= error < 0.3 for name, error in row.errors.items())
    assert recommended(table.rows, "worst", 0.3, None) in table.rows
    assert "half of the 95 % interval of the means of 8 runs" in "\n".join(notes(table, "worst"))
    (head, part), row = heads(table)[2:4], lines(table, "worst", None)[0]
    assert (head, part) == ("error", "by statistics")
    assert float(row[3]) == pytest.approx(table.rows[0].floor(table.rows[0].worst), rel=0.1)
    assert Table.read(folder_of(scene, tmp_path)).rows == table.rows
