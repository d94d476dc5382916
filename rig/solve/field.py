"""One mode set as the time-stepping methods see it: x' = A x + b T(x), its guards, powers and signals.

The arrays of the slot are lent once for a stretch of steps; what runs many times in a step is written into the
callers. That is what brings plain array code near the speed of C.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from rig.kernel import inlined, inner
from rig.solve.settle import dot, friction

Array = NDArray[np.float64]


class Field(NamedTuple):
    """The slot's tables (see slots.Tables) and the scratch of the friction forces."""

    A: Array
    b: Array
    sigma: Array
    code: NDArray[np.int64]
    numbers: Array
    slip: Array
    load: Array
    load_t: Array
    T: Array
    scratch: Array
    G: Array
    GT: Array
    powers: Array
    friction_t: Array
    surface: Array
    normal_t: Array
    lift: Array
    signals: Array
    signals_t: Array


@inlined
def lend(t, slot, w):
    """The field of a slot."""
    count = t.count[slot]
    return Field(
        t.A[slot],
        t.b[slot],
        t.sigma[slot],
        t.code,
        t.numbers,
        t.slip,
        t.load[slot],
        t.load_t[slot],
        w.T,
        w.scratch,
        t.G[slot, :count],
        t.GT[slot, :count],
        t.powers[slot],
        t.friction_t[slot],
        t.surface,
        t.normal_t[slot],
        t.lift,
        t.signals[slot],
        t.signals_t[slot],
    )


@inner
def forces(f, x):
    """f.T = friction forces at x."""
    friction(f.sigma, f.code, f.numbers, f.slip, f.load, f.load_t, x, f.T, f.scratch)


@inlined
def rate(shape, f, falling, x, k):
    """K = A x + b T(x); `falling`: some patch slips under a law over speed."""
    if falling:
        friction(f.sigma, f.code, f.numbers, f.slip, f.load, f.load_t, x, f.T, f.scratch)
        for i in range(len(shape)):
            s = 0.0
            for j in range(len(shape)):
                s += f.A[i, j] * x[j]
            for p in range(f.T.shape[0]):
                s += f.b[i, p] * f.T[p]
            k[i] = s
    else:
        for i in range(len(shape)):
            s = 0.0
            for j in range(len(shape)):
                s += f.A[i, j] * x[j]
            k[i] = s


@inner
def slope(shape, f, falling, x, k):
    """`rate`, where it runs once in a step."""
    rate(shape, f, falling, x, k)


@inner
def book(shape, f, x, scale, energy):
    """Energy += scale times the powers at x."""
    forces(f, x)
    n = len(shape)
    for term in range(energy.shape[0]):
        s = 0.0
        for i in range(n):
            r = 0.0
            for j in range(n):
                r += f.powers[term, i, j] * x[j]
            s += x[i] * r
        energy[term] += scale * s
    for p in range(f.T.shape[0]):
        force = dot(f.friction_t[p], f.T)
        energy[0] += scale * force * dot(f.surface[p], x)
        energy[1] += scale * force * dot(f.slip[p], x)
    for k in range(f.lift.shape[0]):
        energy[4] += scale * dot(f.normal_t[k], f.T) * dot(f.lift[k], x)


@inner
def read(f, x, values):
    """values[signal] = what the sensors read at x."""
    forces(f, x)
    for s in range(values.shape[0]):
        values[s] = dot(f.signals[s], x) + dot(f.signals_t[s], f.T)


@inner
def guard_needs_force(f, g):
    """Whether guard g depends on friction forces under a law over speed."""
    for p in range(f.GT.shape[1]):
        if f.GT[g, p] != 0.0:
            return True
    return False


@inner
def guard(f, g, x):
    """Guard g at x."""
    value = dot(f.G[g], x)
    if guard_needs_force(f, g):
        forces(f, x)
        value += dot(f.GT[g], f.T)
    return value
