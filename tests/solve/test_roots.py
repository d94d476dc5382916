"""The first fall of a polynomial through zero: found when it is there, never before it, never without one."""

from itertools import pairwise

import numpy as np
import pytest
from hypothesis import assume, given, settings
from hypothesis import strategies as st

from rig.compiled.kernel import kernel
from rig.solve.roots import NONE, WORK_COLUMNS, WORK_ROWS
from rig.solve.roots import first_crossing as inner_first_crossing

GRID = np.linspace(0.0, 1.0, 1001)


@kernel
def first_crossing(c, degree, zero, work):
    return inner_first_crossing(c, degree, zero, work)


def fall(coefficients, zero=0.0):
    c = np.zeros(13)
    c[: len(coefficients)] = coefficients
    return first_crossing(c, len(coefficients) - 1, zero, np.zeros((WORK_ROWS, WORK_COLUMNS)))


def from_roots(roots, sign=1.0):
    """Coefficients, rising powers, of sign * prod (r - u) / r, which is `sign` at u = 0."""
    p = np.polynomial.Polynomial([sign])
    for r in roots:
        p = p * np.polynomial.Polynomial([1.0, -1.0 / r])
    return p.coef


coefficients = st.lists(st.floats(-1.0, 1.0, allow_subnormal=False), min_size=2, max_size=13)


@given(coefficients)
@settings(max_examples=150)
def test_what_is_found_is_a_fall_and_the_first(c):
    assume(c[0] > 1e-6)
    u = fall(c)
    p = np.polynomial.Polynomial(c)
    if u == NONE:
        assert p(GRID).min() > -1e-12
        return
    assert 0.0 <= u <= 1.0
    assert abs(p(u)) < 1e-9
    assert np.all(p(GRID[GRID < u - 1e-9]) > -1e-12)


@given(st.lists(st.floats(0.01, 3.0), min_size=1, max_size=6, unique=True))
@settings(max_examples=150)
def test_the_smallest_root_is_found(roots):
    roots = sorted(roots)
    assume(all(b - a > 1e-3 for a, b in pairwise(roots)))
    assume(abs(roots[0] - 1.0) > 1e-9)
    u = fall(from_roots(roots))
    if roots[0] > 1.0:
        assert u == NONE
    else:
        assert u == pytest.approx(roots[0], abs=1e-12 / np.prod([abs(1.0 - roots[0] / r) for r in roots[1:]]))


@given(st.floats(0.05, 0.95), st.floats(-1e-12, 1e-3))
@settings(max_examples=100)
def test_a_dip_below_zero_is_seen_however_short(at, depth):
    """(u - at)^2 - depth: below zero for 2 sqrt(depth) of the cell; a test at the ends sees nothing."""
    c = [at * at - depth, -2.0 * at, 1.0]
    assume(c[0] > 1e-6)
    u = fall(c)
    if depth > 1e-13:
        assert u == pytest.approx(at - np.sqrt(depth), abs=1e-9)
    elif depth < -1e-13:
        assert u == NONE


@given(st.floats(0.1, 0.9), st.floats(0.1, 10.0))
@settings(max_examples=100)
def test_a_guard_that_starts_at_zero_and_rises_falls_later(root, slope):
    """Just released: u slope (1 - u / root); what fell at u = 0 has been dealt with."""
    assert fall([0.0, slope, -slope / root], 1e-14) == pytest.approx(root, abs=1e-14)
    assert fall([1e-15, slope, -slope / root], 1e-14) == pytest.approx(root, abs=1e-13)
    assert fall([-1e-15, slope, slope], 1e-14) == NONE


@pytest.mark.parametrize(
    ("coefficients", "zero", "at"),
    [
        ([0.25, -1.0, 1.0], 0.0, 0.5),  # touching zero is a fall
        ([0.0, -1.0, 0.3], 1e-14, 0.0),
        ([0.0, 0.0, -1.0], 1e-14, 0.0),
        ([-0.1, 1.0], 1e-14, 0.0),
        ([5e-18, 4e-22, -1e-25, -1e-27], 1e-15, NONE),  # all of it within rounding: the next cell decides
        ([0.0, 0.0, 0.0, -1e-27], 1e-15, NONE),
        ([1.0, 0.0], 0.0, NONE),
        ([1e-300, 0.0, 0.0], 0.0, NONE),
    ],
)
def test_what_falls_where(coefficients, zero, at):
    assert fall(coefficients, zero) == pytest.approx(at, abs=1e-7)


@pytest.mark.parametrize("slope", [-1e-11, -1e-14, 0.0, 1e-14])
def test_a_guard_that_starts_at_zero_and_rises_is_not_held_up_by_a_rounded_slope(slope):
    """A contact just released: slip speed and acceleration are rounding, what comes after them is not."""
    assert fall([-1e-20, slope, 1.0], zero=1e-19) == NONE
    assert fall([-1e-20, slope, -1.0], zero=1e-19) == 0.0
    assert fall([0.0, -1e-3, 1.0], zero=1e-19) == 0.0  # that is a fall
