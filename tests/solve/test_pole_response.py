"""The exact response of one pole, and the filters in modal form."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy import signal

from rig.compiled.kernel import kernel
from rig.sensors.chain import filters
from rig.solve import expm
from rig.solve.expm import COLUMNS, PART, PEEK, POLE, STATE, STEP
from rig.solve.segment_output import DEGREE


@kernel
def weigh(poles, p, at, h):
    expm.pole_weights(poles, p, at, h)


@kernel
def state_after(poles, p, at, coef, j, column, a):
    return expm.state_after(poles, p, at, coef, j, column, DEGREE, a)


def table(pole):
    poles = np.zeros((1, COLUMNS), dtype=complex)
    poles[0, POLE] = pole
    return poles


def integrals(x):
    """integral_0^1 e^{s x} (1-s)^k ds by Gauss-Legendre on panels shorter than 1/|x|, k = 0 .. DEGREE."""
    reach = min(1.0, 45.0 / abs(x.real)) if x.real else 1.0
    node, weight = np.polynomial.legendre.leggauss(12)
    edges = np.linspace(0.0, reach, int(abs(x) * reach) + 8, dtype=np.longdouble)
    s = (0.5 * (edges[1:] + edges[:-1])[:, None] + 0.5 * np.diff(edges)[:, None] * node).ravel()
    w = (0.5 * np.diff(edges)[:, None] * weight).ravel()
    return np.array([np.sum(w * np.exp(s * x) * (1.0 - s) ** k) for k in range(DEGREE + 1)])


@pytest.mark.parametrize("size", [1e-9, 1e-3, 0.999, 1.0, 2.5, 7.999, 8.0, 30.0, 1e4])
@pytest.mark.parametrize("angle", [90.0, 120.0, 180.0])
def test_weights_are_exact_from_1e_minus_9_to_1e4(size, angle):
    x = size * np.exp(1j * np.radians(angle))
    poles = table(x)
    weigh(poles, 0, STEP, 1.0)
    got = poles[0, STEP + 1 : STEP + 2 + DEGREE]
    expected = integrals(x)
    rounding = 2e-14 + 4e-16 * size  # the phase of e^x itself is rounded to eps |x|
    assert np.max(np.abs(got - expected) / np.abs(expected)) < rounding
    assert poles[0, STEP] == pytest.approx(np.exp(x), rel=1e-13, abs=1e-300)


def test_a_pole_at_zero_is_the_plain_integral():
    poles = table(0.0)
    weigh(poles, 0, STEP, 0.5)
    np.testing.assert_allclose(poles[0, STEP + 1 : STEP + 2 + DEGREE], 0.5 / np.arange(1, DEGREE + 2), rtol=1e-15)
    assert poles[0, STEP] == 1.0


@settings(max_examples=60)
@given(
    real=st.floats(-3e4, 0.0),
    imag=st.floats(-3e4, 3e4),
    share=st.floats(0.01, 0.99),
    coef=st.lists(st.floats(-1.0, 1.0), min_size=DEGREE + 1, max_size=DEGREE + 1),
)
def test_two_parts_make_the_whole(real, imag, share, coef):
    h, y = 1e-3, np.array(coef)
    poles = table(complex(real, imag))
    poles[0, STATE] = 1e-3 + 2e-3j
    weigh(poles, 0, STEP, h)
    weigh(poles, 0, PEEK, share * h)
    weigh(poles, 0, PART, (1.0 - share) * h)
    whole = state_after(poles, 0, STEP, y[None, None, :], 0, 0, 1.0)
    poles[0, STATE] = state_after(poles, 0, PEEK, y[None, None, :], 0, 0, share)
    rest = np.polynomial.Polynomial(y)(np.polynomial.Polynomial([share, 1.0 - share])).coef
    rest = np.pad(rest, (0, DEGREE + 1 - len(rest)))
    assert abs(state_after(poles, 0, PART, rest[None, None, :], 0, 0, 1.0) - whole) < 1e-14 * (1.0 + 100.0 * abs(whole))


def transfer(modal, s):
    pairs = [(p, r) for p, r in zip(modal.poles, modal.residues)]
    pairs += [(p.conjugate(), r.conjugate()) for p, r in pairs if p.imag]
    return modal.direct + sum(r / (s - p) for p, r in pairs)


FREQUENCIES = np.array([0.01, 1.0, 50.0, 999.0, 1000.0, 1300.0, 2e4])
S = 2j * np.pi * FREQUENCIES
W = 2.0 * np.pi * 1000.0


@pytest.mark.parametrize(
    ("modal", "expected"),
    [
        (filters.first_order(1000.0), W / (S + W)),
        (filters.second_order(1000.0, 0.7), W**2 / (S**2 + W / 0.7 * S + W**2)),
        (filters.second_order(1000.0, 30.0), W**2 / (S**2 + W / 30.0 * S + W**2)),
        (filters.resonance(1000.0, 30.0, 0.1), S / (S + 0.2 * np.pi) * W**2 / (S**2 + W / 30.0 * S + W**2)),
        (
            filters.bessel(1000.0),
            signal.freqs_zpk(*signal.bessel(3, W, analog=True, output="zpk", norm="mag"), S.imag)[1],
        ),
        (filters.bessel(np.inf), np.ones(len(S))),
        (filters.resonance(np.inf, 30.0, 0.1), S / (S + 0.2 * np.pi)),
        (filters.resonance(1000.0, 30.0, 0.0), W**2 / (S**2 + W / 30.0 * S + W**2)),
    ],
    ids=["first_order", "second_order", "sharp", "resonance", "bessel", "none", "high-pass", "no high-pass"],
)
def test_modal_form_is_the_transfer_function(modal, expected):
    np.testing.assert_allclose(transfer(modal, S), expected, rtol=1e-11)


def test_bessel_delays_by_0_279_over_its_bandwidth_and_lags_by_100_degrees():
    # Polytec OFV-3001/511 manual p36: -100 deg at f_c, amplitude -5 % at .4 f_c, -15 % at .7, -3 dB at 1.
    h = transfer(filters.bessel(1000.0), 2j * np.pi * np.array([0.1, 400.0, 700.0, 1000.0]))
    assert np.angle(h[0]) / (-2.0 * np.pi * 0.1) == pytest.approx(0.279e-3, rel=2e-3)
    np.testing.assert_allclose(np.abs(h[1:]), [0.95, 0.85, np.sqrt(0.5)], atol=0.01)
    assert np.degrees(np.angle(h[3])) == pytest.approx(-100.0, abs=1.0)
