"""The right-hand side of one mode set, x' = A x + b T(x), with its inputs T.

Inputs are speed-dependent friction forces and products. The arrays of the mode set are taken from the tables once for a
stretch of steps. Functions that run many times in a step are inlined into their callers. Both bring plain array code
close to the speed of C.

A friction law is a code and a row of numbers. It is smooth for speeds v > 0 and is continued smoothly below zero (never
through |v|), so that a trial step over the instant of sticking keeps its order. One runtime switch selects the law. It
costs about a nanosecond beside the exponential, and one compiled solver serves every rig.

    COULOMB      mu_k                                           constant: propagators stay exact
    STRIBECK     mu_d + (mu_s - mu_d) exp(-v / v_s)             Kroeger et al. 2008, characteristic A
    FALLING      max(mu_0 - slope v, floor)                     ibid., characteristic B
    TABLE        monotone cubic (PCHIP) through given points    constant beyond the last
    SEAL         mixed / (1 + decay v) + film sqrt(v + offset)  ibid., equation 3.1; continued linearly below v = 0
    SMOOTH       tanh(v / scale) times another law at |v|       for comparison only: passes through rest, never sticks
    FORMULA      any formula over v, called by address          continued linearly below v = 0
    MEMORY       a formula with internal states z               likewise

A law with memory is evaluated in the direction of slip: w = sigma v is the slip speed, N the load, z its states, of
which some, like a deflection, change their sign with the direction. Its rates z' are inputs like the friction forces.
In stick, which not every such law has, T is the largest friction force, mu(0, N, z) N, instead of the actual one.

Products are the nonlinear terms in the equations of a rig, e.g. x y, C (cos k phi - 1), N sin k phi. A product is an
input of the equations, like a speed-dependent friction force: rows refer to it, and its value is computed from the
state. Its factors are states, the sine or the versine of an angle (cosine minus one, negative; the angle is a row over
the state), the positive part of a row (a contact that presses and never pulls), normal forces and friction forces.
Products are evaluated in levels, so that none depends on itself:

    level 0   states, angles, presses   these may enter a normal force
    level 1   with a normal force
    level 2   with a friction force  these must not act on what a stuck contact needs

A random input is a new number at the begin of every frame, held until the next. It acts on the rig through a row, like
a command. A sticking contact therefore carries it, and the energy balance includes its work.
"""

from __future__ import annotations

from math import factorial
from typing import Any, NamedTuple

import numpy as np
from llvmlite import ir
from numba.core import cgutils, types
from numba.extending import intrinsic
from numpy.typing import NDArray

from rig.compiled.kernel import Emission, by_address, inlined, inner, kernel
from rig.solve.column_blocks import LANE, alike, between, dot, is_zero, lane, lanes, sparse_dot, write
from rig.solve.expm import exponential_factors
from rig.solve.specialised import has_products, state_count

Array = NDArray[np.float64]
COULOMB, STRIBECK, FALLING, TABLE, SEAL, SMOOTH, FORMULA, MEMORY = range(8)
VALUES, SLOPES, STATES, FIRST, RATE, HEADER = range(6)
"""What precedes the numbers of FORMULA and MEMORY: the addresses of both functions, the number of states, the index of
the first one in x and that of its rate in T; then, for each state, 1 if it changes its sign with the direction of slip.
"""
STATE, SINE, VERSINE, NORMAL, FRICTION, PRESS = range(6)
"""Kinds of the factors of a product."""
_SMALL = 0.8  # rad; the series is accurate to 2e-19 up to here
_SINE = tuple((-1.0) ** j / float(factorial(2 * j + 1)) for j in range(9))


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
def stribeck(N, p, coarse, fine):
    """The force of STRIBECK under the load N; coarse * fine: exp(-v / v_s), as numbers or in lanes."""
    return N * p[0] + ((N * p[1]) * coarse) * fine


