"""Friction coefficient over slip speed for kernels: a code and a row of numbers.

A law is smooth for speeds v > 0 and is continued smoothly below zero (never through |v|), so that a trial step over the
instant of sticking keeps its order. One runtime switch selects the law. It costs about a nanosecond beside the
exponential, and one compiled solver serves every rig.

    COULOMB      mu_k                                           constant: propagators stay exact
    STRIBECK     mu_d + (mu_s - mu_d) exp(-v / v_s)             Kroeger et al. 2008, characteristic A
    FALLING      max(mu_0 - slope v, floor)                     ibid., characteristic B
    TABLE        monotone cubic (PCHIP) through given points    constant beyond the last
    SEAL         mixed / (1 + decay v) + film sqrt(v + offset)  ibid., equation 3.1; continued linearly below v = 0
    SMOOTH       tanh(v / scale) times another law at |v|       for comparison only: passes through rest, never sticks
"""

from __future__ import annotations

import numpy as np

from rig.kernel import inlined, inner, kernel

COULOMB, STRIBECK, FALLING, TABLE, SEAL, SMOOTH = range(6)


@inner
def _interval(p, v):
    count = int(p[0])
    lo, hi = 0, count - 2
    while lo < hi:
        mid = (lo + hi + 1) // 2
        if p[1 + mid] <= v:
            lo = mid
        else:
            hi = mid - 1
    return lo, 1 + count + 4 * lo


@inner
def _from_table(p, v):
    count = int(p[0])
    if v >= p[count]:
        return p[1 + count + 4 * (count - 1)]
    i, at = _interval(p, v)
    d = v - p[1 + i]
    return p[at] + d * (p[at + 1] + d * (p[at + 2] + d * p[at + 3]))


@inner
def _seal_slope(p, v):
    fall = 1.0 / (1.0 + p[1] * v)
    return 0.5 * p[2] / np.sqrt(v + p[3]) - p[0] * p[1] * fall * fall


@inner
def _seal(p, v):
    u = max(v, 0.0)  # both terms have a pole or a branch point below zero
    return p[0] / (1.0 + p[1] * u) + p[2] * np.sqrt(u + p[3]) + (v - u) * _seal_slope(p, u)


@inlined
def unsmoothed(code, p, v):
    """The coefficient of a law without smoothing."""
    if code == STRIBECK:
        m = p[0] + p[1] * np.exp(-v * p[2])
    elif code == COULOMB:
        m = p[0]
    elif code == FALLING:
        m = max(p[0] - p[1] * v, p[2])
    elif code == SEAL:
        m = _seal(p, v)
    else:
        m = _from_table(p, v)
    return m


@inner
def _smooth(p, v):
    return np.tanh(v / p[0]) * unsmoothed(int(p[1]), p[2:], abs(v))


@inner
def coefficient(code, p, v):
    """The coefficient of a law (`code`, numbers `p`) at slip speed v [m/s]."""
    if code == SMOOTH:
        m = _smooth(p, v)
    else:
        m = unsmoothed(code, p, v)
    return m


@kernel
def coefficients(code, p, speeds, values):
    """values[i] = `coefficient` at speeds[i]."""
    for i in range(values.shape[0]):
        values[i] = coefficient(code, p, speeds[i])


@inner
def slope(code, p, v):
    """The slope d mu / d v [s/m] of a law (`code`, numbers `p`)."""
    if code != SMOOTH:
        return _slope(code, p, v)
    rise, inside = np.tanh(v / p[0]), int(p[1])
    change = np.sign(v) * rise * _slope(inside, p[2:], abs(v))
    return change + (1.0 - rise * rise) / p[0] * unsmoothed(inside, p[2:], abs(v))


@inner
def _slope(code, p, v):
    if code == COULOMB:
        return 0.0
    if code == STRIBECK:
        return -p[1] * p[2] * np.exp(-v * p[2])
    if code == FALLING:
        return -p[1] if p[0] - p[1] * v > p[2] else 0.0
    if code == SEAL:
        return _seal_slope(p, max(v, 0.0))
    count = int(p[0])
    if v >= p[count]:
        return 0.0
    i, at = _interval(p, v)
    d = v - p[1 + i]
    return p[at + 1] + d * (2.0 * p[at + 2] + d * 3.0 * p[at + 3])
