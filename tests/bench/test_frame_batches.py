"""Frames in one piece, as far as nobody listens, have the samples and events of frames one by one, bit for bit."""

import json
from pathlib import Path

import numpy as np
import pytest

import rig
from rig.bench.run.runner import PlantRunner
from rig.bench.run.simulate import simulate
from rig.motion import motion
from rig.scenes.scene import Scene
from rig.solve.sampling import GATHERED

MS = 1_000_000
P1 = Path(__file__).parents[1] / "problems" / "p1.toml"
FAST = {"sensors.vibrometer.rate": "5 kHz"}
# scene, changes, frames
SCENES = {
    "belt_normal_force": (FAST, 3000),
    "belt": (
        {"sensors.vibrometer.rate": 10e3,
         "sensors.laser.rate": 937.0,  # delayed, a mean over uneven intervals
         "sensors.accelerometer.rate": 333.0,
         "sensors.strain.kind": "strain_gauge",
         "sensors.strain.rate": 1000.0},
        10 * GATHERED + 3,
    ),
    "brake_shunt": (  # echoes
        {"sensors.microphone.kind": "microphone", "sensors.microphone.rate": 44.1e3}, 10 * GATHERED + 3
    ),
    "plate": ({}, 10 * GATHERED + 3),  # fixed steps, many states
    str(P1): ({"clock.events_per_frame": 4}, 4000),
}  # fmt: skip


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


class Listener:
    """Commands the load of the scene and writes down what it is told."""

    reads, drives, period_ns = ("vibrometer",), ("load.force",), MS

    def __init__(self, every_sample=False):
        self.every_sample, self.told = every_sample, []

    def start(self):
        return 0

    def update(self, state, t_ns, values):
        self.told.append((state, t_ns, values))
        return state + 1, (20.0 + 1e-3 * state,)


@pytest.mark.parametrize("every_sample", [False, True])
def test_who_is_not_connected_hears_the_same(every_sample):
    """The controller is connected for the second of three tenths of a second."""
    raw, hold = json.loads(rig.load("belt_normal_force", FAST).to_json()), {"step": "hold", "time": 0.1}
    on, off = ({"step": step, "controller": "nf"} for step in ("connect", "disconnect"))
    listener = Listener(every_sample)
    run = simulate(Scene.from_json(json.dumps(raw | {"protocol": [hold, on, hold, off, hold]})), {"nf": listener})
    v = run.measurements["vibrometer"].v
    assert [state for state, *_ in listener.told] == list(range(300))
    assert [t_ns for _, t_ns, _ in listener.told] == list(range(0, 300 * MS, MS))
    if every_sample:
        heard = [list(samples) for *_, (samples,) in listener.told]
        assert [len(samples) for samples in heard] == [1] + 299 * [5]
        assert [sample for samples in heard for sample in samples] == v[: 1 + 299 * 5].tolist()
    else:
        assert [values for *_, values in listener.told] == [(sample,) for sample in v[:1500:5]]
    assert run.summary["controllers"]["nf"]["updates"] == 300
    assert run.commands["nf"].tick.tolist() == list(range(100, 200))
    assert run.commands["nf"].values[:, 0].tolist() == [20.0 + 1e-3 * state for state in range(100, 200)]
