"""An event at the very end of a step of rk4 is one event, and the step is one step."""

import numpy as np
import pytest

from rig.model import friction_law
from rig.motion.motion import Motion


def test_events_at_the_ends_of_steps_take_no_time(rigs):
    """A mass slides steadily over sectors whose edges come every tenth step, on the sample."""
    a = rigs.oscillator(c=0.0, start={"x": 0.0025, "x'": 0.0})
    a.signal("turn", {"one": 0.05}, 0.0025, "test")
    law = friction_law.coulomb(0.4, 0.25)
    a.sector(
        "lane",
        "contact",
        {"turn": 1.0, "x": -1.0},
        "turn",
        0.001,
        (0.0, 0.0005),
        (law, friction_law.coulomb(0.3, 0.25)),
    )
    motion = Motion(a.system(), 1_000_000, "rk4", longest=1000)
    motion.advance(995)
    times = np.array([event.tick + event.place for event in motion.events()])
    assert times == pytest.approx(10.0 * np.arange(1, 100), abs=1e-6)
    assert motion.states[-1, 0] == pytest.approx(0.0025, rel=1e-12)
