"""Controllers given to rig.simulate as objects and files: guests and linear systems, recorded and verified."""

import re
from pathlib import Path

import control
import numpy as np
import pytest

import rig
from rig.bench.again.verify import verify
from rig.cli.options import added
from rig.errors import ControllerFailed, RigError, SceneError, UsageError
from rig.record.save_run import save

ROOT = Path(__file__).parents[2]


class Feedback:
    """Normal-force feedback as a user writes it; `seen`: the times at which it was asked."""

    reads, drives, period_ns = ("vibrometer",), ("load.force",), 1_000_000

    def __init__(self, gain=200.0):
        self.gain, self.seen = gain, []

    def start(self):
        return 0

    def update(self, state, t_ns, values):
        self.seen.append(t_ns)
        return state + 1, (min(max(20.0 - self.gain * values[0], 0.0), 100.0),)


def commands(run, name="nf"):
    return run.commands[name].values.tobytes()


@pytest.fixture(scope="module")
def own():
    """The run of the scene's own controller, which is the same feedback."""
    return rig.simulate(rig.load("belt_normal_force", {"controllers.nf.enable_at": "0 s"}), 0.3)


def test_an_object_replaces_a_controller_of_the_scene(own):
    run = rig.simulate("belt_normal_force", 0.3, controllers={"nf": Feedback()})
    assert commands(run) == commands(own)
    for name, values in own.signals.items():
        assert run.signals[name].tobytes() == values.tobytes(), name
    assert '"nf"' not in run.scene  # the recording must not claim that the scene's controller worked
    assert [event["text"] for event in run.plant_events if event["kind"] == "admitted"] == [
        "nf is admitted and drives load.force"
    ]


def test_a_guest_on_a_rig_whose_load_nobody_drove_has_a_command_state(own, tmp_path):
    """A command that needed new matrices would take 2 ms; as a state of the rig it takes microseconds."""
    scene = rig.load("belt_normal_force", {"controllers.nf": "none"})
    assert scene.moved == {}
    run = rig.simulate(scene, 0.3, controllers={"mine": Feedback()})
    assert commands(run, "mine") == commands(own)
    assert run.signals["velocity"].tobytes() == own.signals["velocity"].tobytes()
    save(run, tmp_path / "run.mcap")
    found = verify(tmp_path / "run.mcap")
    assert found.passed, found.text()


def test_the_delay_of_a_replaced_controller_stays(tmp_path):
    scene = rig.load("belt_normal_force", {"controllers.nf.delay": "5 ms", "controllers.nf.enable_at": "0 s"})
    run = rig.simulate(scene, 0.2, controllers={"nf": Feedback()})
    assert commands(run) == commands(rig.simulate(scene, 0.2))
    assert run.commands["nf"].tick[0] == 5
    save(run, tmp_path / "run.mcap")
    assert verify(tmp_path / "run.mcap").passed


def test_a_system_of_python_control_becomes_a_table_of_the_scene(own, tmp_path):
    gain = control.ss([], [], [], [[-200.0]], 1e-3, inputs="vibrometer", outputs="load_force")
    scene = rig.load("belt_normal_force", {"controllers.nf.delay": "0 s"})
    run = rig.simulate(scene, 0.3, controllers={"nf": gain})
    np.testing.assert_array_equal(run.commands["nf"].values, own.commands["nf"].values)
    save(run, tmp_path / "run.mcap")
    assert verify(tmp_path / "run.mcap").passed
    recorded = rig.open(tmp_path / "run.mcap")
    assert '"kind": "lti"' in recorded.scene
    assert rig.fork(tmp_path / "run.mcap", 0.2, {}, 0.05).commands["nf"].tick.size == 250


def test_a_file_takes_part_under_the_name_that_is_given(own):
    example = ROOT / "docs" / "example_controller.py"
    run = rig.simulate("belt", 0.1, controllers={"mine": example, "other": Still()})
    assert run.summary["controllers"]["mine"]["updates"] == 100
    assert run.summary["controllers"]["other"]["updates"] == 50
    assert "example_controller.py" in run.scene


class Still:
    """Reads nothing and commands a constant speed."""

    reads, drives, period_ns = (), ("drive.speed",), 2_000_000

    def start(self):
        return None

    def update(self, state, t_ns, values):
        return None, (0.06,)


class TooFew(Still):
    def update(self, state, t_ns, values):
        return None, ()


NAMED = {"inputs": "vibrometer", "outputs": "load_force"}


def system(step, **names):
    return control.ss(0.5, 1.0, 1.0, 0.0, step, **{**NAMED, **names})


@pytest.mark.parametrize(
    ("given", "kind", "told"),
    [
        ({"x": Feedback}, UsageError, r"x: is the class Feedback; give an object of it, Feedback\(\)"),
        ({"x": TooFew()}, UsageError, "expected a tuple with one number for each of drive.speed"),
        ({"nf": "./nf.json"}, UsageError, "nf: ./nf.json is a file, and the scene is loaded already"),
        ({"nf": control.tf([1.0], [1.0, 1.0], **NAMED)}, UsageError, r"nf: is continuous; control.c2d\(system, period"),
        ({"nf": system(1e-3, inputs="laser")}, SceneError, 'reads.1. = "laser": unknown sensor'),
        ({"b": system(1e-3)}, SceneError, "controllers.nf and controllers.b: both drive load.force"),
    ],
)
def test_what_cannot_take_part_is_named_before_the_run(given, kind, told):
    with pytest.raises(RigError, match=told) as refused:
        rig.simulate(rig.load("belt_normal_force"), 0.1, controllers=given)
    assert type(refused.value) is kind


@pytest.mark.parametrize(
    ("given", "told"),
    [
        ("none.py", "controller none: there is no file none.py"),
        ("README.md", r"README.md: no kind of controller reads such a file; its name ends in .py, .*\.json"),
        ("a.b=README.md", "expected FILE, or NAME=FILE"),
    ],
)
def test_a_file_that_is_no_controller_is_named(given, told, monkeypatch):
    monkeypatch.chdir(ROOT)
    with pytest.raises(UsageError) as refused:
        added([given])
    err = str(refused.value)
    assert re.search(told, err)


class Failing(Feedback):
    """A controller whose code fails at 0.1 s."""

    def __init__(self, fault):
        super().__init__()
        self.fault = fault

    def update(self, state, t_ns, values):
        if t_ns == 100_000_000:
            raise self.fault
        return super().update(state, t_ns, values)


@pytest.mark.parametrize("fault", [ZeroDivisionError("of mine"), SystemExit(0), GeneratorExit()])
def test_the_run_up_to_the_fault_of_a_controller_is_kept(own, tmp_path, fault):
    with pytest.raises(ControllerFailed, match=r"controller nf failed at t = 0\.1 s: ") as failed:
        rig.simulate("belt_normal_force", 0.3, controllers={"nf": Failing(fault)})
    run = failed.value.run
    assert failed.value.__cause__ is fault
    assert (run.fault, run.time[-1]) == (str(failed.value), 0.1)
    for name, values in own.signals.items():
        assert run.signals[name].tobytes() == values[: run.time.size].tobytes(), name
    run.save(tmp_path / "run.mcap")
    found = verify(tmp_path / "run.mcap")
    assert found.passed, found.text()
    assert run.fault in found.text()
