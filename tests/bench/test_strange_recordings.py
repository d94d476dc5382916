"""Recordings that no run of this version makes: verify and the fork say in words what is wrong."""

import dataclasses

import numpy as np
import pytest

import rig
from rig.bench.again.fork import fork
from rig.bench.again.verify import verify
from rig.errors import LogError
from rig.record.provenance import provenance
from rig.record.run import Samples
from rig.record.save_run import save


@pytest.fixture(scope="module")
def run():
    found = rig.simulate(rig.load("belt_normal_force", {"controllers.nf.enable_at": "0.1 s"}), 0.5)
    found.provenance |= provenance(0)
    return found


def renamed(found, old, new):
    return {(new if name == old else name): value for name, value in found.items()}


def twice(run):
    t_ns, v = run.measurements["vibrometer"]
    return {**run.measurements, "vibrometer": Samples(np.repeat(t_ns, 2), np.repeat(v, 2))}


DESCRIBED = {
    "an output of another name": (
        lambda run: {"signals": renamed(run.signals, "velocity", "speed")},
        "the output speed is recorded, but the rig of the scene has none of this name here",
    ),
    "a sensor of another name": (
        lambda run: {"measurements": renamed(run.measurements, "vibrometer", "vib")},
        "the sensor vib is recorded, but not in the scene",
    ),
    "no sensor": (lambda run: {"measurements": {}}, "the sensor vibrometer is in the scene, but not recorded"),
    "samples twice": (lambda run: {"measurements": twice(run)}, " samples of vibrometer "),
}


@pytest.mark.parametrize("what", DESCRIBED)
def test_what_does_not_belong_to_the_scene_is_a_fault(run, tmp_path, what):
    change, told = DESCRIBED[what]
    save(dataclasses.replace(run, **change(run)), tmp_path / "run.mcap")
    found = verify(tmp_path / "run.mcap")
    assert any(told in fault for fault in found.faults), found.text()
    with pytest.raises(LogError, match=r"cannot be continued|does not repeat|not certain"):
        fork(tmp_path / "run.mcap", 0.4, duration_ns=10**7)


@pytest.fixture(scope="module")
def limited():
    """A run that a limit has ended."""
    scene = rig.load("belt", {"friction.mu_static": "0.45", "limits.displacement": "1 mm"})
    run = rig.simulate(scene, duration=2.0)
    assert "is beyond its limit of 0.001 m" in run.summary["ended"]
    return run


def test_a_run_that_a_limit_ended_holds(limited, tmp_path):
    # as a plant process tells it: the summary of a run over the bus names the limit as what stopped the run
    save(dataclasses.replace(limited, fault=limited.summary["ended"]), tmp_path / "limited.mcap")
    found = verify(tmp_path / "limited.mcap")
    assert found.passed, found.text()
    assert found.identical
    assert found.compared > 1000


def test_a_stop_that_does_not_come_again_is_told(limited, tmp_path):
    save(dataclasses.replace(limited, fault="the state is not finite"), tmp_path / "stopped.mcap")
    assert verify(tmp_path / "stopped.mcap").faults == ("the state is not finite",)
