"""The torture test: its cases are sound, its results are what they say, the default method is green."""

import json
from pathlib import Path

import pytest
from wrong_methods import WRONG

from rig import scenes
from rig.errors import SceneError, UsageError
from rig.qualify import torture
from rig.qualify.torture import recorded_run, trial
from rig.qualify.torture.case import load, of_scenes, read, watched
from rig.qualify.torture.cells import cells
from rig.qualify.torture.results import RunOutcome, judge

NUM = json.loads((Path(__file__).parents[1] / "reference" / "num.json").read_text())
SOME = ["grazing", "belt_at_rest", "belt_loop_unlimited", "pin_jams"]  # of few kernels


@pytest.fixture(scope="module")
def some():
    return torture.matrix(SOME, quick=True)


def test_worker_processes_find_the_same_cells(some):
    again = torture.matrix(SOME[2:], quick=True, workers=2)
    assert [(one.case, one.method, one.step, one.result) for one in again] == [
        (one.case, one.method, one.step, one.result) for one in some if one.case in SOME[2:]
    ]


def test_expected_numbers_are_those_of_the_references():
    assert load("belt_stick_slip").expect.events == len(NUM["P1"]["events"])
    assert load("short_stick").expect.events == NUM["HC2"]["events"]
    assert load("grazing").expect.events == NUM["HC2b"]["events"]
    p1 = NUM["P1"]["params"]
    assert load("belt_stick_slip").set["body.damping"] == p1["c"]
    limit = p1["mud"] + NUM["HC2b"]["limit"] * (1.0 + 1e-6)
    assert load("grazing").set["friction.mu_static"] == pytest.approx(limit, rel=1e-14)


def test_default_is_green(some):
    assert [cell for cell in some if not cell.good] == []
    assert {cell.case for cell in some if cell.default} == set(SOME)


def test_a_fault_that_stops_runs_with_sensors_is_red(tmp_path, monkeypatch):
    """A frame with more smooth segments than the sensors can read, which a run without sensors does not need."""
    path = tmp_path / "long_frame.toml"
    text = 'title = "x"\nabout = "y"\nscene = "belt_c"\nduration = "2 s"\nsteps = ["0.5 ms"]\nframe = "1 s"\n'
    path.write_text(text)
    good = next(cell for cell in cells(read(path), True, ()) if cell.default)
    assert good.result.colour == "green"
    monkeypatch.setattr("rig.motion.motion.MOST_SEGMENTS", 0)
    bad = next(cell for cell in cells(read(path), True, ()) if cell.default)
    assert bad.result.colour == "red"
    assert "for the sensors to read" in bad.result.detail


def test_the_rounding_of_a_contact_that_sticks_all_the_time_is_no_power_of_friction(monkeypatch):
    monkeypatch.setattr(scenes, "names", lambda: ("tip_beam",))
    [case] = of_scenes(load("every_scene"), False)
    [cell] = [cell for cell in cells(case, False, ()) if cell.default]
    assert cell.result.colour == "green", cell.result.detail


def test_processes_in_lockstep_have_the_bits_of_one_process(runs):
    result = recorded_run.processes(load("loop_as_processes"), 100_000_000)
    assert result.colour == "green"
    assert result.detail == "2 sensors and 1 controller have the same bits as in one process"


def test_the_default_of_a_scene_is_its_own_method_with_the_tolerance_chosen_for_it():
    """With this tolerance dopri5 leaves the energy balance open by more than the torture test allows."""
    [case] = [case for case in of_scenes(load("every_scene"), False) if case.scene == "disc_slider_c"]
    clock, step_ns = scenes.load(case.scene).clock, case.steps[0]
    assert clock.method == "dop853"
    assert watched(case, clock.method, step_ns).clock.tolerance == clock.tolerance
    assert watched(case, "dopri5", step_ns).clock.tolerance == 1e-7  # as in a scene that states none
    [default] = [cell for cell in cells(case, False, ()) if cell.default]
    assert (default.method, default.result.colour) == ("dop853", "green")


def test_instability_is_named_with_its_growth(some):
    named = next(cell for cell in some if cell.case == "belt_loop_unlimited")
    assert named.result.colour == "green"
    assert "growth +433 1/s" in named.result.detail


def test_comparison_fails_for_the_reason_it_should(some):
    rk4 = next(cell for cell in some if cell.case == "grazing" and cell.method == "rk4")
    assert (rk4.result.colour, rk4.result.reason) == ("red", "missed event")


def test_noise_is_left_out_because_each_step_would_have_its_own(tmp_path):
    path = tmp_path / "noisy.toml"
    path.write_text('title = "x"\nabout = "y"\nscene = "tip_epoxy"\nduration = "50 ms"\nsteps = ["0.1 ms"]\n')
    assert watched(read(path), "auto", 100_000).assemble().signals.keys() == {"one"}
    assert all(cell.good for cell in torture.matrix([str(path)], quick=True))


