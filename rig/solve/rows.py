"""Rows over the state: their product with it, the rounding error of this product, and whether they are zero."""

from __future__ import annotations

from rig.kernel import fused, inner

ROUND = 64.0 * 2.2e-16


@inner
def dot(row, x):
    """The product row . x, summed in index order."""
    s = 0.0
    for j in range(row.shape[0]):
        s += row[j] * x[j]
    return s


@inner
def rounding(row, x):
    """The size of the rounding error of row . x."""
    s = 0.0
    for j in range(row.shape[0]):
        s += abs(row[j] * x[j])
    return s * ROUND


@fused
def is_zero(row):
    """Whether every entry of a row is zero."""
    for j in range(row.shape[0]):
        if row[j] != 0.0:
            return False
    return True
