"""Approximates powers of u on [0, 1] by polynomials of lower degree, for short series over a whole tick.

Telescoping after Lanczos: u^j = u u^(j-1), where the Chebyshev polynomials beyond the degree are removed from u^(j-1).
For a vibration that turns by w h radians per tick, degree d leaves an error of 2 (w h / 4)^(d+1) / (d+1)!; its Taylor
series of the same degree would leave (w h)^(d+1) / (d+1)!. At u = 0 the approximation is exact.

Source: Lanczos, Applied Analysis (1956), chapter 7.
"""

from __future__ import annotations

from fractions import Fraction
from functools import cache
from math import comb

import numpy as np
from numpy.typing import NDArray


@cache
def economy(degree: int, terms: int) -> NDArray[np.float64]:
    """The coefficients of u^k, k = 0 .. degree, in the approximation of u^j, j = 0 .. terms: [k, j]."""
    chebyshev = _shifted(degree)
    out = np.zeros((degree + 1, terms + 1))
    for j in range(terms + 1):
        if j <= degree:
            out[j, j] = 1.0
            continue
        n, column = j - 1, [Fraction(0)] * degree
        for i in range(degree):  # u^n = 2 / 4^n sum_i comb(2n, n-i) T_i(2u - 1), the first term halved
            share = Fraction(comb(2 * n, n - i), 4**n) * (1 if i == 0 else 2)
            for k, value in enumerate(chebyshev[i]):
                column[k] += share * value
        out[1:, j] = [float(value) for value in column]
    return out


def bernstein(degree: int) -> NDArray[np.float64]:
    """The matrix from the coefficients of powers [k] to Bernstein coefficients [i]: [i, k]."""
    rows = [[comb(i, k) / comb(degree, k) if k <= i else 0.0 for k in range(degree + 1)] for i in range(degree + 1)]
    return np.array(rows)


def _shifted(count: int) -> list[list[int]]:
    """The coefficients of T_i(2u - 1), i < count, lowest power first."""
    found = [[1], [-1, 2]]
    while len(found) < count:
        before, last = found[-2], found[-1]
        new = [0] * (len(last) + 1)
        for k, value in enumerate(last):
            new[k] -= 2 * value
            new[k + 1] += 4 * value
        for k, value in enumerate(before):
            new[k] -= value
        found.append(new)
    return found