def _emit_formula(context: Any, builder: Any, address: Any, numbers: Any, w: Any, N: Any, z: Any, out: Any) -> None:
    """Emit the call of a C function void(double *p, double w, double N, double *z, double *out)."""
    real = ir.DoubleType()
    kind = ir.FunctionType(ir.VoidType(), [real.as_pointer(), real, real, real.as_pointer(), real.as_pointer()])
    builder.call(builder.inttoptr(address, kind.as_pointer()), [numbers, w, N, z, out])


def _call_formula(typing: Any, address: Any, numbers: Any, first: Any, w: Any, N: Any, z: Any, out: Any) -> Emission:
    """Call one of the functions of a law with the numbers from `first` on; it reads the states z and writes `out`."""

    def codegen(context: Any, builder: Any, signature: Any, arguments: Any) -> ir.Value:
        data = [
            context.make_array(signature.args[i])(context, builder, arguments[i]).data for i in (1, 5, 6)
        ]  # numbers, z, out
        own = builder.gep(data[0], [arguments[2]])
        _emit_formula(context, builder, arguments[0], own, arguments[3], arguments[4], data[1], data[2])
        return context.get_dummy_value()

    return types.none(types.int64, numbers, types.intp, types.float64, types.float64, z, out), codegen


def _formula_value(typing: Any, address: Any, numbers: Any, first: Any, w: Any, N: Any) -> Emission:
    """The first number that a function of a law without states writes."""

    def codegen(context: Any, builder: Any, signature: Any, arguments: Any) -> ir.Value:
        data = context.make_array(signature.args[1])(context, builder, arguments[1]).data
        out = cgutils.alloca_once(builder, ir.DoubleType(), size=4)  # type: ignore[no-untyped-call]
        own = builder.gep(data, [arguments[2]])
        _emit_formula(context, builder, arguments[0], own, arguments[3], arguments[4], out, out)
        return builder.load(out)

    return types.float64(types.int64, numbers, types.intp, types.float64, types.float64), codegen


call_formula: Any = intrinsic(_call_formula)
formula_value: Any = intrinsic(_formula_value)


@inner
def _formula_slope(p, v):
    return formula_value(np.int64(p[SLOPES]), p, HEADER, max(v, 0.0), 1.0)


@inner
def _formula(p, v):
    m = formula_value(np.int64(p[VALUES]), p, HEADER, max(v, 0.0), 1.0)
    if v < 0.0:
        m += v * _formula_slope(p, 0.0)
    return m


@inlined
def unsmoothed(code, p, v):
    """The coefficient of a law without smoothing."""
    if code == STRIBECK:
        m = stribeck(1.0, p, np.exp(-v * p[2]), 1.0)
    elif code == COULOMB:
        m = p[0]
    elif code == FALLING:
        m = max(p[0] - p[1] * v, p[2])
    elif code == SEAL:
        m = _seal(p, v)
    elif code == TABLE:
        m = _from_table(p, v)
    elif code == FORMULA:
        m = _formula(p, v)
    else:
        m = 0.0  # MEMORY: `add_memory` computes its force
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


@inlined
def law_force(code, p, argument, N):
    """The force of a law under the load N. `argument`: the exponent of STRIBECK, the slip speed [m/s] of other laws."""
    if code == STRIBECK:  # the next stage waits for the exponential: keep the work before and after it short
        coarse, fine = exponential_factors(argument)
        force = stribeck(N, p, coarse, fine)
    else:
        force = coefficient(code, p, argument) * N
    return force


@kernel
def coefficient_at(code, p, v):
    """`coefficient`, from Python."""
    return coefficient(code, p, v)


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


@kernel
def slope_at(code, p, v):
    """`slope`, from Python."""
    return slope(code, p, v)


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
    if code == FORMULA:
        return _formula_slope(p, v)
    count = int(p[0])
    if v >= p[count]:
        return 0.0
    i, at = _interval(p, v)
    d = v - p[1 + i]
    return p[at + 1] + d * (2.0 * p[at + 2] + d * 3.0 * p[at + 3])


