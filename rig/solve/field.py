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
    coupled: int
    T: Array
    scratch: Array
    G: Array
    GT: Array
    needs: NDArray[np.int64]


class Books(NamedTuple):
    """What the ledger and the sensors need of a slot."""

    friction: Array
    friction_t: Array
    surface: Array
    slip: Array
    damping: Array
    force: Array
    press: Array
    press_t: Array
    lift: Array
    signals: Array
    signals_t: Array
    T: Array


@inlined
def lend(t, slot, w):
    """The field of a slot."""
    count = t.guards[slot]
    return Field(
        t.A[slot],
        t.b[slot],
        t.sigma[slot],
        t.code,
        t.numbers,
        t.slip,
        t.load[slot],
        t.load_t[slot],
        t.coupled[slot],
        w.T,
        w.scratch,
        t.G[slot, :count],
        t.GT[slot, :count],
        t.needs[slot, :count],
    )


@inlined
def lend_books(t, slot, w):
    """The books of a slot."""
    return Books(
        t.friction[slot],
        t.friction_t[slot],
        t.surface,
        t.slip,
        t.damping,
        t.force,
        t.press[slot],
        t.press_t[slot],
        t.lift,
        t.signals[slot],
        t.signals_t[slot],
        w.T,
    )


@inner
def forces(f, x):
    """f.T = friction forces at x."""
    friction(f.sigma, f.code, f.numbers, f.slip, f.load, f.load_t, f.coupled, x, f.T, f.scratch)


@inlined
def rate(shape, f, falling, x, k):
    """Derivative k = A x + b T(x); `falling`: some patch slips under a law over speed."""
    if falling:
        friction(f.sigma, f.code, f.numbers, f.slip, f.load, f.load_t, f.coupled, x, f.T, f.scratch)
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
def book(b, x, scale, energy):
    """Add `scale` times the powers at x, whose friction forces are b.T, to energy."""
    nq = b.damping.shape[0]
    for p in range(b.T.shape[0]):
        force = scale * (dot(b.friction[p], x) + dot(b.friction_t[p], b.T))
        energy[0] += force * dot(b.surface[p], x)
        energy[1] += force * dot(b.slip[p], x)
    for i in range(nq):
        v = scale * x[nq + i]
        energy[2] += v * dot(b.damping[i], x[nq : 2 * nq])
        energy[3] += v * dot(b.force[i], x)
    for k in range(b.lift.shape[0]):
        energy[4] += scale * (dot(b.press[k], x) + dot(b.press_t[k], b.T)) * dot(b.lift[k], x)


@inner
def read(b, x, values):
    """values[signal] = what the sensors read at x, whose friction forces are b.T."""
    for s in range(values.shape[0]):
        values[s] = dot(b.signals[s], x) + dot(b.signals_t[s], b.T)


@inlined
def guard(f, g, x):
    """Guard g at x."""
    value = dot(f.G[g], x)
    if f.needs[g]:
        forces(f, x)
        value += dot(f.GT[g], f.T)
    return value
