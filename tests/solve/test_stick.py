"""Stick is stick: no creep, no drift, no chatter, and it ends exactly where the limit of static friction is."""

import math

import numpy as np
import pytest

from rig.model import friction_law
from rig.model.assembly import Assembly
from rig.motion.motion import Motion

MILLION = 1_000_000


def test_a_stuck_mass_does_not_creep(rigs):
    """A million ticks under 0.99 of the limit: the slip speed is zero, not small."""
    a = rigs.oscillator(k=0.0, c=40.0 * 0.99, vb=0.1, N=10.0, mus=0.4, start={"x'": 0.1})
    motion = Motion(a.system(), 20_000, "exact", outputs=[{"T:contact": 1.0}], longest=MILLION)
    motion.advance(MILLION)
    assert motion.event_count == 0
    assert np.all(motion.states[:, 1] == 0.1)
    assert motion.states[-1, 0] == pytest.approx(0.1 * 20.0, rel=1e-10)
    assert motion.outputs_now()[0] == pytest.approx(0.99 * 4.0, rel=1e-12)


def test_a_mass_stuck_to_a_moving_belt_goes_with_it(rigs):
    """A belt that swings, below the limit throughout: w stays at rounding for a million ticks."""
    a = rigs.oscillator(belt={"belt": 1.0}, start={})
    amplitude, omega = 0.99 * 4.0 / abs(1000.0 / 50.0 - 50.0), 50.0  # need = (k / omega - m omega) V, without damper
    a.damping["x", "x"] = 0.0
    rigs.sine(a, "belt", amplitude, omega, 0.5 * math.pi)
    a.start |= {"x'": amplitude}
    motion = Motion(a.system(), 100_000, "exact", outputs=[{"w:contact": 1.0}, {"T:contact": 1.0}], longest=MILLION)
    motion.advance(MILLION)
    w, T = motion.outputs_at(motion.states, motion.mode_sets_of_states).T
    assert motion.event_count == 0
    assert np.abs(w).max() < 4e-16 * amplitude * 8
    assert np.abs(T).max() == pytest.approx(0.99 * 4.0, rel=1e-6)


@pytest.mark.parametrize("step", [0.1, 1.0, 7.0])
def test_stick_ends_where_static_friction_does(rigs, run, step):
    found = run(rigs.p1(), step, 0.2, outputs=[{"T:contact": 1.0}])
    assert found.times[0] == pytest.approx((0.4 * 10.0 - 0.6324555320336759 * 0.05) / 1000.0 / 0.05, rel=1e-15)


def test_rest_is_an_answer(rigs, run):
    """A belt at rest: the mass comes to rest off its equilibrium and stays there for ever."""
    found = run(rigs.p1(vb=0.0), 1.0, 4.0)
    assert found.what[-1] == "contact slip ends"
    assert found.states[-1, 1] == 0.0
    assert abs(1000.0 * found.states[-1, 0]) <= 4.0
    assert found.states[-1, 0] != 0.0
    assert np.ptp(found.states[2000:, 0]) == 0.0


def test_half_cycles_of_a_dry_oscillator_lose_the_same_amplitude(rigs, run):
    """Each half cycle takes pi / omega and loses 2 mu N / k, until static friction holds what kinetic would not."""
    system = rigs.p1(c=0.0, vb=0.0, mus=0.45, mud=0.25, start={"x": 0.0288})
    found = run(system, 1.0, 1.0)
    half = math.pi / math.sqrt(1000.0)
    assert found.times == pytest.approx(half * np.arange(1, 6), rel=1e-13)
    assert abs(found.states[-1, 0]) == pytest.approx(0.0288 - 5 * 2.0 * 0.0025, abs=1e-15)
    assert system.describe(found.motion.key) == "contact stick"


def test_static_and_kinetic_friction_alike_do_not_chatter(rigs, run):
    """mu_s = mu_d: release and landing are smooth, g' = 0 at both; still two events a period."""
    found = run(rigs.p1(mus=0.25, mud=0.25, start={"x": 0.01, "x'": 0.0}), 1.0, 4.0)
    assert len(found.times) < 60
    assert abs(found.energy["error"]) < 1e-10


def test_equal_contacts_are_one_patch(run):
    """Two normal forces on one sliding row share one friction mode: the same events as one contact with their sum."""

    def pad(loads):
        a = Assembly("pad")
        a.coordinate("x", 1.0, 0.6, 1000.0)
        a.patch("pad", {"x": 1.0}, {"one": 0.05}, friction_law.coulomb(0.4, 0.25))
        for i, load in enumerate(loads):
            a.normal(f"contact {i}", "pad", {"one": load})
        a.start |= {"x'": 0.05}
        return a.system()

    one, two = run(pad([10.0]), 1.0, 2.0), run(pad([3.0, 7.0]), 1.0, 2.0)
    assert two.times == pytest.approx(one.times, abs=1e-14)
    assert two.what == one.what
