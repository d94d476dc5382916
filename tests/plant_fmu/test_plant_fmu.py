"""A scene as an FMU: validated and driven by fmpy, with the bits of a run in this process; bounded whatever happens."""

import os
import shutil
import socket
import struct
import subprocess
import sys
import threading
import time
from pathlib import Path

import numpy as np
import pytest

from rig import scenes
from rig.bench.run.simulate import simulate
from rig.errors import UsageError
from rig.plant_fmu import child
from rig.plant_fmu.export import export

pytest.importorskip("fmpy", reason="fmpy is not installed")
from fmpy import extract, read_model_description
from fmpy.fmi1 import FMICallException
from fmpy.fmi2 import FMU2Slave, fmi2CallbackFunctions, fmi2CallbackLoggerTYPE
from fmpy.validation import validate_fmu

pytestmark = pytest.mark.skipif(shutil.which("gcc") is None, reason="gcc is not installed: no FMU can be made")
FAKE = """#!{python} -IS
import os, socket, struct, sys, time
link = socket.socket(fileno=3)
for k in range(2):
    link.recv({request}, socket.MSG_WAITALL)
    if k == 1:
        {fault}
    link.sendall(struct.pack("{results}d512s", 0.0, *[1.0] * {count}, b""))
link.recv(1)
"""


class Importer:
    """An FMU in fmpy, as another program uses it; `said` is its log."""

    def __init__(self, path, folder, begin=True, **parameters):
        self.description = read_model_description(str(path))
        self.at = {one.name: one.valueReference for one in self.description.modelVariables}
        self.said = []
        callbacks = fmi2CallbackFunctions()
        callbacks.logger = fmi2CallbackLoggerTYPE(lambda _, name, status, category, said: self._log(said))
        self.unit = FMU2Slave(
            guid=self.description.guid,
            modelIdentifier=self.description.coSimulation.modelIdentifier,
            unzipDirectory=extract(str(path), unzipdir=str(folder)),
            instanceName="plant",
        )
        from fmpy.logging import addLoggerProxy

        addLoggerProxy(__import__("ctypes").byref(callbacks))
        self.unit.instantiate(callbacks=callbacks, loggingOn=True)
        if begin:
            self.begin(**parameters)

    def _log(self, said):
        self.said.append(said.decode())

    def begin(self, start=0.0, **parameters):
        self.unit.setupExperiment(startTime=start)
        for name, value in parameters.items():
            kind = {str: self.unit.setString, int: self.unit.setInteger, float: self.unit.setReal}[type(value)]
            kind([self.at[name]], [value])
        self.unit.enterInitializationMode()
        self.unit.exitInitializationMode()

    def __getitem__(self, name):
        return self.unit.getReal([self.at[name]])[0]

    def __setitem__(self, name, value):
        self.unit.setReal([self.at[name]], [value])


@pytest.fixture(scope="module")
def path(tmp_path_factory):
    path = tmp_path_factory.mktemp("fmu") / "plant.fmu"
    export(scenes.load("belt"), path)
    return path


@pytest.fixture(scope="module")
def plant(path, tmp_path_factory):
    """The belt in fmpy, started once."""
    found = Importer(path, tmp_path_factory.mktemp("folder with spaces % 20"), timeout=120.0)
    yield found
    found.unit.freeInstance()


def children():
    """Processes that this one has started."""
    return children_of(os.getpid())


def children_of(pid):
    """Processes that the main thread of another one has started."""
    return {int(one) for one in Path(f"/proc/{pid}/task/{pid}/children").read_text().split()}


def test_it_is_valid_and_has_units(path):
    assert validate_fmu(str(path)) == []
    description = read_model_description(str(path))
    units = {one.name: one.baseUnit for one in description.unitDefinitions}
    load = next(one for one in description.modelVariables if one.name == "load.force")
    assert (load.causality, load.start, load.unit) == ("input", "20.0", "N")
    assert (units["N"].kg, units["N"].m, units["N"].s) == (1, 1, -2)
    names = [one.name for one in description.modelVariables if one.causality == "output"]
    assert names[:2] == ["sensors.vibrometer", "sensors.laser"]
    assert "outputs.slip_speed" in names
    assert "Needed: a Python with friction-rig" in description.description


