"""Exact response of one pole to a polynomial.

Over a segment of length h with  y = sum_k c_k u^k,  0 <= u <= 1, the solution of  z' = lambda z + y  ends at

    z(h) = e^x z(0) + sum_k c_k h w_k(x),    x = lambda h,    w_k(x) = integral_0^1 e^{(1-u) x} u^k du = k! phi_{k+1}(x)

    w_0 = (e^x - 1)/x,    w_k = (k w_{k-1} - 1)/x          upward: an error shrinks by k/|x|
    w_8 = sum_m x^m 8!/(9+m)!,   w_{k-1} = (1 + x w_k)/k   downward: an error shrinks by |x|/k

The recursion runs upward for k <= |x| and downward for the rest, so no step amplifies an error, from |x| = 1e-9 to 1e4
and beyond. A pole at 0 is the plain integral. (phi functions: Hochbruck & Ostermann, Acta Numerica 19 (2010) 209,
section 2.)
"""

from __future__ import annotations

from typing import Any

import numpy as np

from rig.kernel import fused, inner
from rig.solve.segments import DEGREE

WIDTH = DEGREE + 2  # e^x and the weights h w_0 .. h w_8
STATE, POLE, RESIDUE = 0, 1, 2  # columns of a table of poles [poles, COLUMNS], before the weights
STEP = 3  # weights for a full sample step, the length of most segments
PART = STEP + WIDTH  # weights for the last other length
PEEK = PART + WIDTH  # weights for the last sample instant inside a segment
COLUMNS = PEEK + WIDTH


@inner
def pole_weights(poles: Any, p: int, at: int, h: float) -> None:
    """Write e^x and h w_k(x) for pole p and length h [s] to poles[p, at : at + WIDTH]."""
    x = poles[p, POLE] * h
    e = np.exp(x) if x.real > -700.0 else 0j  # below, e^x would be a denormal number
    poles[p, at] = e
    size = abs(x)
    upward = DEGREE if size >= DEGREE else int(size)
    lowest = 0  # index of the first weight from the downward recursion
    if upward > 0:
        w = (e - 1.0) / x
        poles[p, at + 1] = h * w
        for k in range(1, upward + 1):
            w = (k * w - 1.0) / x
            poles[p, at + 1 + k] = h * w
        lowest = upward + 1
    if lowest <= DEGREE:
        term = complex(1.0 / (DEGREE + 1))
        w = term
        m = DEGREE + 1
        while abs(term.real) + abs(term.imag) > 1e-18:
            m += 1
            term *= x / m
            w += term
        poles[p, at + 1 + DEGREE] = h * w
        for k in range(DEGREE, lowest, -1):
            w = (1.0 + x * w) / k
            poles[p, at + k] = h * w


QUARTIC = 4


@fused
def degree_of(coef: Any, j: int, column: int) -> int:
    """The degree up to which terms of segment j count: most segments are quartics."""
    for k in range(QUARTIC + 1, DEGREE + 1):
        if coef[j, column, k] != 0.0:
            return DEGREE
    return QUARTIC


@fused
def state_after(poles: Any, p: int, at: int, coef: Any, j: int, column: int, degree: int, a: float) -> complex:
    """The state of pole p after the first share `a` of segment j of `coef`.

    `at`: column where the weights for that length begin; `column`: the output; `degree`: see `degree_of`.
    """
    z = poles[p, at] * poles[p, STATE]
    re, im, power = z.real, z.imag, 1.0
    for k in range(degree + 1):
        weight, c = poles[p, at + 1 + k], power * coef[j, column, k]
        re += weight.real * c
        im += weight.imag * c
        power *= a
    return complex(re, im)


@fused
def polynomial(coef: Any, j: int, column: int, a: float) -> float:
    """The value of an output at the share `a` of segment j."""
    y = coef[j, column, DEGREE]
    for k in range(DEGREE - 1, -1, -1):
        y = y * a + coef[j, column, k]
    return y  # type: ignore[no-any-return]
