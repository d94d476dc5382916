"""A made-up plant on the bus, and what stands in an .rrd file."""

import json
import threading
from collections import defaultdict

import numpy as np
import pytest
from twin import Twin

import rig
from rig.bus import encode, messages
from rig.bus.run_setup import Setup
from rig.scenes.scene import Scene
from rig.solve.records import SLIP_PLUS, STICK

OUTPUTS = {
    "displacement": "m",
    "velocity": "m/s",
    "friction_force": "N",
    "normal_force": "N",
    "surface_speed": "m/s",
}
SENSORS = {"laser": ("m/s", 100_000), "gauge": ("1", 1_000_000)}


@pytest.fixture(scope="session")
def scene():
    """The belt with normal-force feedback, a vibrometer of 10 kHz and a strain gauge of 1e-5 per newton."""
    told = json.loads(rig.load("belt_normal_force").to_json())
    laser = {**told["sensors"]["vibrometer"], "rate": 1e4}
    gauge = {**json.loads(rig.load("pendulum").to_json())["sensors"]["strain_gauge"], "strain_per_newton": 1e-5}
    return Scene.from_json(json.dumps({**told, "sensors": {"laser": laser, "gauge": gauge}}))


def swing(k):
    """The outputs in frame k."""
    return np.array([1e-3 * np.sin(k / 50), 0.02 * np.cos(k / 50), 3.0, 20.0, 0.06])


class Plant:
    """Says on an in-process bus what a plant says: states of 200 Hz, a laser of 10 kHz in blocks, a gauge."""

    def __init__(self, hub, scene):
        self.session = hub.open("plant", "plant")
        self.setup = Setup(hub.run, scene.to_json(), 1_000_000, 100_000, OUTPUTS, SENSORS)
        self._scene = self.session.serve("scene", lambda body: self.setup.to_json())
        self.session.announce()
        self._state = encode.StateEncoder(len(OUTPUTS))
        system = scene.assemble().system()
        self._keys = [system.key([mode], [0], [0] * len(system.limiters)) for mode in (STICK, SLIP_PLUS)]
        self.sent = 0

    def serve(self, seconds=5.0):
        threading.Thread(target=self._scene.poll, args=(seconds,), daemon=True).start()

    def put(self, topic, payload, t_ns):
        self.session.publisher(topic).put(payload, t_ns)
        self.sent += 1

    def speak(self, first, frames):
        """Frames of 1 ms: the mass swings, and sticks in the first half of every second."""
        for k in range(first, first + frames):
            now = k * 1_000_000
            if k % 5 == 0:
                self.put("state", self._state(now, k, self._keys[k % 1000 >= 500], swing(k)), now)
            if k % 20 == 0:
                self.band(k, 20)
                self.put("meas/laser", encode.block(k, now, 100_000, np.full(200, float(k))), now)
            self.put("meas/gauge", encode.block(k, now, 1_000_000, [1e-6 * k]), now)
            self.put("applied/nf", encode.applied(k, now, k - 1, 0, [20.0 + k]), now)
            if k % 100 == 0:
                health = messages.TYPES["Health"](t_ns=now, tick=k, rate=1.0, stick_share=0.5, energy_error=1e-12)
                self.put("health", health.SerializeToString(), now)
        self.session.flush()

    def band(self, first, frames, swing=swing, spread=0.0):
        """The steps of frames, which are spans of their own; `spread`: from their mean to their extremes."""
        steps = np.arange(first + 1, first + frames + 1)
        values = np.array([swing(k) for k in steps])
        keys = np.array([self._keys[int(k % 1000 >= 500)] for k in steps])
        ends, ones = steps * 1_000_000, np.ones(frames, np.int64)
        content = (values - spread, values + spread, ones, keys, 1_000_000, values[:, :2], keys)
        self.put("band", encode.band(first, first * 1_000_000, ends, *content), int(ends[-1]))

    def event(self, kind, text, t_ns=0, **data):
        self.put("event/plant", messages.event(t_ns, 0, "plant", kind, text, data), t_ns)


@pytest.fixture
def hub():
    return Twin("viewed")


@pytest.fixture
def plant(hub, scene):
    return Plant(hub, scene)


@pytest.fixture(scope="module")
def stage(scene):
    """A hub and a plant for all tests of a module."""
    hub = Twin("viewed")
    return hub, Plant(hub, scene)


@pytest.fixture(scope="session")
def contents():
    """What an .rrd file holds: entity -> (sorted times [ns], {component: values by row}); static rows apart."""

    def read(path):
        import rerun.chunk

        moving, static = defaultdict(list), defaultdict(list)
        for chunk in rerun.chunk.RrdReader(path).stream().to_chunks():
            batch = chunk.to_record_batch().to_pydict()
            rows = static if chunk.is_static else moving
            count = chunk.num_rows
            rows[chunk.entity_path] += [{name: column[i] for name, column in batch.items()} for i in range(count)]
        return dict(moving), dict(static)

    return read