class ProductTables(NamedTuple):
    """All products of a system for the kernels, in the order of their levels, with scratch for their factors."""

    patches: NDArray[np.int64]  # [1] number of friction forces, which precede the products among the inputs
    upto: NDArray[np.int64]  # [3] number of products up to each level
    place: NDArray[np.int64]  # [factors, product] index of each factor in `values`; of a missing one, the last index
    angles: Array  # [angle, n]
    presses: Array  # [press, n]
    turns: Array  # [2 angles padded to lanes] scratch: each angle and its half, then their sines
    angle_entries: NDArray[np.int64]  # rig.solve.column_blocks.sparse_dot
    press_entries: NDArray[np.int64]
    values_at: Array  # [factor, LANE] `values` at several places of a step (rig.solve.places)
    values: Array  # everything that may be a factor, stored one after the other, and a one:
    state: Array  # [n]
    sine: Array  # [angle]
    versine: Array  # [angle]
    normal: Array  # [normal]
    friction: Array  # [patch]
    pressed: Array  # [press]


@inner
def _fill(t, begin, end, T):
    """T of the products `begin` to `end` - 1."""
    p = t.products
    place, values, patches = p.place, p.values, p.patches[0]
    for j in range(begin, end):  # unsigned: no index counts from the end
        T[np.uintp(patches + j)] = values[np.uintp(place[0, j])] * values[np.uintp(place[1, j])]
    for f in range(2, place.shape[0]):
        for j in range(begin, end):
            T[np.uintp(patches + j)] *= values[np.uintp(place[f, j])]


@inlined
def write_sines(u, first, end, out):
    """Write the sines of the angles in the lanes u to `out` [LANE].

    Together if all are small, as where a contact moves over a disc by little. Otherwise one after the other, only those
    of lanes `first` to `end` - 1; the others are 0.
    """
    if between(-_SMALL, u, _SMALL):
        z = u * u
        rest = alike(_SINE[8])
        for j in range(7, 0, -1):
            rest = _SINE[j] + z * rest
        write(u + u * (z * rest), out)
    else:
        write(alike(0.0), out)
        for q in range(first, end):
            out[q] = np.sin(lane(u, q))


@inner
def early_products(t, mode_set, x, T):
    """T of the products of levels 0 and 1, and 0 for inputs not known yet, because rows sum over all inputs."""
    p = t.products
    if p.upto[2] == 0:
        return
    for i in range(T.shape[0]):
        T[i] = 0.0
    for i in range(x.shape[0]):
        p.state[i] = x[i]
    count, turns = p.angles.shape[0], p.turns
    for a in range(count):
        angle = sparse_dot(p.angles[a], p.angle_entries[a], x)
        turns[2 * a], turns[2 * a + 1] = angle, 0.5 * angle
    for i in range(0, 2 * count, LANE):
        write_sines(lanes(turns[i:]), 0, min(2 * count - i, LANE), turns[i:])
    for a in range(count):
        half = turns[2 * a + 1]
        p.sine[a], p.versine[a] = turns[2 * a], -2.0 * half * half
    for a in range(p.presses.shape[0]):
        p.pressed[a] = max(sparse_dot(p.presses[a], p.press_entries[a], x), 0.0)
    _fill(t, 0, p.upto[0], T)
    if p.upto[2] > p.upto[0]:
        for k in range(p.normal.shape[0]):
            p.normal[k] = sparse_dot(t.press[mode_set, k], t.press_entries[mode_set, k], x) + sparse_dot(
                t.press_t[mode_set, k], t.press_t_entries[mode_set, k], T
            )
        _fill(t, p.upto[0], p.upto[1], T)


@inner
def late_products(t, mode_set, x, T):
    """T of the products of level 2."""
    p = t.products
    if p.upto[2] > p.upto[1]:
        for q in range(p.friction.shape[0]):
            p.friction[q] = sparse_dot(t.friction[mode_set, q], t.friction_entries[mode_set, q], x) + sparse_dot(
                t.friction_t[mode_set, q], t.friction_t_entries[mode_set, q], T
            )
        _fill(t, p.upto[1], p.upto[2], T)