def test_its_closed_loop_is_that_of_a_run_in_one_process(plant):
    changes = {
        "controllers.nf.kind": "normal_force",
        "controllers.nf.sensor": "vibrometer",
        "controllers.nf.gain": 200.0,
        "controllers.nf.nominal": 20.0,
    }
    run = simulate(scenes.load("belt", changes), duration_ns=500_000_000)
    plant.unit.reset()
    plant.begin()
    seen = []
    for k in range(500):
        v = plant["sensors.vibrometer"]
        seen.append((v, plant["outputs.velocity"]))
        plant["load.force"] = min(max(20.0 - 200.0 * v, 0.0), 100.0)
        plant.unit.doStep(k * 1e-3, 1e-3)
    measured = run.measurements["vibrometer"]
    wanted = measured.v[np.searchsorted(measured.t_ns, np.arange(500) * 1_000_000, "right") - 1]
    seen = np.array(seen)
    assert np.ptp(wanted) > 0.05
    assert np.abs(seen[:, 0] - wanted).max() <= 1e-12
    assert np.abs(seen[:, 1] - run.signals["velocity"][:500]).max() <= 1e-12


def test_a_reset_a_seed_a_start_time_and_longer_steps(plant):
    def carried(start, frames, **parameters):
        plant.unit.reset()
        plant.begin(start=start, **parameters)
        plant["load.force"] = 30.0
        for k in range(0, 100, frames):
            plant.unit.doStep(start + k * 1e-3, frames * 1e-3)
        return plant["sensors.vibrometer"], plant["outputs.normal_force"]

    first = carried(0.0, 1, seed=1)
    assert first[1] == pytest.approx(30.0)
    assert carried(0.0, 1, seed=1) == first
    assert carried(5.0, 1, seed=1) == first
    assert carried(0.0, 20, seed=1) == first  # the value stays in force for the whole step
    assert carried(0.0, 1, seed=2) != first
    plant["load.force"] = 40.0
    plant.unit.doStep(0.1, 0.2)  # longer than a command is held in a live run
    assert plant["outputs.normal_force"] == pytest.approx(40.0)


def test_an_input_that_is_never_set_belongs_to_the_protocol(tmp_path, monkeypatch):
    protocol = (
        'format = 1\nbased_on = "belt"\n[[protocol]]\nstep = "load"\nforce = "35 N"\n'
        '[[protocol]]\nstep = "hold"\ntime = 1\n'
    )
    (tmp_path / "scene.toml").write_text(protocol)
    plant = child.Plant(scenes.load(tmp_path / "scene.toml"), ["load.force", "drive.speed"])
    nothing = float("nan")
    plant.start(0, 0.0)
    plant.step(0.0, 0.01, (nothing, nothing))
    names = [*plant.rig.runner.bank.names, *plant.rig.runner.outputs]

    def force():
        return plant.results()[names.index("normal_force", len(plant.rig.runner.bank.names))]

    assert force() == pytest.approx(35.0)
    plant.step(0.01, 0.01, (25.0, nothing))
    assert force() == pytest.approx(25.0)
    plant.step(0.02, 5.0, (25.0, nothing))  # after the end of the protocol
    assert force() == pytest.approx(25.0)


def test_steps_that_the_rig_cannot_make_are_errors_that_say_why(plant):
    plant.unit.reset()
    plant.begin()
    for t, h, told in (
        (0.0, 0.0007, "a step of 0.0007 s is not a whole number of frames of 0.001 s"),
        (0.0, float("nan"), "a step of nan s from t = 0 s is not possible"),
        (float("inf"), 0.001, "from t = inf s is not possible"),
        (0.5, 0.001, "the step begins at t = 0.5 s, but the rig is at t = 0 s"),
    ):
        with pytest.raises(FMICallException, match=r"status 3 \(error\)"):
            plant.unit.doStep(t, h)
        assert told in plant.said[-1]
    plant.unit.doStep(0.0, 0.001)


@pytest.mark.parametrize("value", [float("nan"), -float("inf")])
def test_an_input_that_is_not_finite_is_an_error_and_the_value_before_it_stays(plant, value):
    plant.unit.reset()
    plant.begin()
    plant["load.force"] = 25.0
    for name, told in (
        ("load.force", f"the input load.force was set to {value:g}"),
        ("timeout", "the timeout is above"),
    ):
        before = plant[name]
        with pytest.raises(FMICallException, match=r"status 3 \(error\)"):
            plant[name] = value
        assert told in plant.said[-1]
        assert plant[name] == before
    plant.unit.doStep(0.0, 1e-3)
    assert plant["outputs.normal_force"] == pytest.approx(25.0)


def fake(folder, path, fault):
    """A child that answers once, and then does `fault`."""
    description = read_model_description(str(path))
    inputs, results = (sum(one.causality == kind for one in description.modelVariables) for kind in ("input", "output"))
    script = folder / "python"
    text = FAKE.format(python=sys.executable, request=8 * (3 + inputs), results=1 + results, count=results, fault=fault)
    script.write_text(text)
    script.chmod(0o755)
    return str(script)


