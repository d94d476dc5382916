"""A stage of a Runge-Kutta method, written so that the next one waits for little but the law of friction.

Stages are a chain: force, derivative, state, slip speed, law, force. All between two laws is linear in the force F,
so that the slip speed and the load can be summed without it, by the stage before, and F is added last: from one law to
the next there is one multiplication.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from rig.kernel import inlined, local
from rig.solve.exponential import factors
from rig.solve.forces import drag, rate
from rig.solve.laws import STRIBECK, coefficient

Array = NDArray[np.float64]


class Rub(NamedTuple):
    """The patch whose law is waited for, -1 where none is: no law over speed, or forces that depend on each other.

    ask . x: what the law is asked at, the exponent of STRIBECK, else the slip speed; bear . x: the load. *_x [n] and
    *_f: their rates of change with the state and with the force of the patch.
    """

    patch: int
    ask: Array
    ask_x: Array
    ask_f: float
    bear: Array
    bear_x: Array
    bear_f: float


@inlined
def awaited(shape, f, w):
    """The patch of field f that is waited for; `w`: Workspace, of a rig of many states."""
    n, patch = len(shape), -1
    ask, bear = local(shape, w.ask), local(shape, w.bear)
    ask_x, bear_x = local(shape, w.ask_x), local(shape, w.bear_x)
    ask_f, bear_f = 0.0, 0.0
    if f.products is None and not f.coupled:
        for p in range(f.sigma.shape[0] - 1, -1, -1):
            if f.sigma[p] != 0.0 and f.code[p] != 0:
                patch = p
    if patch >= 0:
        scale = -f.numbers[patch, 2] if f.code[patch] == STRIBECK else 1.0
        for i in range(n):
            ask[i], bear[i] = scale * f.pace[patch, i], f.bear[patch, i]
            ask_x[i] = bear_x[i] = 0.0
        for j in range(n):
            ask_f += ask[j] * f.b[j, patch]
            bear_f += bear[j] * f.b[j, patch]
            for i in range(n):
                ask_x[i] += ask[j] * f.A[j, i]
                bear_x[i] += bear[j] * f.A[j, i]
    return Rub(patch, ask, ask_x, ask_f, bear, bear_x, bear_f)


@inlined
def begin(shape, rub, k):
    """What `stage` takes as `late`, where k[0] is complete: no force, and how what is asked and the load change."""
    asked, borne = 0.0, 0.0
    if rub.patch >= 0:
        for i in range(len(shape)):
            asked += rub.ask[i] * k[0, i]
            borne += rub.bear[i] * k[0, i]
    return 0.0, asked, borne


@inlined
def complete(shape, f, rub, k, last, late):
    """Add to derivative k[last] the force that it is without."""
    if rub.patch >= 0:
        for i in range(len(shape)):
            k[last, i] += f.b[i, rub.patch] * late[0]


@inlined
def stage(shape, f, rub, reach, z, k, last, late):
    """Z += reach times derivative k[last], which is completed; k[last + 1] = the derivative there, to be completed.

    `late`: the force that k[last] is without, the rates without it of what the law is asked at and of the load.
    Returns the same for k[last + 1].
    """
    n = len(shape)
    force, asked, borne = 0.0, 0.0, 0.0
    if rub.patch < 0:
        for i in range(n):
            z[i] += reach * k[last, i]
        rate(shape, f, True, z, k[last + 1])
    else:
        u, N = 0.0, 0.0
        for i in range(n):
            u += rub.ask[i] * z[i]
            N += rub.bear[i] * z[i]
        u = (u + reach * late[1]) + (reach * rub.ask_f) * late[0]
        N = (N + reach * late[2]) + (reach * rub.bear_f) * late[0]
        for i in range(n):
            z[i] = (z[i] + reach * k[last, i]) + (reach * f.b[i, rub.patch]) * late[0]
        complete(shape, f, rub, k, last, late)
        force = pull(f, rub.patch, u, N)
        for i in range(n):
            asked += rub.ask_x[i] * z[i]
            borne += rub.bear_x[i] * z[i]
            s = 0.0
            for j in range(n):
                s += f.A[i, j] * z[j]
            k[last + 1, i] = s
        for p in range(rub.patch + 1, f.sigma.shape[0]):
            other = drag(f, p, z, 0.0)
            for i in range(n):
                asked += (rub.ask[i] * f.b[i, p]) * other
                borne += (rub.bear[i] * f.b[i, p]) * other
                k[last + 1, i] += f.b[i, p] * other
    return force, asked, borne


@inlined
def pull(f, p, u, N):
    """The friction force of patch p whose law is asked at u, under the load N."""
    if f.code[p] == STRIBECK:
        coarse, fine = factors(u)
        force = N * f.numbers[p, 0] + ((N * f.numbers[p, 1]) * coarse) * fine
    else:
        force = coefficient(f.code[p], f.numbers[p], u) * N
    return force
