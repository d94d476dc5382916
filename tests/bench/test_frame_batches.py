"""Frames in one piece: as far as nobody listens, and the same bits as one by one."""

import json

import numpy as np
import pytest

from rig import scenes
from rig.bench.run.runner import PlantRunner
from rig.bench.run.simulate import simulate
from rig.scenes.scene import Scene

SCENE = "belt_normal_force"
MS = 1_000_000


@pytest.fixture(scope="module")
def scene():
    return scenes.load(SCENE, {"sensors.vibrometer.rate": "5 kHz"})


def carried(scene, piece):
    runner = PlantRunner(scene, truthful=True)
    while runner.tick < 3000:
        runner.frames(min(piece, 3000 - runner.tick))
    runner.hand_over(runner.truth)
    return runner


def test_a_piece_is_its_frames_one_by_one(scene):
    whole, single = carried(scene, 3000), carried(scene, 1)
    for one, other in zip(whole.truth.outputs(), single.truth.outputs()):
        assert one.tobytes() == other.tobytes()
    events = whole.truth.events()
    assert events == single.truth.events()
    assert len(events) > 10
    known = single.measurements.samples()
    for name, found in whole.measurements.samples().items():
        assert found.t_ns.tobytes() == known[name].t_ns.tobytes()
        assert found.v.tobytes() == known[name].v.tobytes()
    assert whole.motion.energy() == single.motion.energy()
    assert whole.bank.counters() == single.bank.counters()


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


def between(scene):
    """A run in which the controller is connected for the second of three tenths of a second."""
    raw = json.loads(scene.to_json())
    hold, name = {"step": "hold", "time": 0.1}, "nf"
    raw["protocol"] = [
        hold,
        {"step": "connect", "controller": name},
        hold,
        {"step": "disconnect", "controller": name},
        hold,
    ]
    return Scene.from_json(json.dumps(raw))


def test_who_is_not_connected_hears_the_same(scene):
    listener = Listener()
    run = simulate(between(scene), {"nf": listener})
    assert [state for state, *_ in listener.told] == list(range(300))
    assert [t_ns for _, t_ns, _ in listener.told] == list(range(0, 300 * MS, MS))
    assert [values for *_, values in listener.told] == [(v,) for v in run.measurements["vibrometer"].v[:1500:5]]
    assert run.summary["controllers"]["nf"]["updates"] == 300
    assert run.commands["nf"].tick.tolist() == list(range(100, 200))
    assert run.commands["nf"].values[:, 0].tolist() == [20.0 + 1e-3 * state for state in range(100, 200)]


def test_what_a_sensor_showed_is_remembered(scene):
    runner = PlantRunner(scene, truthful=True)
    seen, slow = [], runner.bank.names.index("vibrometer")
    while runner.tick < 40:
        runner.frames(1)
        seen.append((float(runner.bank.latest[slow]), runner.bank.samples(slow).tolist()))
    whole = PlantRunner(scene, truthful=True)
    while whole.tick < 40:
        begun = whole.tick
        whole.frames(40 - whole.tick)
        times = range((begun + 1) * MS, (whole.tick + 1) * MS, MS)
        part = seen[begun : whole.tick]
        assert whole.bank.shown(slow, times) == [last for last, _ in part]
        assert whole.bank.published(slow, times) == [samples for _, samples in part]
    assert np.isfinite(seen[-1][0])
