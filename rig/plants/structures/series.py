"""Truncated power series of two small angles, for the geometry of a rig up to a stated order.

A series is an array c[i, j] of the coefficients of phi^i theta^j. Its shape is (n + 1, n + 1); it contains all terms up
to degree n.
"""

from __future__ import annotations

from math import factorial

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
_ROUNDING = 1e-13  # of the sum of the absolute values: a smaller sum is rounding


def constant(value: float, degree: int) -> Array:
    """The series of a constant."""
    out = np.zeros((degree + 1, degree + 1))
    out[0, 0] = value
    return out


def sine(axis: int, degree: int) -> Array:
    """The series of the sine of angle `axis` (0: phi, 1: theta)."""
    return _along(axis, [(-1.0) ** (k // 2) / factorial(k) if k % 2 else 0.0 for k in range(degree + 1)])


def versine(axis: int, degree: int) -> Array:
    """The series of one minus the cosine of angle `axis`."""
    return _along(axis, [-((-1.0) ** (k // 2)) / factorial(k) if k and not k % 2 else 0.0 for k in range(degree + 1)])


def _along(axis: int, coefficients: list[float]) -> Array:
    out = np.zeros((len(coefficients), len(coefficients)))
    out[(slice(None), 0) if axis == 0 else (0, slice(None))] = coefficients
    return out


def times(a: Array, b: Array) -> Array:
    """The product of two series of the same shape, truncated to this shape."""
    n = len(a)
    parts = np.zeros((n, n, n, n))
    for i, j in np.argwhere(a):
        parts[i, j, i:, j:] = a[i, j] * b[: n - i, : n - j]
    return cut(total(parts.reshape(-1, n, n)), n - 1)


def total(parts: Array) -> Array:
    """The sum of series [series, i, j]; rounding errors of terms that cancel are set to zero."""
    out = parts.sum(axis=0)
    out[np.abs(out) <= _ROUNDING * np.abs(parts).sum(axis=0)] = 0.0
    return np.asarray(out)


def root(a: Array) -> Array:
    """The square root of a series with a positive constant term, by the binomial series."""
    rest = a / a[0, 0]
    rest[0, 0] = 0.0
    factor = 1.0
    power = constant(1.0, len(a) - 1)
    parts = [power]
    for k in range(1, len(a)):
        power = times(power, rest)
        factor = factor * (1.5 - k) / k
        parts.append(factor * power)
    return np.asarray(np.sqrt(a[0, 0]) * total(np.array(parts)))


def cut(a: Array, degree: int, room: int | None = None) -> Array:
    """The series without terms above `degree`, in an array for terms up to `room` (default: `degree`)."""
    room = len(a) - 1 if room is None else room
    out = np.zeros((room + 1, room + 1))
    n = min(len(a), room + 1)
    out[:n, :n] = a[:n, :n]
    i, j = np.indices(out.shape)
    out[i + j > degree] = 0.0
    return out


def slope(a: Array, axis: int) -> Array:
    """The derivative with respect to angle `axis`."""
    powers = np.arange(len(a), dtype=np.float64)
    out = np.zeros_like(a)
    if axis == 0:
        out[:-1] = (a * powers[:, None])[1:]
    else:
        out[:, :-1] = (a * powers)[:, 1:]
    return out
