"""Powers of u on [0, 1] by polynomials of lower degree, so that a series over a whole tick needs few terms.

Telescoping after Lanczos: u^j = u u^(j-1), and u^(j-1) without what it has of Chebyshev polynomials beyond the degree.
A vibration of w h radians in a tick is met to 2 (w h / 4)^(d+1) / (d+1)! by degree d, where its Taylor series of the
same degree would leave (w h)^(d+1) / (d+1)!. At u = 0 nothing changes.
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
    """Coefficients of u^k, k = 0 .. degree, in what stands for u^j, j = 0 .. terms: [k, j]."""
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
    """Bernstein coefficients [i] from those of powers [k]: [i, k]."""
    rows = [[comb(i, k) / comb(degree, k) if k <= i else 0.0 for k in range(degree + 1)] for i in range(degree + 1)]
    return np.array(rows)


def _shifted(count: int) -> list[list[int]]:
    """T_i(2u - 1), i < count, lowest power first."""
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
