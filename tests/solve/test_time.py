"""Time is a whole number of ticks and a share of one: it does not wear out, and does not depend on how it is cut."""

import math

import numpy as np
import pytest

from rig.model.method import ADAPTIVE
from rig.motion.motion import Motion


def test_event_times_after_a_hundred_thousand_seconds(rigs):
    """The cycle of an undamped oscillator has a closed form; after 4.8e5 periods the events still fall on it."""
    p = {"vb": 0.05, "mus": 0.4, "mud": 0.25}
    a, w = (p["mus"] - p["mud"]) * 10.0 / 1000.0, math.sqrt(1000.0)
    stick = 2.0 * a / p["vb"]
    period = stick + (2.0 * math.pi - 2.0 * math.atan2(a, p["vb"] / w)) / w
    motion = Motion(rigs.p1(c=0.0, **p), 20_000_000, "exact", longest=50_000, with_energy=False)
    for _ in range(100):
        motion.advance(50_000)
    assert motion.tick * motion.integration.step_ns == 100_000 * 1_000_000_000
    last = [e for e in motion.events()[-40:] if e.what == "contact releases +"][-1]
    assert last.tick > 4_999_980
    n = round((last.tick * 0.02 - 0.08) / period)
    # the rounding of a period, 5e-17 s, adds up n times; in whole ticks and a share, so that nothing else is lost
    drift = (last.tick - int(n * period / 0.02)) * 0.02 + last.place * 0.02 - (math.fmod(n * period, 0.02) + 0.08)
    assert abs(drift) < n * 1e-16 + 1e-11


@pytest.mark.parametrize("method", ["exact", "dopri5", "rosenbrock", "rk4"])
def test_a_run_in_pieces_is_the_run_in_one(rigs, method):
    """Exactly, for exact and rk4; dopri5 and rosenbrock cut their steps where a call ends."""
    system = rigs.p1() if method == "exact" else rigs.p2()
    whole = Motion(system, 1_000_000, method, longest=1000)
    whole.advance(1000)
    pieces = Motion(system, 1_000_000, method, longest=1000)
    events = []
    for ticks in (1, 2, 7, 90, 400, 500):
        pieces.advance(ticks)
        events += pieces.events()
    assert pieces.tick == whole.tick == 1000
    assert [e.what for e in events] == [e.what for e in whole.events()]
    times, expected = ([e.tick + e.place for e in found] for found in (events, whole.events()))
    assert times == pytest.approx(expected, abs=1e-9 if method not in ADAPTIVE else 1e-3)
    if method in ADAPTIVE:
        assert pieces.x == pytest.approx(whole.x, abs=1e-7)
    else:
        assert np.array_equal(pieces.x, whole.x)