class RandomNumbers(NamedTuple):
    """Random numbers drawn in advance."""

    state: NDArray[np.int64]  # [1] index of the state that contains the number; -1: none
    used: NDArray[np.int64]  # [1] number of used numbers
    numbers: NDArray[np.float64]


def no_random_numbers() -> RandomNumbers:
    """The record for a rig without a random input."""
    return RandomNumbers(np.array([-1]), np.array([0]), np.zeros(0))


@inner
def used_up(random_numbers: Any) -> bool:
    """Whether no number is left for another frame."""
    return random_numbers.state[0] >= 0 and random_numbers.used[0] == random_numbers.numbers.shape[0]  # type: ignore[no-any-return]


@inner
def write_next_number(random_numbers: Any, x: Any) -> None:
    """Write the next number to the state that holds it; keep that state if no number is left."""
    if random_numbers.state[0] >= 0 and not used_up(random_numbers):
        x[random_numbers.state[0]] = random_numbers.numbers[random_numbers.used[0]]
        random_numbers.used[0] += 1


class RightHandSide(NamedTuple):
    """The right-hand side of one mode set.

    It holds the tables of the mode set (see rig.model.tables.Tables), the inputs T [friction forces, products], scratch
    for them, and all tables `t`.
    """

    A: Array
    b: Array
    sigma: Array
    code: NDArray[np.int64]
    numbers: Array
    law_speed: Array
    law_load: Array
    law_load_t: Array
    coupled: int
    T: Array
    scratch: Array
    G: Array
    GT: Array
    guard_needs_inputs: NDArray[np.int64]
    mode_set: int
    t: Any


@inlined
def right_hand_side(t, mode_set, T, scratch):
    """The field of a mode set. T [inputs] and `scratch` [patch, patch] are overwritten."""
    count = t.guards[mode_set]
    return RightHandSide(
        t.A[mode_set],
        t.b[mode_set],
        t.sigma[mode_set],
        t.code[mode_set],
        t.numbers[mode_set],
        t.law_speed[mode_set],
        t.law_load[mode_set],
        t.law_load_t[mode_set],
        t.coupled[mode_set],
        T,
        scratch,
        t.G[mode_set, :count],
        t.GT[mode_set, :count],
        t.guard_needs_inputs[mode_set, :count],
        mode_set,
        t,
    )


@inlined
def friction_force(f, p, x, others):
    """The friction force of patch p at x; 0 if its friction does not depend on speed.

    mu(law_speed x) (law_load x + others): both rows carry the sign of the slip; `others` is the part of the load that
    depends on inputs. Rows are summed from their end, because the last state variables do not change during a step.
    """
    force = 0.0
    if f.sigma[p] != 0.0 and f.code[p] != 0:
        last = x.shape[0] - 1
        N = others
        for j in range(last, -1, -1):
            N += f.law_load[p, j] * x[j]
        argument = 0.0
        if f.code[p] == STRIBECK:
            argument = -(f.numbers[p, 2] * f.law_speed[p, last]) * x[last]
            for j in range(last):
                argument -= (f.numbers[p, 2] * f.law_speed[p, j]) * x[j]
        else:
            for j in range(last, -1, -1):
                argument += f.law_speed[p, j] * x[j]
        force = law_force(f.code[p], f.numbers[p], argument, N)
    return force


