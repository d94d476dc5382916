"""The plant's end of the bus, for a controller that is tested as a process."""

from pathlib import Path

import numpy as np

from rig import controllers
from rig.bus import encode, messages
from rig.bus.run_setup import Setup
from rig.controllers.normal_force import NormalForce

ROOT = Path(__file__).parents[2]
FRAME = 1_000_000


def section(**given):
    return NormalForce(**{"kind": "normal_force", "sensor": "vibrometer", "gain": 200.0, "nominal": 20.0} | given)


def described(**given):
    """A stand with two sensors and one controller that reads the second."""
    return Setup(
        run="twin",
        scene='{"clock": {"hold_frames": 50}}',
        frame_ns=FRAME,
        step_ns=FRAME,
        outputs={},
        sensors={"disc": ("rad/s", FRAME), "vibrometer": ("m/s", FRAME)},
        controllers={"feedback": controllers.described(section(**given), {})},
    )


class Plant:
    """The plant's end: sends steps, gets answers."""

    def __init__(self, session):
        self.session = session
        self.acts = session.subscribe("act/*")
        self.events = session.subscribe("event/*")
        self.watch = session.watch("controller/*")
        self.step = session.publisher("step")

    def send(self, tick, v, t_ns=None):
        t_ns = tick * FRAME if t_ns is None else t_ns
        self.step.put(encode.step(tick, t_ns, [0.3, v], np.ones(2, dtype=np.int64)), t_ns)

    def answer(self, timeout=5.0):
        message = self.acts.get(timeout)
        return messages.decode(message.topic, message.payload) if message is not None else None

    def event(self, timeout=5.0):
        message = self.events.get(timeout)
        return messages.decode(message.topic, message.payload)
