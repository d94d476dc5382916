"""Matrix exponentials computed in a fixed order of operations.

The last bits of a BLAS-backed routine may depend on the number of threads and on the processor; here they do not. The
matrix is balanced by powers of two. The exponential minus one of the finest cell is summed as a Taylor series. Coarser
cells follow by squaring, E -> 2 E + E^2, which keeps the digits of entries that are small beside one.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from rig.kernel import kernel

Array = NDArray[np.float64]
ORDER = 14
LONGEST = 12  # largest number of terms of the Taylor polynomial of a cell
REACH = 0.25  # |A| h of a finest cell: Taylor of order 12 is then exact to 3e-18
DEEPEST = 40


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