def caught(name, way, step_ns):
    """What the torture test says of a run by a method that is wrong."""
    case = load(name)
    until = case.quick_duration or case.duration
    scene = watched(case, "auto", step_ns)
    reference = trial.Trial(case, scene, until, 60.0).run()
    result = judge(case, WRONG[way](case, scene, until, 60.0), reference, step_ns * 1e-9)
    return result.colour, result.reason


@pytest.mark.parametrize(
    ("name", "way", "reason"),
    [
        ("contact_felt_late", "held", "energy"),
        ("film_felt_late", "held", "energy"),
        ("grazing", "sign", "creep"),
    ],
)
def test_methods_that_are_wrong_are_caught_at_every_step(name, way, reason):
    assert {caught(name, way, step) for step in load(name).steps[:2]} == {("red", reason)}


def test_a_film_keeps_its_energy():
    names = ["film_felt_late", "film_rows_late", "film_on_matrices", "film_step_beyond"]
    found = torture.matrix(names, quick=True)
    default = [cell for cell in found if cell.default]
    assert [cell for cell in default if cell.result.colour != "green"] == []
    assert {cell.case for cell in default} == set(names)


def test_a_slider_that_comes_to_the_edge_stops_with_a_word():
    [cell] = torture.matrix(["film_beyond_edge"], quick=True)
    assert cell.good
    assert "the slider has reached the end of its travel, 0.0437 m" in cell.result.detail


def test_results():
    case = load("stick_below_limit")
    good = RunOutcome(events=[(0.1, "contact slip+"), (0.2, "contact stick")], count=2)
    assert judge(case, good, good).colour == "green"

    def told(**changes):
        found = judge(case, RunOutcome(**({"events": good.events, "count": 2} | changes)), good)
        return found.colour, found.reason

    assert told(not_finite=1) == ("red", "NaN")
    assert told(energy=2e-6) == ("red", "energy")
    assert told(negative_power=1e-6) == ("red", "energy")
    assert told(outside_cone=1e-6) == ("red", "missed event")
    assert told(pulling=1e-6) == ("red", "missed event")
    assert told(creep=1e-6) == ("red", "creep")
    assert told(began={"displacement": 1.0}, ended={"displacement": 1.0 + 1e-15}) == ("red", "creep")
    assert told(count=1) == ("red", "missed event")
    assert told(count=3) == ("red", "chatter")
    assert told(events=[(0.1, "contact slip-"), (0.2, "contact stick")]) == ("red", "order lost")
    assert told(events=[(0.1, "contact slip+"), (0.21, "contact stick")]) == ("amber", "order lost")
    assert told(seconds=11.0, carrying=10.0) == ("green", "")  # a slow computer says nothing of stability


def test_what_comes_at_one_instant_may_come_in_any_order():
    case = load("two_at_once")
    one = RunOutcome(events=[(0.1, "a slip+"), (0.1, "b slip+"), (0.3, "a stick")], count=3)
    other = RunOutcome(events=[(0.1, "b slip+"), (0.1, "a slip+"), (0.3, "a stick")], count=3)
    assert judge(case, other, one).colour == "green"


def test_a_case_names_a_scene_file_by_its_path_from_its_own_folder(tmp_path):
    (tmp_path / "cases").mkdir()
    (tmp_path / "mine.toml").write_text('based_on = "belt_c"\n[load]\nforce = "25 N"\n')
    path = tmp_path / "cases" / "case.toml"
    path.write_text('title = "x"\nabout = "y"\nscene = "../mine.toml"\nduration = "1 ms"\n')
    assert watched(read(path), "exact", 1_000_000).parameters.load.force == 25.0


def test_faults_of_a_case_are_told_together(tmp_path):
    path = tmp_path / "bad.toml"
    path.write_text('title = "x"\nabout = "y"\nscene = "belt_c"\nduration = "3 m"\nspeed = 1\n')
    with pytest.raises(SceneError) as told:
        read(path)
    assert 'duration = "3 m": expected a unit that converts to s' in told.value.faults
    assert any(fault.startswith("speed: unknown key; ") for fault in told.value.faults)
    for steps, fault in (('["1 ms", "0.5 us"]', "steps below 1 us need frames"), ("[]", "steps")):
        path.write_text(f'title = "x"\nabout = "y"\nscene = "belt_c"\nduration = "3 s"\nsteps = {steps}\n')
        with pytest.raises(SceneError, match=fault):
            read(path)
    path.write_text('title = "x"\nbased_on = "belt"\n')
    with pytest.raises(SceneError, match=r'is a scene; a case names one, scene = "bad.toml"'):
        read(path)
    with pytest.raises(UsageError, match="did you mean grazing"):
        load("grasing")
