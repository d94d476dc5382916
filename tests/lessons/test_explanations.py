"""What the lessons state as a reason, computed again: the tables on their pages compare results only."""

from dataclasses import replace

import numpy as np
import pytest

import rig
from rig.analysis.cycles.averaged import mean_friction
from rig.analysis.recorded.hysteresis import hysteresis

pytestmark = pytest.mark.slow


def test_a_ramp_leaves_a_weak_cycle_early_and_sliding_late():
    """Lesson 2: the slower the ramps, the nearer are last and first stick to the ends of both states."""
    scene, ends = rig.load("belt_hysteresis"), []
    for slower in (1, 4):
        steps = [
            step.model_copy(update={"over": step.over * slower}) if step.step == "ramp" else step
            for step in scene.protocol
        ]
        found = hysteresis(rig.simulate(replace(scene, protocol=tuple(steps))))
        ends.append((found.up, found.down))
    (up, down), (slow_up, slow_down) = ends
    assert up + 0.01 < slow_up < 0.676
    assert down + 0.002 < slow_down < 0.20795


def amplitude(changes):
    return rig.limit_cycle(rig.load("belt", changes)).amplitude["velocity"]


def test_weak_dither_makes_the_cycle_smaller_where_it_reverses_the_slip():
    """Lesson 5: with the factor I0(a / c) at every slip speed, as if the slip never reversed, it would be larger."""
    p = rig.load("belt").parameters.friction
    law, a = p.friction(), 0.03
    speeds = np.concatenate([np.linspace(0.0, 0.06, 61), np.linspace(0.065, 0.6, 60)])
    mean = np.array([mean_friction(law, w, 1.0, complex(a))[0] for w in speeds])
    above = speeds > a * (1.0 - 1e-9)  # at equal speeds both are equal
    raised = p.mu_dynamic + (p.mu_static - p.mu_dynamic) * np.exp(-speeds / p.speed_scale) * np.i0(a / p.speed_scale)
    assert mean[above] == pytest.approx(raised[above], rel=1e-9)
    assert np.all(mean[~above] < raised[~above])
    table = {"friction.law": "table", "friction.speeds": speeds.tolist()}
    averaged = amplitude(table | {"friction.values": mean.tolist()})
    never = amplitude(table | {"friction.values": raised.tolist()})
    plain = amplitude({})
    assert averaged == pytest.approx(0.0477, rel=0.08)  # simulated: the table of the lesson
    assert averaged < 0.7 * plain
    assert never > plain


def test_resistances_of_the_shunt():
    """Lesson 7: 130 ohm is best for the slowest mode of all; 50 ohm damps the squeal more, also out of tune."""
    scene = rig.load("brake_shunt", {"shunt.connected": True})
    coil = scene.parameters.shunt.inductance

    def rates(R, tuning=1.0):
        changes = {"shunt.connected": True, "shunt.resistance": R, "shunt.inductance": coil * tuning}
        modes = rig.modes(rig.load("brake_shunt", changes)).sliding.modes
        squeal = max(mode.growth for mode in modes if abs(mode.frequency / 3402.1 - 1.0) < 0.03)
        return max(mode.growth for mode in modes), squeal

    found = rig.sweep(scene, "shunt.resistance", np.linspace(100.0, 145.0, 46))
    best = found.axis.values[int(np.argmin(found.largest))]
    assert best == pytest.approx(131.0, abs=2.0)
    assert found.largest.min() == pytest.approx(-2.7, abs=0.05)
    assert rates(50.0)[1] == pytest.approx(-21.6, abs=0.1)
    assert rates(50.0, 1.05)[1] == pytest.approx(-17.7, abs=0.1)
    assert rates(130.0, 1.05)[1] == pytest.approx(-0.74, abs=0.05)
