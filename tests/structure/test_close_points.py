"""Close contact points share the flexibility that open modes lack: attachment vectors describe it, springs do not."""

from dataclasses import replace
from functools import cache

import numpy as np
import pytest
import scipy.sparse.linalg as sl
from disc_with_pads import disc, paired

from rig.structure.basis import Reduction, build
from rig.structure.full import FRICTION

STIFFNESS = 1e11
FRICTION_AT = 0.3
BETA = 0.002 / (np.pi * 3000.0)
"""0.2 % damping at 3 kHz, proportional to frequency [s]."""


@cache
def full_with_24_points():
    """The matrices of the disc with the rows of 24 points, and the numbers of its scene."""
    sides = tuple(paired((3, 4)))
    values = {side.stiffness_key: STIFFNESS for side in sides}
    return replace(disc()[0], contacts=sides), values


def of_full_matrices(shift):
    """The eigenvalue of the full matrices next to a complex number [rad/s], by inverse iteration."""
    full, values = full_with_24_points()
    mass, _, stiffness = full.pencil(values | {FRICTION: FRICTION_AT})
    damping = BETA * full.matrix("stiffness", values)
    inverse = sl.splu((shift**2 * mass + shift * damping + stiffness).tocsc())
    x = np.random.default_rng(1).standard_normal(full.rows).astype(complex)
    y = np.zeros_like(x)  # the velocity
    for _ in range(60):
        before = x / np.linalg.norm(x)
        y = y / np.linalg.norm(x)
        # (A - s)^-1 of the state (x, x'): a step towards the nearest eigenvalue
        x = inverse.solve(-(damping @ before + mass @ (y + shift * before)))
        y = before + shift * x
    rate = shift + 1.0 / (before.conj() @ x)
    residual = rate**2 * (mass @ x) + rate * (damping @ x) + stiffness @ x
    assert np.linalg.norm(residual) < 1e-9 * np.linalg.norm(stiffness @ x)
    return rate


def of_basis(contact, residual):
    """The eigenvalue of 40 modes next to that of the full matrices [rad/s]."""
    full, values = full_with_24_points()
    reduced = build(full, Reduction(modes=40, contact=contact, residual=residual, at=values))
    damping = BETA * reduced.model.matrix("stiffness", values)
    rates = reduced.eigenvalues(values | {FRICTION: FRICTION_AT}, damping, "none")[0]
    growing = rates[(rates.real > 500.0) & (rates.imag > 0.0)]
    assert len(growing) == 1
    return growing[0]


@pytest.fixture(scope="module")
def exact():
    return of_full_matrices(900.0 + 2j * np.pi * 5850.0)


def test_the_mode_between_close_points_is_that_of_an_independent_program(exact):
    assert exact.imag / (2.0 * np.pi) == pytest.approx(5847.0, abs=0.5)
    assert exact.real == pytest.approx(933.0, abs=0.5)


@pytest.mark.parametrize("contact", ["open", "closed"])
def test_attachments_give_it_with_open_and_closed_modes(exact, contact):
    rate = of_basis(contact, "attachment")
    assert rate.imag == pytest.approx(exact.imag, rel=1e-4)
    assert rate.real == pytest.approx(exact.real, rel=1e-3)


def test_springs_in_series_put_it_too_low(exact):
    rate = of_basis("open", "spring")
    assert rate.imag / (2.0 * np.pi) == pytest.approx(5662.0, abs=1.0)
    assert rate.real == pytest.approx(973.0, abs=1.0)
    assert rate.imag < 0.97 * exact.imag
