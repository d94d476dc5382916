"""What verify compares beyond samples: commands with what was sent, events and mode sets on another processor."""

import dataclasses
import os
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

import rig
from rig.bench.again.verify import command_faults, verify
from rig.record.provenance import blas, provenance
from rig.record.save_run import save
from rig.scenes.scene import Scene

PENDULUM = Path(__file__).parents[2] / "recordings" / "golden" / "pendulum.mcap"


@pytest.fixture(scope="module")
def pendulum():
    run = rig.open(PENDULUM)
    assert run.on_bus
    return run, Scene.from_json(run.scene)


def bent(run, column, change):
    """The run with a changed `column` of the commands of its controller."""
    (name, commands), *others = run.commands.items()
    assert not others
    found = getattr(commands, column).copy()
    change(found)
    return dataclasses.replace(run, commands={name: commands._replace(**{column: found})})


def put(at, value):
    return lambda column: column.__setitem__(at, value)


@pytest.mark.parametrize(
    ("column", "change", "told"),
    [
        ("status", put(100, 1), "it has other values than the controller sent for this step"),
        ("status", put(100, 2), "safe values answer no step"),
        ("answered", put(100, 10**9), "before it could arrive"),
        ("answered", lambda column: column.__isub__(300), "the values that the controller sent for this step"),
        ("values", put(400, 19.0), "the values that the controller sent for this step"),
    ],
)
def test_a_live_command_agrees_with_what_its_controller_sent(pendulum, column, change, told):
    run, scene = pendulum
    assert list(command_faults(PENDULUM, run, scene)) == []
    (fault,) = command_faults(PENDULUM, bent(run, column, change), scene)
    assert told in fault
    assert "the command of nf at t = " in fault


@pytest.fixture(scope="module")
def there():
    """A run of another processor, with a protocol and a contact that sticks and slips."""
    run = rig.simulate("pendulum", 3.0)
    run.provenance |= provenance(1) | {"processor": "another processor"}
    return run


def verified(run, path):
    save(run, path)
    return verify(path)


def test_events_are_compared_on_another_processor(there, tmp_path):
    found = verified(there, tmp_path / "run.mcap")
    assert found.passed, found.text()
    assert found.elsewhere == ("processor",)
    assert found.events == sum(event["kind"] in ("step", "mark") for event in there.events)
    i = next(i for i, event in enumerate(there.events) if event["kind"] == "mark")
    for event in ({**there.events[i], "text": "?"}, {**there.events[i], "tick": 3, "t_ns": 3_000_000}):
        events = [*there.events[:i], event, *there.events[i + 1 :]]
        found = verified(dataclasses.replace(there, events=events), tmp_path / "run.mcap")
        assert [fault for fault in found.faults if fault.startswith("event mark differs at t = ")], found.text()


OTHER_KERNELS = """
import sys, rig
from rig.record.provenance import blas
rig.simulate("disc_slider", 0.2).save(sys.argv[1])
print(blas())
"""


def test_with_another_linear_algebra_a_recording_holds_to_the_tolerance(tmp_path):
    """Kernels of OpenBLAS for another processor change the last bits of a modal basis, and so those of the run."""
    here = blas()
    for core in ("Prescott", "Haswell", "ARMV8"):
        log = tmp_path / f"{core}.mcap"
        command = [sys.executable, "-c", OTHER_KERNELS, str(log)]
        done = subprocess.run(command, capture_output=True, text=True, env={**os.environ, "OPENBLAS_CORETYPE": core})
        assert done.returncode == 0, done.stderr
        if done.stdout.strip() != here:
            break
    else:
        pytest.skip(f"{here} has no kernels for other processors")
    found = verify(log)
    assert found.passed, found.text()
    assert found.elsewhere == ("blas",)
    assert found.events > 0


def test_mode_sets_are_compared_on_another_processor_but_for_a_few(there, tmp_path):
    for count, passes in ((1, True), (there.mode.size // 100, False)):
        mode = there.mode.copy()
        mode[1000 : 1000 + count] += 1
        found = verified(dataclasses.replace(there, mode=mode), tmp_path / "run.mcap")
        assert found.passed is passes, found.text()
        assert passes or f"the mode sets of {count} of {mode.size} instants differ (3 are allowed)" in found.faults[0]
        assert passes or "first at t = 1 s" in found.faults[0]
    assert np.ptp(there.mode) > 0
