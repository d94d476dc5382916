"""A stand without physics: what is asked of it is written down."""

from types import SimpleNamespace

import numpy as np
import pytest
from plant_in_thread import SCENE

from rig import scenes
from rig.model.assembly import Input
from rig.units import si

MS = 1_000_000


class FakeStand:
    """One oscillation, four actuators, two sensors; counts frames and notes what is done to it."""

    def __init__(self):
        self.frame_ns = MS
        self.tick = 0
        self.inputs = {
            "drive.speed": Input("m/s", -1.0, 1.0, 0.06, 0.0, state="speed", slope="ramp"),
            "load.force": Input("N", 0.0, 100.0, 20.0, 20.0, state="load", slope="press"),
            "dither.amplitude": Input("m/s", 0.0, 0.5, 0.0, 0.0, state="amplitude"),
            "dither.enable": Input("1", 0.0, 1.0, 0.0, 0.0, state="enable"),
        }
        self.value = {name: one.value for name, one in self.inputs.items()}
        self.bank = SimpleNamespace(
            names=("vibrometer", "laser"), units=("m/s", "m"), latest=np.zeros(2), fresh=np.ones(2, np.int64)
        )
        self.outputs = ("displacement", "velocity")
        self.done = []
        self.parameters = {"friction.mu_static": 0.5}

    @property
    def t_ns(self):
        return self.tick * self.frame_ns

    def apply(self, name, value):
        self.done.append((self.tick, name, value))
        self.value[name] = value

    def ramp(self, name, to, ticks):
        self.done.append((self.tick, name, (to, ticks)))

    def set_parameter(self, key, value):
        if key not in self.parameters:
            raise ValueError(f"{key}: unknown key")
        self.parameters[key] = value
        self.done.append((self.tick, key, value))

    def knock(self, impulse):
        self.done.append((self.tick, "knock", impulse))

    def output(self, name):
        return float(self.bank.latest[self.outputs.index(name) - 1])

    def output_values(self):
        return np.array([self.output(name) for name in self.outputs])

    def frame(self):
        self.tick += 1

    def statistics(self):
        return {"events": 0, "stick_share": 0.0, "energy_error": 0.0}


@pytest.fixture(scope="module")
def scene():
    """The scene of a plant in a thread."""
    si("1 ms", "s")  # loads the units, as the process does before it begins
    return scenes.load(SCENE)


@pytest.fixture
def runner():
    return FakeStand()


@pytest.fixture
def fake():
    """Makes stands, for tests that need several."""
    return FakeStand
