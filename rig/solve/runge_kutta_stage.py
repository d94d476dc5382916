"""One stage of a Runge-Kutta method, arranged so that the critical path is one friction law and one multiplication.

Stages form a chain: force, derivative, state, slip speed, law, force. Everything between two evaluations of the law is
linear in the force F. The slip speed and the load are therefore summed without F during the previous stage, and F is
added last: one multiplication lies between one law and the next. This applies to rigs with one patch. With more
patches, or with products, the derivative is computed as a whole.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from rig.kernel import fused, inlined, inner
from rig.solve.column_blocks import multiply
from rig.solve.exponential import factors
from rig.solve.forces import inputs, lend, rate
from rig.solve.friction_coefficient import STRIBECK, coefficient
from rig.solve.records import KEY
from rig.solve.specialised import call, local, multiplies, states

Array = NDArray[np.float64]


class PatchFriction(NamedTuple):
    """The friction of the only patch.

    `alone`: there is one patch, its friction depends on speed, and there are no products. ask . x: argument of the law,
    which is the exponent of STRIBECK, otherwise the slip speed; bear . x: the load. *_x [n] and *_f: rates of change of
    both with the state and with the friction force.
    """

    alone: bool
    ask: Array
    ask_x: Array
    ask_f: float
    bear: Array
    bear_x: Array
    bear_f: float
    at: Array  # scratch [n]: state at which `whole` computes the derivative, and
    rates: Array  # its result
    t: Any  # arguments of a call by address (rig.solve.specialised)
    w: Any
    state: Any
    log: Any
    seg: Any
    plan: Any


@inlined
def patch_friction(shape, f, t, w, state, log, seg, plan):
    """The PatchFriction of field f; the other arguments are kept for calls by address (rig.solve.specialised)."""
    n = states(shape)
    ask, bear = local(shape, w.ask), local(shape, w.bear)
    ask_x, bear_x = local(shape, w.ask_x), local(shape, w.bear_x)
    ask_f, bear_f = 0.0, 0.0
    single = not multiplies(shape) and f.sigma.shape[0] == 1 and not f.coupled
    alone = single and f.sigma[0] != 0.0 and f.code[0] != 0
    if alone:
        scale = -f.numbers[0, 2] if f.code[0] == STRIBECK else 1.0
        for i in range(n):
            ask[i], bear[i] = scale * f.pace[0, i], f.bear[0, i]
            ask_x[i] = bear_x[i] = 0.0
        for j in range(n):
            ask_f += ask[j] * f.b[j, 0]
            bear_f += bear[j] * f.b[j, 0]
            for i in range(n):
                ask_x[i] += ask[j] * f.A[j, i]
                bear_x[i] += bear[j] * f.A[j, i]
    return PatchFriction(alone, ask, ask_x, ask_f, bear, bear_x, bear_f, w.at, w.rates, t, w, state, log, seg, plan)


@inner
def whole(shape, t, w, state, log, seg, plan, ticks):
    """Compute the derivative w.rates at w.at for any rig; a part (rig.solve.specialised).

    `stage` calls it unless the rig has a single patch and no products.
    """
    mode_set = t.mode_set_of[state.ic[KEY]]
    if plan.wide:
        inputs(t, mode_set, w.at, w.T, w.scratch)
        multiply(t.wide.field[mode_set], w.both, 0, t.wide.field.shape[1], t.wide.product)
        for i in range(w.rates.shape[0]):
            w.rates[i] = t.wide.product[i]
    else:
        rate(shape, lend(t, mode_set, w.T, w.scratch), True, w.at, w.rates)
    return 0


@inlined
def begin(shape, friction, k):
    """The first argument `late` of `stage`, for a complete k[0].

    No force is missing; the rates are those of the argument of the law and of the load.
    """
    asked, borne = 0.0, 0.0
    if friction.alone:
        for i in range(states(shape)):
            asked += friction.ask[i] * k[0, i]
            borne += friction.bear[i] * k[0, i]
    return 0.0, asked, borne


@inlined
def complete(shape, f, friction, k, last, late):
    """Add the missing friction force to derivative k[last]."""
    if friction.alone:
        for i in range(states(shape)):
            k[last, i] += f.b[i, 0] * late[0]


@fused
def stage(shape, f, friction, reach, z, k, last, late):
    """Add reach times derivative k[last] to z and compute k[last + 1] there without its friction force.

    Also completes k[last]. `late`: the force missing in k[last], and the rates, without it, of the argument of the law
    and of the load. Returns the same three values for k[last + 1].
    """
    n = states(shape)
    force, asked, borne = 0.0, 0.0, 0.0
    if friction.alone:
        u, N = 0.0, 0.0
        for i in range(n):
            u += friction.ask[i] * z[i]
            N += friction.bear[i] * z[i]
        u = (u + reach * late[1]) + (reach * friction.ask_f) * late[0]
        N = (N + reach * late[2]) + (reach * friction.bear_f) * late[0]
        for i in range(n):
            z[i] = (z[i] + reach * k[last, i]) + (reach * f.b[i, 0]) * late[0]
        complete(shape, f, friction, k, last, late)
        if f.code[0] == STRIBECK:
            coarse, fine = factors(u)
            force = N * f.numbers[0, 0] + ((N * f.numbers[0, 1]) * coarse) * fine
        else:
            force = coefficient(f.code[0], f.numbers[0], u) * N
        for i in range(n):
            asked += friction.ask_x[i] * z[i]
            borne += friction.bear_x[i] * z[i]
            s = 0.0
            for j in range(n):
                s += f.A[i, j] * z[j]
            k[last + 1, i] = s
    else:  # arrays kept in registers must not be passed: copy
        for i in range(n):
            z[i] += reach * k[last, i]
            friction.at[i] = z[i]
        call(
            friction.plan.whole,
            shape,
            friction.t,
            friction.w,
            friction.state,
            friction.log,
            friction.seg,
            friction.plan,
            0,
        )
        for i in range(n):
            k[last + 1, i] = friction.rates[i]
    return force, asked, borne