@inlined
def sparse_friction_force(t, mode_set, p, x, T):
    """As `friction_force`, with the part of the load that depends on products, over the entries that are not zero."""
    sigma, code, numbers = t.sigma[mode_set, p], t.code[mode_set, p], t.numbers[mode_set, p]
    force = 0.0
    if sigma != 0.0 and code != 0:
        speed, load, load_t = t.law_speed[mode_set, p], t.law_load[mode_set, p], t.law_load_t[mode_set, p]
        entries, last, N = t.law_load_t_entries[mode_set, p], x.shape[0] - 1, 0.0
        for e in range(1, entries[0] + 1):
            if entries[e] >= t.sigma.shape[1]:
                N += load_t[entries[e]] * T[entries[e]]
        entries = t.law_load_entries[mode_set, p]
        for e in range(entries[0], 0, -1):
            N += load[entries[e]] * x[entries[e]]
        entries, argument = t.law_speed_entries[mode_set, p], 0.0
        if code == STRIBECK:
            argument = -(numbers[2] * speed[last]) * x[last]
            for e in range(1, entries[0] + 1):
                if entries[e] != last:
                    argument -= (numbers[2] * speed[entries[e]]) * x[entries[e]]
        else:
            for e in range(entries[0], 0, -1):
                argument += speed[entries[e]] * x[entries[e]]
        force = law_force(code, numbers, argument, N)
    return force


@inner
def inputs(t, mode_set, x, T, scratch):
    """T = the inputs at x: friction forces of patches that slip with a speed-dependent law (else 0), products.

    `coupled`: at least one load depends on a friction force.
    """
    f = right_hand_side(t, mode_set, T, scratch)
    early_products(t, mode_set, x, T)
    patches = f.sigma.shape[0]
    m = t.memory
    for r in range(m.inputs[0], T.shape[0]):
        T[r] = 0.0
    for p in range(patches):
        T[p] = sparse_friction_force(t, mode_set, p, x, T)
        if f.code[p] == MEMORY:
            T[p] = evaluate_memory(t, mode_set, p, x, T, False)
    if f.coupled:
        solve_coupled_friction(f.sigma, f.code, f.numbers, f.law_speed, f.law_load_t, m.mu, x, T, scratch)
        for p in range(m.mu.shape[0]):
            if f.code[p] == MEMORY:
                evaluate_memory(t, mode_set, p, x, T, True)
    late_products(t, mode_set, x, T)


@by_address
def inputs_of_state(shape, t, w, state, log, seg, plan, ticks):
    """Write the inputs at w.at to w.T; a part (rig.solve.specialised)."""
    inputs(t, t.mode_set_of[state.progress[0].key], w.at, w.T, w.scratch)
    return 0


class MemoryTables(NamedTuple):
    """Scratch for laws with memory; of length zero if there is none."""

    inputs: NDArray[np.int64]  # [1] index of the first rate in T
    mu: Array  # [patch] the coefficient; 0 in stick
    states: Array  # [most states] in the direction of slip
    values: Array  # [most states + 2] mu, rates, stored energy
    slopes: Array  # [(most states + 1) (most states + 2)]


@inner
def direction_of_memory(t, mode_set, p, x):
    """The direction of slip and the slip speed in it: of the mode, or, without load, of the motion; in stick 0."""
    sigma = t.sigma[mode_set, p]
    speed = dot(t.slip[p], x)
    if sigma != 0.0:
        return sigma, sigma * speed
    if not (is_zero(t.load[mode_set, p]) and is_zero(t.load_t[mode_set, p])):
        return 1.0, 0.0
    return (-1.0 if speed < 0.0 else 1.0), abs(speed)


@inner
def arguments_of_memory(t, mode_set, p, x, T, coupled):
    """The direction of slip, the slip speed in it and the load of patch p, a law with memory; its states as arguments.

    `coupled`: the load is to include what depends on friction forces.
    """
    numbers, m = t.numbers[mode_set, p], t.memory
    N = dot(t.load[mode_set, p], x)
    for q in range(0 if coupled else t.slip.shape[0], m.inputs[0]):
        N += t.load_t[mode_set, p, q] * T[q]
    sign, w = direction_of_memory(t, mode_set, p, x)
    for i in range(int(numbers[STATES])):
        m.states[i] = x[int(numbers[FIRST]) + i] * (sign if numbers[HEADER + i] != 0.0 else 1.0)
    return sign, w, N