@pytest.mark.parametrize(
    ("fault", "told"),
    [
        ("time.sleep(60)", "the rig did not answer within 0.3 s in the step from t = 0 s; its process"),
        ("os.kill(os.getpid(), 9)", "was ended by signal 9 in the step from t = 0 s"),
    ],
)
def test_a_child_that_hangs_or_ends_is_an_error_within_a_bounded_time_and_leaves_no_process(
    path, tmp_path, fault, told
):
    before = children()
    plant = Importer(path, tmp_path / "unit", python=fake(tmp_path, path, fault), timeout=30.0)
    (pid,) = children() - before
    assert os.getsid(pid) == pid  # Ctrl-C in a terminal reaches only the importing program
    assert plant["sensors.laser"] == 1.0
    plant["timeout"] = 0.3
    for words in (told, "the rig is not running"):
        with pytest.raises(FMICallException):
            plant.unit.doStep(0.0, 1e-3)  # else it would take 60 s
        assert words in plant.said[-1]
    assert children() <= before
    plant.unit.freeInstance()


@pytest.mark.parametrize(
    ("scene", "request_", "told"),
    [
        (scenes.load("belt").to_json(), 1.0, b"the rig has not been initialised"),
        ('{"format": 99, "name": "x"}', 0.0, b"install a newer version of friction-rig"),
    ],
)
def test_the_child_answers_what_it_cannot_do_and_ends_with_the_other_end(scene, request_, told):
    ours, theirs = socket.socketpair()
    thread = threading.Thread(target=child.serve, args=(theirs, scene, ["load.force"], 10))
    thread.start()
    ours.sendall(struct.pack("=4d", request_, 0.0, 0.0, 20.0))
    status, *_, text = struct.unpack("=11d512s", ours.recv(8 * 11 + 512, socket.MSG_WAITALL))
    assert status == 1.0
    assert told in text
    ours.close()
    thread.join(20.0)
    assert not thread.is_alive()
    theirs.close()


def test_a_child_whose_parent_was_killed_ends_by_itself(path, tmp_path):
    code = (
        "import sys; from fmpy import extract, read_model_description as read; from fmpy.fmi2 import FMU2Slave\n"
        f"d = read({str(path)!r}); f = FMU2Slave(guid=d.guid, modelIdentifier=d.coSimulation.modelIdentifier, "
        f"unzipDirectory=extract({str(path)!r}, unzipdir={str(tmp_path / 'unit')!r}), instanceName='plant')\n"
        f"f.instantiate(); f.setString([0], [{fake(tmp_path, path, 'pass')!r}]); f.setupExperiment()\n"
        "f.enterInitializationMode(); sys.stdout.write('begun\\n'); sys.stdout.flush(); sys.stdin.read()\n"
    )
    with subprocess.Popen([sys.executable, "-c", code], stdin=subprocess.PIPE, stdout=subprocess.PIPE) as importer:
        assert importer.stdout.readline() == b"begun\n"
        (pid,) = children_of(importer.pid)
        importer.kill()
    until = time.monotonic() + 20.0
    while os.path.exists(f"/proc/{pid}") and time.monotonic() < until:
        time.sleep(0.01)
    assert not os.path.exists(f"/proc/{pid}")


def test_inputs_that_are_not_possible_and_a_missing_compiler_are_named(tmp_path, monkeypatch):
    belt = scenes.load("belt")
    with pytest.raises(UsageError, match=r"load: there is no such actuator; belt has drive.speed, load.force"):
        export(belt, tmp_path / "some.fmu", ["load"])
    with pytest.raises(UsageError, match=r"dither.frequency: each value needs new matrices; belt_dither has "):
        export(scenes.load("belt_dither"), tmp_path / "some.fmu", ["dither.frequency"])
    monkeypatch.setenv("PATH", "")
    with pytest.raises(UsageError, match="neither gcc nor cc is installed"):
        export(belt, tmp_path / "some.fmu")
    assert not list(tmp_path.iterdir())


def test_the_command_writes_it_and_does_not_overwrite(rig, tmp_path):
    file = tmp_path / "plant.fmu"
    code, out, _ = rig("fmu", "belt", "--out", file, "--input", "load.force")
    assert code == 0
    assert "inputs   load.force [N]" in out
    code, _, err = rig("fmu", "belt", "--out", file)
    assert code == 2
    assert "--force" in err
