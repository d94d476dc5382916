"""One stage of a Runge-Kutta method, arranged so that the critical path is one friction law and one multiplication.

Stages form a chain: force, derivative, state, slip speed, law, force. Everything between two evaluations of the law is
linear in the force F. The slip speed and the load are therefore summed without F during the previous stage, and F is
added last: one multiplication lies between one law and the next. This applies to rigs with one patch. With more
patches, or with products, the derivative is computed as a whole. A method may ask for products of states alone to be
added to the derivative of a stage instead (dop853; dopri5 does not, whose results would change in the last digit).
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from rig.compiled.kernel import by_address, fused, inlined, inner
from rig.solve.column_blocks import LANE, add_along, along, copy, is_zero, lanes, write
from rig.solve.forces import (
    STRIBECK,
    derivative_by_inputs,
    derivative_by_state,
    law_force,
    needs_inputs,
    right_hand_side,
)
from rig.solve.specialised import any_shape, call, has_products, is_unrolled, local, state_count

Array = NDArray[np.float64]


class PatchFriction(NamedTuple):
    """The friction of the only patch.

    `alone`: there is one patch, its friction depends on speed, and there are no products. `added`: there are, of states
    alone, and stages add them; the friction may also be constant. law_argument . x: the argument, which is the exponent
    of STRIBECK, otherwise the slip speed; law_load . x: the load. *_x [n] and *_f: rates of change of both with the
    state and with the friction force.
    """

    alone: bool
    added: bool
    law_argument: Array
    law_argument_x: Array
    law_argument_f: float
    law_load: Array
    law_load_x: Array
    law_load_f: float
    law_argument_p: Array  # [product] rates of change with each product, if they are `added`
    law_load_p: Array
    at: Array  # scratch [n]: state at which `whole_derivative` computes the derivative, and
    rates: Array  # its result
    t: Any  # arguments of a call by address (rig.solve.specialised)
    w: Any
    state: Any
    log: Any
    seg: Any
    plan: Any


@inlined
def patch_friction(shape, f, adds, t, w, state, log, seg, plan):
    """The PatchFriction of field f; the other arguments are kept for calls by address (rig.solve.specialised).

    `adds`: stages may add products.
    """
    n = state_count(shape)
    law_argument, law_load = local(shape, w.law_argument), local(shape, w.law_load)
    law_argument_x, law_load_x = local(shape, w.law_argument_x), local(shape, w.law_load_x)
    law_argument_f, law_load_f = 0.0, 0.0
    single, added = f.sigma.shape[0] == 1 and not f.coupled, False
    if has_products(shape) and adds:
        added = single and only_states(f)
    alone = added or (not has_products(shape) and single and f.sigma[0] != 0.0 and f.code[0] != 0)
    if alone:
        scale = -f.numbers[0, 2] if f.code[0] == STRIBECK else 1.0
        for i in range(n):
            law_argument[i], law_load[i] = scale * f.law_speed[0, i], f.law_load[0, i]
            law_argument_x[i] = law_load_x[i] = 0.0
        for j in range(n):
            law_argument_f += law_argument[j] * f.b[j, 0]
            law_load_f += law_load[j] * f.b[j, 0]
            for i in range(n):
                law_argument_x[i] += law_argument[j] * f.A[j, i]
                law_load_x[i] += law_load[j] * f.A[j, i]
    if has_products(shape) and added:
        for q in range(f.T.shape[0] - 1):
            w.law_argument_p[q] = w.law_load_p[q] = 0.0
            for j in range(n):
                w.law_argument_p[q] += law_argument[j] * f.b[j, 1 + q]
                w.law_load_p[q] += law_load[j] * f.b[j, 1 + q]
    return PatchFriction(
        alone,
        added,
        law_argument,
        law_argument_x,
        law_argument_f,
        law_load,
        law_load_x,
        law_load_f,
        w.law_argument_p,
        w.law_load_p,
        w.at,
        w.rates,
        t,
        w,
        state,
        log,
        seg,
        plan,
    )


@inner
def only_states(f):
    """Whether every input but the friction forces is a product of states, and no load depends on one."""
    p = f.t.products
    for i in range(p.place.shape[0]):
        for j in range(p.place.shape[1]):
            if p.state.shape[0] <= p.place[i, j] < p.values.shape[0] - 1:
                return False
    return f.T.shape[0] == f.t.memory.inputs[0] and is_zero(f.law_load_t[0])


@by_address
def whole_derivative(shape, t, w, state, log, seg, plan, ticks):
    """Compute the derivative w.rates at w.at for any rig; a part (rig.solve.specialised).

    `stage` calls it unless the rig has a single patch and no products.
    """
    mode_set = t.mode_set_of[state.progress[0].key]
    if plan.many_states:
        n, field = w.at.shape[0], t.many_states.field[mode_set]
        along(field[:n], w.at, w.rates)  # does not wait for the inputs
        call(plan.inputs_of_state, any_shape(n), t, w, state, log, seg, plan, 0)
        add_along(field[n:], w.T, w.rates)
    else:
        f = right_hand_side(t, mode_set, w.T, w.scratch)
        derivative(shape, f, True, w.at, w.rates, t, w, state, log, seg, plan)
    return 0


@inlined
def derivative(shape, f, nonlinear, x, k, t, w, state, log, seg, plan):
    """The derivative k at x; the inputs are evaluated by a part, at w.at.

    `nonlinear`: False for a system that is linear in every mode set, whose inputs are 0.
    """
    if nonlinear and needs_inputs(shape, f):
        copy(state_count(shape), x, w.at)
        call(plan.inputs_of_state, any_shape(state_count(shape)), t, w, state, log, seg, plan, 0)
        derivative_by_inputs(shape, f, x, k)
    else:
        derivative_by_state(shape, f, nonlinear, x, k)


@inlined
def begin_stages(shape, friction, k, first):
    """The first argument `late` of `stage`, for a complete k[first].

    No force is missing; the rates are those of the argument of the law and of the load.
    """
    argument_rate, load_rate = 0.0, 0.0
    if friction.alone:
        for i in range(state_count(shape)):
            argument_rate += friction.law_argument[i] * k[first, i]
            load_rate += friction.law_load[i] * k[first, i]
    return 0.0, argument_rate, load_rate


@inlined
def complete_derivative(shape, f, friction, k, last, late):
    """Add the missing friction force to derivative k[last]."""
    if friction.alone:
        for i in range(state_count(shape)):
            k[last, i] += f.b[i, 0] * late[0]


@fused
def stage(shape, f, friction, reach, z, k, last, late):
    """Add reach times derivative k[last] to z and compute k[last + 1] there without its friction force.

    Also completes k[last]. `late`: the force missing in k[last], and the rates, without it, of the argument of the law
    and of the load. Returns the same three values for k[last + 1].
    """
    n = state_count(shape)
    force, argument_rate, load_rate = 0.0, 0.0, 0.0
    if friction.alone:
        u, N = 0.0, 0.0
        for i in range(n):
            u += friction.law_argument[i] * z[i]
            N += friction.law_load[i] * z[i]
        u = (u + reach * late[1]) + (reach * friction.law_argument_f) * late[0]
        N = (N + reach * late[2]) + (reach * friction.law_load_f) * late[0]
        for i in range(n):
            z[i] = (z[i] + reach * k[last, i]) + (reach * f.b[i, 0]) * late[0]
        complete_derivative(shape, f, friction, k, last, late)
        if not has_products(shape) or (f.sigma[0] != 0.0 and f.code[0] != 0):
            force = law_force(f.code[0], f.numbers[0], u, N)
        for i in range(n):
            argument_rate += friction.law_argument_x[i] * z[i]
            load_rate += friction.law_load_x[i] * z[i]
            s = 0.0
            for j in range(n):
                s += f.A[i, j] * z[j]
            k[last + 1, i] = s
        if has_products(shape) and friction.added:
            p = f.t.products
            copy(n, z, p.state)
            for j in range(p.place.shape[1]):
                value = p.values[p.place[0, j]] * p.values[p.place[1, j]]
                for factor in range(2, p.place.shape[0]):
                    value *= p.values[p.place[factor, j]]
                argument_rate += friction.law_argument_p[j] * value
                load_rate += friction.law_load_p[j] * value
                for i in range(n):
                    k[last + 1, i] += f.b[i, 1 + j] * value
    else:  # arrays kept in registers must not be passed: copy
        if is_unrolled(shape):
            for i in range(n):
                z[i] += reach * k[last, i]
                friction.at[i] = z[i]
        else:
            for i in range(0, n, LANE):
                write(lanes(z[i:]) + reach * lanes(k[last, i:]), z[i:])
                write(lanes(z[i:]), friction.at[i:])
        call(
            friction.plan.whole_derivative,
            shape,
            friction.t,
            friction.w,
            friction.state,
            friction.log,
            friction.seg,
            friction.plan,
            0,
        )
        if is_unrolled(shape):
            copy(n, friction.rates, k[last + 1])
        else:
            for i in range(0, n, LANE):
                write(lanes(friction.rates[i:]), k[last + 1, i:])
    return force, argument_rate, load_rate