@inner
def evaluate_memory(t, mode_set, p, x, T, coupled):
    """Write the rates of patch p, a law with memory, to T; the result is its friction force, in stick the limit.

    `coupled`: as in `arguments_of_memory`. Below w = 0 the formulas are continued linearly.
    """
    numbers, m = t.numbers[mode_set, p], t.memory
    count, rate = int(numbers[STATES]), int(numbers[RATE])
    sign, w, N = arguments_of_memory(t, mode_set, p, x, T, coupled)
    call_formula(np.int64(numbers[VALUES]), numbers, HEADER + count, max(w, 0.0), N, m.states, m.values)
    if w < 0.0:
        call_formula(np.int64(numbers[SLOPES]), numbers, HEADER + count, 0.0, N, m.states, m.slopes)
        for i in range(count + 1):
            m.values[i] += w * m.slopes[i * (count + 2)]
    for i in range(count):
        T[rate + i] = m.values[1 + i] * (sign if numbers[HEADER + i] != 0.0 else 1.0)
    m.mu[p] = m.values[0] if t.sigma[mode_set, p] != 0.0 else 0.0
    return sign * m.values[0] * N


@inner
def solve_coupled_friction(sigma, code, numbers, law_speed, law_load_t, memory, x, T, M):
    """Solve T = T0 + diag(mu) bear_t T for the friction forces T; T holds T0 at first. M is scratch.

    `memory` [patch]: the coefficients of laws with memory.

    Gaussian elimination without pivoting, because the matrix is the identity plus a small coupling.
    """
    P = sigma.shape[0]
    for p in range(P):
        m = 0.0
        if sigma[p] != 0.0 and code[p] != 0:
            if code[p] == MEMORY:
                m = memory[p]
            else:
                m = coefficient(code[p], numbers[p], dot(law_speed[p], x))
        for r in range(P):
            M[p, r] = -m * law_load_t[p, r]
        M[p, p] += 1.0
    for p in range(P):
        for q in range(p + 1, P):
            f = M[q, p] / M[p, p]
            for r in range(p, P):
                M[q, r] -= f * M[p, r]
            T[q] -= f * T[p]
    for p in range(P - 1, -1, -1):
        for r in range(p + 1, P):
            T[p] -= M[p, r] * T[r]
        T[p] /= M[p, p]


@inlined
def needs_inputs(shape, f):
    """Whether the derivative needs all inputs. Otherwise each friction force depends on the state alone."""
    return has_products(shape) or f.coupled


@inlined
def rates_without_inputs(shape, f, x, k):
    """Write A x to k."""
    for i in range(state_count(shape)):
        s = 0.0
        for j in range(state_count(shape)):
            s += f.A[i, j] * x[j]
        k[i] = s


@inlined
def derivative_by_state(shape, f, nonlinear, x, k):
    """The derivative k of a rig that does not need all inputs, whose friction forces are not stored in memory."""
    rates_without_inputs(shape, f, x, k)
    if nonlinear:
        for p in range(f.sigma.shape[0]):
            force = friction_force(f, p, x, 0.0)
            for i in range(state_count(shape)):
                k[i] += f.b[i, p] * force


@inlined
def derivative_by_inputs(shape, f, x, k):
    """The derivative k = A x + b T with the inputs T = f.T."""
    if has_products(shape) and f.t.A_entries.shape[1]:
        for i in range(state_count(shape)):
            s = sparse_dot(f.A[i], f.t.A_entries[f.mode_set, i], x)
            entries = f.t.b_entries[f.mode_set, i]  # one sum, in the order of the dense rows: their bits
            for e in range(1, entries[0] + 1):
                at = np.uintp(entries[e])
                s += f.b[i, at] * f.T[at]
            k[i] = s
        return
    rates_without_inputs(shape, f, x, k)
    for i in range(state_count(shape)):
        for p in range(f.T.shape[0]):
            k[i] += f.b[i, p] * f.T[p]
