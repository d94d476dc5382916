"""Propagators against longer arithmetic, also where they are hard: stiff, defective, badly scaled, constant."""

import numpy as np
import pytest
import scipy.linalg
from hypothesis import given, settings
from hypothesis import strategies as st

from rig.solve import expm


def exponential(A):
    """exp(A) by scaling and squaring of a Taylor series in the longest arithmetic at hand; scipy's errs by 6e-14."""
    A = A.astype(np.longdouble)
    squarings = max(0, int(np.ceil(np.log2(max(float(np.abs(A).sum(axis=0).max()), 1e-300)))) + 8)
    term, less_one = np.eye(len(A), dtype=np.longdouble), np.zeros_like(A)
    for k in range(1, 20):
        term = term @ (A / np.longdouble(2.0) ** squarings) / np.longdouble(k)
        less_one += term
    for _ in range(squarings):
        less_one = 2 * less_one + less_one @ less_one
    return less_one + np.eye(len(A))


def relative(ours, reference, scale):
    """Error of exp(A h) in the balanced coordinates, in which its entries are of one size."""
    d = scale
    return np.abs((ours - reference) * d[:, None] / d[None, :]).max() / max(
        1.0, np.abs(reference * d[:, None] / d[None, :]).max()
    )


@given(seed=st.integers(0, 2**32 - 1), n=st.integers(1, 8), size=st.floats(-4.0, 3.0), spread=st.floats(0.0, 3.0))
@settings(max_examples=60)
def test_every_level_of_the_ladder_is_an_exponential(seed, n, size, spread):
    rng = np.random.default_rng(seed)
    scaling = 10.0 ** rng.uniform(-spread, spread, n)
    A = rng.normal(size=(n, n)) * 10.0**size / max(1, n) * scaling[:, None] / scaling[None, :]
    A -= max(0.0, np.linalg.eigvals(A).real.max() * 1e-2) * np.eye(n)
    h = 1e-2
    ladder = expm.ladder(A, h)
    d = expm.balance(A)
    for level, less_one in enumerate(ladder):
        reference = exponential(A * d[:, None] / d[None, :] * h / 2.0**level) * d[None, :] / d[:, None]
        bound = 1e-15 * (1.0 + np.abs(A * d[:, None] / d[None, :]).sum(axis=0).max() * h / 2.0**level)
        assert relative(less_one + np.eye(n), reference, d) < bound


def test_small_steps_keep_what_is_small_beside_one():
    """exp(A h) - 1 at |A| h = 1e-8 is known to rounding of itself, not of one."""
    A = np.array([[0.0, 1.0], [-1.0, 0.0]])
    less_one = expm.ladder(A, 1e-8)[0]
    assert less_one[0, 0] == pytest.approx(-5e-17, rel=1e-12)
    assert less_one[0, 1] == pytest.approx(1e-8, rel=1e-15)


def test_a_ramp_is_a_defective_matrix_and_is_exact():
    """s'' = 0 beside a mass: no eigenvectors, no trouble."""
    A = np.array([[0.0, 1.0, 0.0], [0.0, 0.0, 1.0], [0.0, 0.0, 0.0]])
    less_one = expm.ladder(A, 0.5)[0]
    assert less_one == pytest.approx(np.array([[0.0, 0.5, 0.125], [0.0, 0.0, 0.5], [0.0, 0.0, 0.0]]), abs=1e-17)


def test_a_stiff_network_is_propagated_exactly():
    """R = 1 ohm across 30 nF is settled 600 times over in a step of 20 us; the mechanics beside it must not notice."""
    tau = 30e-9
    A = np.array([[0.0, 1.0, 0.0], [-1e6, -2.0, 1e-3], [0.0, 1e4, -1.0 / tau]])
    less_one = expm.ladder(A, 20e-6)[0]
    d = expm.balance(A)
    reference = scipy.linalg.expm(A * d[:, None] / d[None, :] * 20e-6) * d[None, :] / d[:, None]
    assert less_one + np.eye(3) == pytest.approx(reference, rel=1e-9, abs=1e-15)
    assert abs(less_one[2, 2] + 1.0) < 1e-12
