"""Stick, energy and scaling of the limit cycles of set PEND; test_cycle compares them with independent integrators.

Kroeger, Neubauer, Popp, Phil. Trans. R. Soc. A 366 (2008) 2025, section 2.
"""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st


def test_the_belt_never_goes_faster_than_the_mass_while_it_sticks(move):
    run = move("belt", step_ms=1.0, duration=5.0)
    stuck = np.abs(run["slip_speed"]) < 1e-12
    assert 0.25 < stuck.mean() < 0.4
    assert np.all(run["velocity"][stuck] == 0.06)
    assert run["velocity"].max() == pytest.approx(0.06, abs=1e-12)
    assert np.all(np.abs(run["friction_force"]) <= 0.5 * 20.0 * (1.0 + 1e-12))


@pytest.mark.parametrize("name", ["A", "B", "C", "C_d2"])
def test_energy_of_a_cycle_closes(move, scenes, name):
    assert abs(move(scenes[name], step_ms=1.0, duration=10.0, tolerance=1e-9).motion.energy()["error"]) < 1e-8


@given(radius=st.floats(0.02, 2.0))
@settings(max_examples=6)
def test_a_pendulum_of_any_radius_is_the_mass_on_the_belt(move, radius):
    """J = m r^2, c r^2, d r^2, v0 / r: the same motion at the contact."""
    m, c, d = 5.0, 2500.0, 2.0
    pendulum = {
        "body.radius": radius,
        "body.inertia": m * radius**2,
        "body.stiffness": c * radius**2,
        "body.damping": d * radius**2,
        "drive.speed": 0.06 / radius,
        "start.velocity": 0.06,
    }
    coulomb = {"friction.law": "coulomb", "friction.mu_static": 0.4, "friction.mu_kinetic": 0.25}
    a = move("pendulum", pendulum | coulomb, duration=3.0)
    b = move("belt_c_damped", duration=3.0)
    for output in ("displacement", "velocity", "acceleration", "friction_force", "normal_force", "slip_speed"):
        assert a[output] == pytest.approx(b[output], abs=1e-9 * np.abs(b[output]).max()), output
    assert a.times("contact releases +") == pytest.approx(b.times("contact releases +"), abs=1e-12)
    assert a["angle"] == pytest.approx(b["displacement"] / radius, abs=1e-11 / radius)
    assert a["disc_speed"] == pytest.approx(0.06 / radius, rel=1e-12)
