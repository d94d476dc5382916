"""Exponentials: of matrices, of numbers in a stage, and of one pole driven by a polynomial.

Matrix exponentials are computed in a fixed order of operations. The last bits of a BLAS-backed routine may depend on
the number of threads and on the processor; here they do not. The matrix is balanced by powers of two. The exponential
minus one of the finest cell is summed as a Taylor series. Coarser cells follow by squaring, E -> 2 E + E^2, which keeps
the digits of entries that are small beside one.

The exponential function is inlined into its callers: a call of the library takes as long as the rest of a dopri5 stage.
e^u = e^(k/16) e^r with an integer k and |r| <= 1/32. The first factor comes from a table, the second from its series,
both accurate to rounding; r is exact.

The response of one pole to a polynomial is exact. Over a segment of length h with  y = sum_k c_k u^k,  0 <= u <= 1, the
solution of  z' = lambda z + y  ends at

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
from numpy.typing import NDArray

from rig.compiled.kernel import fused, inlined, inner, kernel
from rig.solve.column_blocks import between, pick
from rig.solve.segment_output import DEGREE

Array = NDArray[np.float64]
_LEAST = -48  # below, the library function is called
_MOST = 16  # above, the library function is called
_TABLE = np.exp(np.arange(16 * _LEAST, 16 * _MOST + 1) / 16.0)
_SHIFT = 1.5 * 2.0**52  # at this size a double has no fraction bits: adding it rounds to an integer
ORDER = 14  # Taylor terms of the finest cell: with |A| h <= REACH, more than a double resolves
LONGEST = 12  # largest number of terms of the Taylor polynomial of a cell
REACH = 0.25  # |A| h of a finest cell: Taylor of order 12 is then exact to 3e-18
DEEPEST = 40  # most halvings: |A| h up to 1e11 (rig.stability.report.EXACT_LIMIT)
WIDTH = DEGREE + 2  # e^x and the weights h w_0 .. h w_8
STATE, POLE, RESIDUE = range(3)  # columns of a table of poles [poles, COLUMNS], before the weights
STEP = 3  # weights for a full sample step, the length of most segments
PART = STEP + WIDTH  # weights for the last other length
PEEK = PART + WIDTH  # weights for the last sample instant inside a segment
COLUMNS = PEEK + WIDTH
QUARTIC = 4


@inlined
def _step_and_rest(u):
    """The number k of the step below or above u, and e^r. `u`: a number or lanes."""
    k = (16.0 * u + _SHIFT) - _SHIFT
    r = u - 0.0625 * k
    s = r * r
    low = (1.0 + r) + s * (1.0 / 2.0 + r * (1.0 / 6.0))
    high = (1.0 / 24.0 + r * (1.0 / 120.0)) + s * (1.0 / 720.0 + r * (1.0 / 5040.0))
    return k, low + (s * s) * high


@inlined
def exponential_factors(u):
    """Two numbers whose product is e^u to two units in the last place. The first is available before the second."""
    if _LEAST < u < _MOST:
        k, fine = _step_and_rest(u)
        coarse = _TABLE[np.uint32(k - 16.0 * _LEAST)]
    else:
        coarse, fine = np.exp(u), 1.0
    return coarse, fine


@inlined
def has_lane_factors(u):
    """Whether `exponential_factors_of_lanes` serves all lanes of u."""
    return between(1.0 * _LEAST, u, 1.0 * _MOST)


@inlined
def exponential_factors_of_lanes(u):
    """The same two factors in each lane."""
    k, fine = _step_and_rest(u)
    return pick(_TABLE, k - 16.0 * _LEAST), fine


@kernel
def balance(A):
    """Powers of two d such that d[i] A[i, j] / d[j] is balanced (Osborne). Rows of zeros (constants) are left out."""
    n = A.shape[0]
    d = np.ones(n)
    for _ in range(40):
        settled = True
        for i in range(n):
            row, column = 0.0, 0.0
            for j in range(n):
                if j != i:
                    row += abs(A[i, j]) * d[i] / d[j]
                    column += abs(A[j, i]) * d[j] / d[i]
            if row == 0.0 or column == 0.0:
                continue
            f = 2.0 ** np.round(0.5 * np.log2(column / row))
            if (column / f + row * f) < 0.95 * (column + row):
                d[i] *= f
                settled = False
        if settled:
            break
    return d


@kernel
def norm(A, d):
    """The 1-norm of the balanced matrix over the columns of states that change."""
    n = A.shape[0]
    worst = 0.0
    for j in range(n):
        moves = False
        column = 0.0
        for i in range(n):
            if A[j, i] != 0.0:
                moves = True
            column += abs(A[i, j]) * d[i] / d[j]
        if moves and column > worst:
            worst = column
    return worst


@kernel
def multiply(X, Y, out):
    """The product X Y, written to out; sums run in index order.

    The inner loop runs along rows, so that the compiler can vectorise it.
    """
    n, m, k = X.shape[0], Y.shape[1], X.shape[1]
    for i in range(n):
        for j in range(m):
            out[i, j] = 0.0
        for l in range(k):
            f = X[i, l]
            for j in range(m):
                out[i, j] += f * Y[l, j]


@kernel
def taylor(A, h, order):
    """exp(A h) - 1 by the Taylor series with `order` terms, for |A| h up to about a quarter."""
    n = A.shape[0]
    term = np.eye(n)
    out = np.zeros((n, n))
    product = np.zeros((n, n))
    for k in range(1, order + 1):
        multiply(term, A, product)
        for i in range(n):
            for j in range(n):
                term[i, j] = product[i, j] * (h / k)
                out[i, j] += term[i, j]
    return out


@kernel
def depth(A, h):
    """The number of halvings of h that reduces |A| h of the balanced matrix to REACH."""
    size = norm(A, balance(A)) * h
    level = 0
    while size > REACH and level < DEEPEST:
        size *= 0.5
        level += 1
    return level


@kernel
def order(A, h):
    """The number of Taylor terms of exp(A h / 2^depth) that leaves less than a tenth of a rounding error."""
    size = norm(A, balance(A)) * h / 2.0 ** depth(A, h)
    terms, left = 1, 0.5 * size * size
    while left > 2e-17 and terms < LONGEST:
        terms += 1
        left *= size / (terms + 1)
    return terms


@kernel
def ladder(A, h):
    """exp(A h / 2^j) - 1 for j = 0 .. depth, shape [depth + 1, n, n].

    One is subtracted, because a tick x + E x keeps the digits that the rounding of 1 + E would lose: 1e-12 over 1e4
    ticks of a period.
    """
    n = A.shape[0]
    levels = depth(A, h)
    d = balance(A)
    B = np.zeros((n, n))
    for i in range(n):
        for j in range(n):
            B[i, j] = A[i, j] * d[i] / d[j]
    E = taylor(B, h / 2.0**levels, ORDER)
    out = np.zeros((levels + 1, n, n))
    square = np.zeros((n, n))
    for level in range(levels, -1, -1):
        for i in range(n):
            for j in range(n):
                out[level, i, j] = E[i, j] * d[j] / d[i]
        multiply(E, E, square)
        for i in range(n):
            for j in range(n):
                E[i, j] = 2.0 * E[i, j] + square[i, j]
    return out


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
