"""What design can do against stick-slip: speed, damping, load, stiffness, friction curve, each a scene beside `belt`.

Kroeger, Neubauer, Popp (2008), section 4: the first three and the last avoid the limit cycle, less load and more
stiffness reduce its amplitude. Each scene shows both in one run: the rig as it was, then the remedy.
"""

import math

import numpy as np
import pytest
from scipy.optimize import brentq

import rig


@pytest.fixture(scope="module")
def base():
    return rig.limit_cycle("belt")


@pytest.mark.parametrize("remedy", ["speed", "damping", "friction"])
def test_the_limit_cycle_is_gone_and_sliding_is_stable(base, remedy):
    scene = rig.load(f"belt_remedy_{remedy}")
    assert base.found
    assert not rig.limit_cycle(scene).found
    assert rig.modes(scene).sliding.stable


def slope(v):
    """-d mu / dv of characteristic A."""
    return 0.32 / 0.05 * math.exp(-v / 0.05)


def test_more_damping_than_friction_feeds_makes_sliding_stable():
    def growth(damping):
        return rig.modes(rig.load("belt", {"body.damping": damping})).sliding.growth

    assert brentq(growth, 2.0, 60.0) == pytest.approx(20.0 * slope(0.06), rel=1e-9)
    outlived = rig.load("belt", {"body.damping": 40.0})
    assert rig.modes(outlived).sliding.stable
    assert rig.limit_cycle(outlived).found


def test_a_stiffer_spring_reduces_the_limit_cycle_and_not_the_growth(base):
    cycle = rig.limit_cycle("belt_remedy_stiffness")
    assert cycle.found
    assert cycle.amplitude["displacement"] < 0.4 * base.amplitude["displacement"]
    assert cycle.period < 0.5 * base.period
    growths = [rig.modes(name).sliding.growth for name in ("belt", "belt_remedy_stiffness")]
    assert growths[1] == pytest.approx(growths[0], rel=1e-9)


@pytest.mark.parametrize(("remedy", "left"), [("damping", 0.0), ("friction", 0.4), ("load", 0.8), ("stiffness", 0.9)])
def test_a_run_shows_the_cycle_of_the_belt_and_then_what_is_left(base, remedy, left):
    """Velocity, peak to peak: before the change that of the belt scene, at the end at most the share `left`."""
    run = rig.simulate(f"belt_remedy_{remedy}")
    v = run.signals["velocity"]
    before, after = v[(run.time > 3.0) & (run.time < 5.0)], v[run.time > run.time[-1] - 1.0]
    swing = 2.0 * base.amplitude["velocity"]
    assert np.ptp(before) == pytest.approx(swing, rel=1e-3)
    assert np.ptp(after) <= left * swing + 1e-4
