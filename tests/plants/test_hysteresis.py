"""Run-up and run-down: sliding and stick-slip live side by side over a range of belt speeds (Kroeger et al. 2008).

The speed is run up slowly, then stepped, and the state is carried on: a standing start misses the last of it.
"""

import math

import numpy as np
import pytest
from scipy.optimize import brentq

from rig.solve.records import SLIP_PLUS
from rig.stability.linearisation import steady

MOVED = {"drive.speed": "ramped"}
SETTLE = 18_000, 2000  # ticks of 1 ms between two steps of the speed


def lives_up_to(run, alive, limit, within):
    """Whether stick-slip that is carried up in speed, slowly from `alive` on, ends at `limit`."""
    run.run_up(0.06, 0.95 * alive, 0.01 * alive)
    run.run_up(0.95 * alive, alive, 2e-4 * alive)  # in one period the belt must not gain what the cycle has to spare
    run.run_up(alive, limit - within, 1e-5 * alive)
    if not run.sticks(*SETTLE):
        return False
    run.run_up(limit - within, limit + within, 1e-5 * alive)
    return not run.sticks(*SETTLE)


def test_stick_slip_of_characteristic_a_lives_up_to_a_speed(move, kroger):
    run = move("belt", moved=MOVED, duration=1.0)
    assert lives_up_to(run, 0.6745, kroger["A_stick_slip_exists_up_to_v0"], 1e-4)


def test_stick_slip_of_damped_coulomb_friction_lives_up_to_a_speed(move):
    """To where a mass that is let go just reaches the belt's speed again.

    That speed is 0.0779535 m/s; the 0.077828 m/s of the reference is where steps of the speed lose the cycle.
    """

    def spare(speed):
        """Largest speed of the free oscillation after a release, less that of the belt."""
        m, c, d, load = 5.0, 2500.0, 2.0, 20.0
        decay = d / (2.0 * m)
        w = math.sqrt(c / m - decay**2)
        out = (0.4 * load - d * speed) / c - 0.25 * load / c
        side = (speed + decay * out) / w
        t = np.linspace(0.7, 1.0, 200_001) * 2.0 * math.pi / w
        v = (w * side - decay * out) * np.cos(w * t) - (decay * side + w * out) * np.sin(w * t)
        return (np.exp(-decay * t) * v).max() - speed

    limit = brentq(spare, 0.07, 0.09, xtol=1e-12)
    assert limit == pytest.approx(0.0779535, abs=1e-7)
    run = move("belt_c_damped", moved=MOVED, duration=1.0)
    assert lives_up_to(run, 0.0775, limit, 2e-5)


def growth(move, scene, speed):
    system = move(scene, {"drive.speed": speed}).motion.system
    return steady(system, system.key([SLIP_PLUS], [0], [])).eigenvalues()[0].real


def test_sliding_of_characteristic_a_is_stable_above_a_speed(move, kroger):
    limit = kroger["A_linear_stability_v0"]
    assert limit == pytest.approx(0.20794, abs=5e-6)
    assert growth(move, "belt", limit * (1.0 - 1e-7)) > 0.0 > growth(move, "belt", limit * (1.0 + 1e-7))


def test_the_two_motions_live_side_by_side(move):
    """At 0.4 m/s: from the cycle it goes on cycling, from sliding it goes on sliding."""
    cycling, sliding = move("belt", moved=MOVED, duration=1.0), move("belt", {"drive.speed": 0.4}, moved=MOVED)
    cycling.run_up(0.06, 0.4, 0.01)
    assert cycling.sticks(*SETTLE)
    sliding.write("x", 0.0015)
    sliding.write("x'", 0.0)
    sliding.motion.advance(20_000)
    assert not len(sliding.times("contact slip ends"))
    assert np.abs(sliding["velocity"][-2000:]).max() < 0.05 * np.abs(cycling["velocity"]).max()
