"""Smoothed friction is there to be seen failing: it creeps, it has no static friction, and finer is no better."""

import math

import numpy as np
import pytest

from rig.model import friction_law
from rig.motion.motion import Motion
from rig.stability.report import stability_report


def test_a_smoothed_law_is_odd_and_its_slope_is_its_slope():
    for law in (
        friction_law.coulomb(0.3, 0.3),
        friction_law.stribeck(0.5, 0.2, 0.05),
        friction_law.falling(0.4, 0.3, 0.05),
    ):
        smooth = friction_law.smoothed(law, 1e-3)
        for v in (1e-5, 5e-4, 3e-3, 0.1):
            assert smooth.mu(v) == pytest.approx(law.mu(v) * math.tanh(v / 1e-3), rel=1e-14)
            assert smooth.mu(-v) == -smooth.mu(v)
            by_difference = (smooth.mu(v + 1e-9) - smooth.mu(v - 1e-9)) / 2e-9
            assert smooth.slope(v) == pytest.approx(by_difference, rel=1e-5, abs=1e-6)
        assert not smooth.sticks


def test_it_creeps_where_it_should_stick(rigs):
    """Under 0.9 of the limit it slips by scale atanh(0.9), as long as it lasts."""
    a = rigs.oscillator(k=0.0, c=40.0 * 0.9, vb=0.1, N=10.0, mus=0.4, mud=0.4, start={"x'": 0.1})
    how = {"smoothing": 1e-4, "tolerance": 1e-9, "longest": 1000}
    motion = Motion(a.system(), 1_000_000, "smooth", outputs=[{"w:contact": 1.0}], **how)
    motion.advance(1000)
    w = motion.outputs_now()[0]
    v = 0.1 - w
    assert motion.event_count == 0
    told = [one.what for one in stability_report(a.system(), "smooth", 1e-3) if one.level == "warning"]
    assert any("smoothed: a stuck contact creeps" in what for what in told)
    assert w == pytest.approx(1e-4 * math.atanh(40.0 * 0.9 * v / 4.0), rel=1e-6)


def test_amplitude_of_a_cycle_stays_wrong(rigs, num):
    """Static friction that leaps has no smooth form: the finer the scale, the nearer the error comes to a sixth.

    The largest value of tanh(u) (mu_d + (mu_s - mu_d) exp(-u / 5)) is 0.34 in place of 0.40.
    """
    motion = Motion(rigs.p1(), 1_000_000, "smooth", smoothing=1e-5, longest=4000, tolerance=1e-6)
    motion.advance(4000)
    x = motion.states[2000:, 0]
    amplitude = 0.5 * (x.max() - x.min())
    assert np.all(np.isfinite(x))
    assert amplitude / num["P1"]["amplitude"] - 1.0 == pytest.approx(-0.16, abs=0.03)
