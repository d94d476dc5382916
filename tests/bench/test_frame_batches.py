"""Frames in one piece, as far as nobody listens, have the samples and events of frames one by one, bit for bit."""

from pathlib import Path

import numpy as np
import pytest

import rig
from rig.bench.run.runner import PlantRunner
from rig.motion import motion
from rig.solve.sampling import GATHERED

P1 = Path(__file__).parents[1] / "problems" / "p1.toml"
FAST = {"sensors.vibrometer.rate": "5 kHz"}
# scene, changes, frames
SCENES = {
    "belt_normal_force": (FAST, 3000),
    "belt": (
        {
            "sensors.vibrometer.rate": 10e3,
            "sensors.laser.rate": 937.0,  # delayed, a mean over uneven intervals
            "sensors.accelerometer.rate": 333.0,
            "sensors.strain.kind": "strain_gauge",
            "sensors.strain.rate": 1000.0,
        },
        10 * GATHERED + 3,
    ),
    "brake_shunt": (  # echoes
        {"sensors.microphone.kind": "microphone", "sensors.microphone.rate": 44.1e3},
        10 * GATHERED + 3,
    ),
    "plate": ({}, 10 * GATHERED + 3),  # fixed steps, many states
    str(P1): ({"clock.events_per_frame": 4}, 4000),
}


def carried(name, piece):
    changes, frames = SCENES[name]
    runner, calls = PlantRunner(rig.load(name, changes), truthful=True), 0
    while runner.tick < frames:
        runner.frames(min(piece, frames - runner.tick))
        calls += 1
    runner.hand_over(runner.truth)
    return runner, calls


@pytest.mark.parametrize("name", SCENES)
def test_a_piece_is_its_frames_one_by_one(name, monkeypatch):
    single, _ = carried(name, 1)
    events, known = single.truth.events(), single.measurements.samples()
    (small, _), (whole, few) = carried(name, 7), carried(name, 10**9)
    if name == str(P1):
        monkeypatch.setattr(motion, "COLLECTED", 0)  # room for the events of two frames
        crowded, more = carried(name, 10**9)
        assert few < more
        assert len(events) == single.motion.counts()["events"] == 38
        assert crowded.truth.events() == events
    for other in (small, whole):
        for one, column in zip(single.truth.outputs(), other.truth.outputs()):
            assert one.tobytes() == column.tobytes()
        assert other.truth.events() == events
        for sensor, found in other.measurements.samples().items():
            assert len(found.v)
            assert found.t_ns.tobytes() == known[sensor].t_ns.tobytes()
            assert found.v.tobytes() == known[sensor].v.tobytes(), sensor
        assert other.motion.energy() == single.motion.energy()
        assert other.bank.counters() == single.bank.counters()
        assert (other.bank.latest == single.bank.latest).all()
        assert (other.bank.fresh == single.bank.fresh).all() or other is whole
        assert np.array_equal(other.motion.x, single.motion.x)
