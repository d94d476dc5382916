"""What the ledger and the sensors read of a rig at an instant of a slot's field (see forces)."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from rig.kernel import inlined, inner
from rig.solve.forces import dot
from rig.solve.ledger import RESISTOR

Array = NDArray[np.float64]


class Books(NamedTuple):
    """What the ledger and the sensors need of a slot."""

    friction: Array
    friction_t: Array
    surface: Array
    slip: Array
    damping: Array
    force: Array
    force_t: Array
    press: Array
    press_t: Array
    lift: Array
    signals: Array
    signals_t: Array
    loss: Array
    conductance: Array
    T: Array


@inlined
def lend_books(t, slot, T):
    """The books of a slot; T: the scratch of its field."""
    return Books(
        t.friction[slot],
        t.friction_t[slot],
        t.surface,
        t.slip,
        t.damping[slot],
        t.force,
        t.force_t,
        t.press[slot],
        t.press_t[slot],
        t.lift,
        t.signals[slot],
        t.signals_t[slot],
        t.loss[slot],
        t.conductance,
        T,
    )


@inner
def book(b, x, scale, energy):
    """Add `scale` times the powers at x, whose inputs are b.T, to energy."""
    nq, patches = b.damping.shape[0], b.slip.shape[0]
    for p in range(patches):
        force = scale * (dot(b.friction[p], x) + dot(b.friction_t[p], b.T))
        energy[0] += force * dot(b.surface[p], x)
        energy[1] += force * dot(b.slip[p], x)
    for i in range(nq):
        v = scale * x[nq + i]
        energy[2] += v * dot(b.damping[i], x[nq : 2 * nq])
        energy[3] += v * (dot(b.force[i], x) + dot(b.force_t[i], b.T[patches:]))
    for k in range(b.lift.shape[0]):
        energy[4] += scale * (dot(b.press[k], x) + dot(b.press_t[k], b.T)) * dot(b.lift[k], x)
    for r in range(b.loss.shape[0]):
        energy[RESISTOR] += scale * b.conductance[r] * dot(b.loss[r], x) ** 2


@inner
def read(b, x, values):
    """values[signal] = what the sensors read at x, whose inputs are b.T."""
    for s in range(values.shape[0]):
        values[s] = dot(b.signals[s], x) + dot(b.signals_t[s], b.T)
