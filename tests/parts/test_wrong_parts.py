"""Parts from files that are wrong: each is refused with its file and what is wrong, before or as the rig begins.

The parts are two masses with two contacts, an effect with a state, a sensor with a filter and a controller with a
design step. None of them is a part of the documentation.
"""

import re
import shutil
from pathlib import Path

import pytest

import rig as lab
from rig.bench.live.outcome import Job
from rig.bench.live.rehearsal import visited
from rig.controllers.runtime.file import load_file
from rig.errors import PartError, SceneError, UsageError

TOYS = Path(__file__).parent / "two_masses"
COUPLING = '    coupling: quantity("N/m") = 500.0'
X_LEFT = 'Output({"l": 1.0}, "m")'
COMMAND = "return y, (min(max(f, 0.0), 100.0),)"
WIRED = "self.reads, self.drives, self.period_ns = (section.sensor,), (section.drive,), section.period"


@pytest.fixture
def toys(tmp_path):
    """A folder with the four parts and their scene; its name has a blank and an umlaut."""
    folder = tmp_path / "zwei Körper"
    shutil.copytree(TOYS, folder, ignore=shutil.ignore_patterns("__pycache__"))
    return folder


def changed(folder, file, old, new):
    """Change a file of a folder; its scene."""
    path = folder / file
    text = path.read_text()
    assert old in text
    path.write_text(text.replace(old, new))
    return folder / "scene.toml"


def test_they_are_right_as_they_are(toys):
    run = lab.simulate(lab.load(toys / "scene.toml"), 0.5)
    assert set(run.measurements) == {"v", "coil"}
    assert len(run.commands["lead"].values) == 500
    assert abs(run.energy["error"]) < 1e-9


BACK, CLASS = "    return a\n", "class Mass("


@pytest.mark.parametrize(
    ("file", "old", "new", "told"),
    [
        ("twin.py", BACK, "    return None\n", r" twin.py: assemble gives NoneType; expected a rig.model"),
        ("twin.py", CLASS, f"import sys\nsys.exit(3)\n{CLASS}", r"plant: .*SystemExit: 3 \(line \d+\)"),
        ("twin.py", COUPLING, f"{COUPLING}\n    clock: quantity('s') = 1.0", "Parameters declares clock, which every"),
        ("twin.py", X_LEFT, 'Output({"zz": 1.0}, "m")', "twin.py: output 'x_left' names 'zz', which does not exist"),
        (
            "twin.py",
            BACK,
            "    return Assembly(title='nothing')\n",
            "twin.py: the rig has no coordinate; expected one at",
        ),
        ("twin.py", 'a.coordinate("r"', 'a.coordinate("l"', r"the rig has a state 'l' already.* \(line \d+\)"),
        ("eddy.py", "section, frame, moved)", "section, frame)", r"eddy.py: TypeError: add\(\) takes 3 positional"),
        ("eddy.py", '"eddy_force"', '"v_left"', "eddy.py: the rig has an output 'v_left' already"),
        ("twin.py", '"x_left"', '"x/left"', "twin.py: output: 'x/left' cannot be recorded; expected 1 to 64 letters"),
        ("twin.py", COUPLING, f"{COUPLING}\n    import math", r"twin\.py: math in a class of values has no type"),
        ("coil.py", "return self.gain_at", "return 'loud'", r"coil\.py: TypeError: .* \(line \d+\)"),
        ("scene.toml", '"eddy.py"', '"drive"', "eddy.effect: drive does not act on any plant; plants that have this"),
        (
            "coil.py",
            "return self.gain_at",
            'return float("nan")',
            r"coil.py: flawed\(\) \(line \d+\): gain is nan; exp",
        ),
    ],
)
def test_what_is_wrong_is_a_fault_of_the_scene(toys, file, old, new, told):
    scene = changed(toys, file, old, new)
    with pytest.raises(SceneError) as caught:
        lab.load(scene)
    assert re.search(told, str(caught.value)), caught.value


DESIGN = "        return rig.comm"


@pytest.mark.parametrize(
    ("old", "new", "told"),
    [
        (WIRED, f"{WIRED}; 1 / 0", r"lead.py: ZeroDivisionError: division by zero \(line \d+\)"),
        (WIRED, WIRED.replace("section.sensor", "'nope'"), "Controller.reads has nope; the sensors are v, coil"),
        (COMMAND, "return y, (f, f)", r"Controller.update commands .*expected a tuple with one number for each"),
        (DESIGN, f"        raise ValueError('sensor: deaf')\n{DESIGN}", r"lead\.sensor: deaf"),
    ],
)
def test_what_is_wrong_with_a_designed_controller_is_told_as_the_run_begins(toys, old, new, told):
    scene = lab.load(changed(toys, "lead.py", old, new))
    with pytest.raises(SceneError) as caught:
        lab.simulate(scene, 0.1)
    assert re.search(told, str(caught.value)), caught.value


def test_a_plant_that_takes_no_moved_actuators_is_told_where_some_move(toys):
    changed(toys, "twin.py", "moved = moved or {}", "moved = {}")
    scene = lab.load(changed(toys, "twin.py", "(p, moved=None)", "(p)"))
    with pytest.raises(PartError, match=r"twin\.py: TypeError: assemble\(\) takes 1 positional argument but 2"):
        lab.simulate(scene, 0.1)


@pytest.mark.parametrize(
    ("old", "new", "told"),
    [
        (
            "return Linear(1, step, ",
            "return (1, step, ",
            r"lead.py: linear gives \(1, <function .*; expected a rig.contr",
        ),
        (
            WIRED,
            WIRED.replace("(section.sensor,)", '(section.sensor, "coil")'),
            "lead.reads: v, coil; a linear form needs",
        ),
    ],
)
def test_what_is_wrong_with_a_linear_form_is_told(toys, old, new, told):
    scene = lab.load(changed(toys, "lead.py", old, new))
    with pytest.raises(SceneError, match=told):
        lab.loop(scene, "lead")


def test_a_controller_that_fails_late_does_not_keep_a_paced_run_from_beginning(toys):
    """Its own process says so; the rehearsal in the process of the plant goes on without it."""
    scene = lab.load(changed(toys, "lead.py", COMMAND, f"assert t_ns < 20_000_000\n        {COMMAND}"))
    assert visited(scene, Job(scene.to_json(), duration=0.1))


def test_a_controller_on_its_own_is_checked_alike_and_needs_defaults(toys):
    (toys / "own.py").write_text("import sys\nsys.exit(2)\n")
    for name, told in (("own", r"own\.py: SystemExit: 2 \(line 2\)"), ("lead", r"lead\.py: Lead\.sensor: is missing")):
        with pytest.raises(UsageError, match=told):
            load_file(toys / f"{name}.py")
