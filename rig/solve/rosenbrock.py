"""RODAS5P, an L-stable Rosenbrock method of order 5(4), in place of the explicit steps of dopri5.

x' = F(x) = A x + b T(x). A step of length h solves eight systems of linear equations with one matrix,

    (1/(gamma h) - J) u_i = F(x + sum_j a_ij u_j) + sum_j c_ij u_j / h,    J = A + b dT/dx,

so no eigenvalue limits the step, neither of A nor of a friction law. The Jacobian J is exact, on which the order
depends; it is computed anew in every trial step, and needs a small part of its time. Time enters through states only
(generators, ramps). Step control, dense output, events and energy terms are those of dopri5: its `stretch` calls
`take_implicit_steps` instead of `take_steps`.

Source: Steinebach, Construction of Rosenbrock-Wanner method Rodas5P and numerical benchmarks within the Julia
Differential Equations package, BIT 63 (2023) 27.
"""

from __future__ import annotations

import numpy as np

from rig.compiled.kernel import by_address, inlined, inner
from rig.compiled.records import lent
from rig.solve.column_blocks import ROUND, copy, dot, is_zero, rounding
from rig.solve.dopri5 import (
    ENDED,
    EVENT_FREE,
    FAILED,
    ROUNDED,
    SAFETY,
    SHARE,
    SHRINK,
    UNDECIDED,
    accept_step,
    free_of_events,
    log_ticks,
    raise_scales,
    set_generators,
    step_factor,
)
from rig.solve.forces import (
    FIRST,
    HEADER,
    MEMORY,
    RATE,
    SLOPES,
    STATES,
    VALUES,
    arguments_of_memory,
    call_formula,
    coefficient,
    derivative_by_state,
    right_hand_side,
    slope,
)
from rig.solve.specialised import any_shape, call, has_products, local, local_square, state_count

STAGES = 8
_ONE_OPERATION = 2.0**-53 / ROUND  # share of `rounding`, which allows for many
_SHARE_LOST = 1e-2  # of the friction force
_SHARE_UNSURE = 1e-3  # of the friction force in one step. # chosen
_SMALL = 1e-6  # coefficient of friction
GAMMA = 0.21193756319429014
_A6 = (-7.502846399306121, 2.561846144803919, -11.627539656261098, -0.18268767659942256, 0.030198172008377946)
A = np.array(
    [
        (*row, *[0.0] * (STAGES - len(row)))
        for row in (
            (),
            (3.0,),
            (2.849394379747939, 0.45842242204463923),
            (-6.954028509809101, 2.489845061869568, -10.358996098473584),
            (2.8029986275628964, 0.5072464736228206, -0.3988312541770524, -0.04721187230404641),
            _A6,
            (*_A6, 1.0),
            (*_A6, 1.0, 1.0),
        )
    ]
)
"""Weights a_ij. The end of the step is the state of the last stage plus u_8, which is the error of the step."""
C = np.array(
    [
        (*row, *[0.0] * (STAGES - len(row)))
        for row in (
            (),
            (-14.155112264123755,),
            (-17.97296035885952, -2.859693295451294),
            (147.12150275711716, -1.41221402718213, 71.68940251302358),
            (165.43517024871676, -0.4592823456491126, 42.90938336958603, -5.961986721573306),
            (24.854864614690072, -3.0009227002832186, 47.4931110020768, 5.5814197821558125, -0.6610691825249471),
            (
                30.91273214028599,
                -3.1208243349937974,
                77.79954646070892,
                34.28646028294783,
                -19.097331116725623,
                -28.087943162872662,
            ),
            (
                37.80277123390563,
                -3.2571969029072276,
                112.26918849496327,
                66.9347231244047,
                -40.06618937091002,
                -54.66780262877968,
                -9.48861652309627,
            ),
        )
    ]
)
"""Weights c_ij."""
DENSE = np.array(
    [
        (
            25.948786856663858,
            -2.5579724845846235,
            10.433815404888879,
            -2.3679251022685204,
            0.524948541321073,
            1.1241088310450404,
            0.4272876194431874,
            -0.17202221070155493,
        ),
        (
            -9.91568850695171,
            -0.9689944594115154,
            3.0438037242978453,
            -24.495224566215796,
            20.176138334709044,
            15.98066361424651,
            -6.789040303419874,
            -6.710236069923372,
        ),
        (
            11.419903575922262,
            2.8879645146136994,
            72.92137995996029,
            80.12511834622643,
            -52.072871366152654,
            -59.78993625266729,
            -0.15582684282751913,
            4.883087185713722,
        ),
    ]
)
"""Weights g of the dense output x + theta (y - x) + theta (1 - theta) (g_0 + theta (g_1 + theta g_2)) . u."""


@inner
def add_factor_slope(t, mode_set, place, weight, S, row):
    """Add `weight` times the derivative of the product factor at `place` of the values over the state to `row` [n]."""
    p, n = t.products, row.shape[0]
    at = place
    if at < n:
        row[at] += weight
        return
    at -= n
    if at < p.sine.shape[0]:
        for i in range(n):
            row[i] += weight * (1.0 + p.versine[at]) * p.angles[at, i]
        return
    at -= p.sine.shape[0]
    if at < p.versine.shape[0]:
        for i in range(n):
            row[i] -= weight * p.sine[at] * p.angles[at, i]
        return
    at -= p.versine.shape[0]
    if at < p.normal.shape[0] + p.friction.shape[0]:
        if at < p.normal.shape[0]:
            rows, rows_t = t.press[mode_set, at], t.press_t[mode_set, at]
        else:
            at -= p.normal.shape[0]
            rows, rows_t = t.friction[mode_set, at], t.friction_t[mode_set, at]
        for i in range(n):
            row[i] += weight * rows[i]
        for j in range(rows_t.shape[0]):
            if rows_t[j] != 0.0:
                for i in range(n):
                    row[i] += weight * rows_t[j] * S[j, i]
        return
    at -= p.normal.shape[0] + p.friction.shape[0]
    if p.pressed[at] > 0.0:
        for i in range(n):
            row[i] += weight * p.presses[at, i]


@inner
def fill_slopes(t, mode_set, begin, end, S):
    """Write the derivatives of the products `begin` to `end` - 1 to their rows of S; their factors are known."""
    p = t.products
    for j in range(begin, end):
        for f in range(p.place.shape[0]):
            weight = 1.0
            for other in range(p.place.shape[0]):
                if other != f:
                    weight *= p.values[p.place[other, j]]
            if weight != 0.0 and p.place[f, j] < p.values.shape[0] - 1:
                add_factor_slope(t, mode_set, p.place[f, j], weight, S, S[p.patches[0] + j])


@inlined
def friction_slopes(f, p, x, others):
    """The derivatives of the friction force of patch p by its slip speed and by its load, both in the sense of slip.

    `others`: the part of the load that depends on inputs. 0, 0 if the friction force does not depend on speed.
    """
    by_speed, by_load = 0.0, 0.0
    if f.sigma[p] != 0.0 and f.code[p] != 0:
        v, N = 0.0, others
        for j in range(x.shape[0]):
            v += f.law_speed[p, j] * x[j]
            N += f.law_load[p, j] * x[j]
        by_speed, by_load = N * slope(f.code[p], f.numbers[p], v), coefficient(f.code[p], f.numbers[p], v)
    return by_speed, by_load


@inner
def memory_slopes(t, mode_set, p, x, T, S, coupled):
    """Write the derivatives of patch p, a law with memory, to S; rig.solve.forces.evaluate_memory for the arguments.

    Those of its rates if `coupled`; otherwise those of its friction force, without what friction forces add to its
    load, and the result is its coefficient.
    """
    numbers, m, patches = t.numbers[mode_set, p], t.memory, t.slip.shape[0]
    count, first, rate = int(numbers[STATES]), int(numbers[FIRST]), int(numbers[RATE])
    sign, w, N = arguments_of_memory(t, mode_set, p, x, T, coupled)
    free = t.sigma[mode_set, p] != 0.0 or (is_zero(t.load[mode_set, p]) and is_zero(t.load_t[mode_set, p]))
    w = max(w, 0.0)
    call_formula(np.int64(numbers[VALUES]), numbers, HEADER + count, w, N, m.states, m.values)
    call_formula(np.int64(numbers[SLOPES]), numbers, HEADER + count, w, N, m.states, m.slopes)
    mu = m.values[0]
    whole = N
    if not coupled:
        for q in range(patches):
            whole += t.load_t[mode_set, p, q] * T[q]
    begin, end = (1, count + 1) if coupled else (0, 1)
    for row in range(begin, end):
        d, to = m.slopes[row * (count + 2) :], S[rate + row - 1 if coupled else p]
        along = sign if not coupled or numbers[HEADER + row - 1] != 0.0 else 1.0
        for j in range(x.shape[0]):
            load = t.load[mode_set, p, j]
            for q in range(0 if coupled else patches, m.inputs[0]):
                load += t.load_t[mode_set, p, q] * S[q, j]
            change = d[1] * load
            if free:
                change += d[0] * (sign * t.slip[p, j])
            to[j] = along * (change if coupled else whole * change + mu * load)
        for i in range(count):
            inward = sign if numbers[HEADER + i] != 0.0 else 1.0
            to[first + i] += along * (1.0 if coupled else whole) * d[2 + i] * inward
    return mu if t.sigma[mode_set, p] != 0.0 else 0.0


@inner
def input_slopes(t, mode_set, x, T, S, M):
    """S [inputs, n] = dT/dx at x, where T are the inputs. M [patch, patch] is scratch."""
    f, patches, n = right_hand_side(t, mode_set, T, M), t.sigma.shape[1], x.shape[0]
    for k in range(S.shape[0]):
        for i in range(n):
            S[k, i] = 0.0
    p = t.products
    if p.upto[2] > 0:
        fill_slopes(t, mode_set, 0, p.upto[0], S)
        fill_slopes(t, mode_set, p.upto[0], p.upto[1], S)
    for a in range(patches):
        if f.code[a] == MEMORY:
            by_load = memory_slopes(t, mode_set, a, x, T, S, False)
        else:
            by_speed, by_load = friction_slopes(f, a, x, dot(f.law_load_t[a], T))
            for i in range(n):
                S[a, i] = by_speed * f.law_speed[a, i] + by_load * f.law_load[a, i]
            for k in range(patches, S.shape[0]):
                if f.law_load_t[a, k] != 0.0:
                    for i in range(n):
                        S[a, i] += by_load * f.law_load_t[a, k] * S[k, i]
        for k in range(patches):
            M[a, k] = (1.0 if k == a else 0.0) - by_load * f.law_load_t[a, k]
    if f.coupled:  # as rig.solve.forces.solve_coupled_friction
        for a in range(patches):
            for k in range(a + 1, patches):
                factor = M[k, a] / M[a, a]
                for j in range(a, patches):
                    M[k, j] -= factor * M[a, j]
                for i in range(n):
                    S[k, i] -= factor * S[a, i]
        for a in range(patches - 1, -1, -1):
            for i in range(n):
                for k in range(a + 1, patches):
                    S[a, i] -= M[a, k] * S[k, i]
                S[a, i] /= M[a, a]
    for a in range(patches):
        if f.code[a] == MEMORY:
            memory_slopes(t, mode_set, a, x, T, S, True)
    if p.upto[2] > p.upto[1]:
        fill_slopes(t, mode_set, p.upto[1], p.upto[2], S)


@by_address
def input_slopes_of_state(shape, t, w, state, log, seg, plan, ticks):
    """w.slopes [inputs, n] = dT/dx at state.x, and w.T = the inputs there; a part (rig.solve.specialised)."""
    copy(state.x.shape[0], state.x, w.at)
    call(plan.inputs_of_state, any_shape(state.x.shape[0]), t, w, state, log, seg, plan, 0)
    input_slopes(t, t.mode_set_of[state.progress[0].key], state.x, w.T, w.slopes, w.scratch)
    return 0


@inlined
def write_matrix(shape, f, plain, x, h, M, t, w, state, log, seg, plan):
    """Write 1/(gamma h) - J at x to M, column after column (M[j, i] is row i, column j).

    `plain`: the friction forces depend on the state alone, and there are no products.
    """
    n = state_count(shape)
    for j in range(n):
        for i in range(n):
            M[j, i] = -f.A[i, j]
        M[j, j] += 1.0 / (GAMMA * h)
    if plain:
        for p in range(f.sigma.shape[0]):
            by_speed, by_load = friction_slopes(f, p, x, 0.0)
            for j in range(n):
                by_state = by_speed * f.law_speed[p, j] + by_load * f.law_load[p, j]
                for i in range(n):
                    M[j, i] -= f.b[i, p] * by_state
    else:
        call(plan.input_slopes_of_state, any_shape(n), t, w, state, log, seg, plan, 0)
        S = w.slopes
        for k in range(S.shape[0]):
            for j in range(n):
                if S[k, j] != 0.0:
                    for i in range(n):
                        M[j, i] -= f.b[i, k] * S[k, j]


@inlined
def factorise(shape, M, order):
    """Replace the matrix M, stored column after column, by its factors; row i of them is row order[i] of the matrix.

    Gaussian elimination with partial pivoting. The diagonal holds the reciprocals of the pivots.
    """
    n = state_count(shape)
    for i in range(n):
        order[i] = i
    for k in range(n):
        pivot = k
        for i in range(k + 1, n):
            if abs(M[k, i]) > abs(M[k, pivot]):
                pivot = i
        if pivot != k:
            order[k], order[pivot] = order[pivot], order[k]
            for j in range(n):
                M[j, k], M[j, pivot] = M[j, pivot], M[j, k]
        M[k, k] = 1.0 / M[k, k]
        for i in range(k + 1, n):
            M[k, i] *= M[k, k]
        for j in range(k + 1, n):
            for i in range(k + 1, n):
                M[j, i] -= M[k, i] * M[j, k]


@inlined
def solve(shape, M, order, right, u):
    """Solve the factorised equations for the right-hand side `right` [n]; u [n] is the solution."""
    n = state_count(shape)
    for i in range(n):
        u[i] = right[order[i]]
    for k in range(n):
        for i in range(k + 1, n):
            u[i] -= M[k, i] * u[k]
    for k in range(n - 1, -1, -1):
        u[k] *= M[k, k]
        for i in range(k):
            u[i] -= M[k, i] * u[k]


@inner
def friction_slope(t, mode_set, p, x, T):
    """The coefficient of patch p, a law with memory, at x and its derivative over the slip speed [s/m]; its load."""
    m, numbers = t.memory, t.numbers[mode_set, p]
    _, w, N = arguments_of_memory(t, mode_set, p, x, T, False)
    w, size = max(w, 0.0), HEADER + int(numbers[STATES])
    call_formula(np.int64(numbers[VALUES]), numbers, size, w, N, m.states, m.values)
    call_formula(np.int64(numbers[SLOPES]), numbers, size, w, N, m.states, m.slopes)
    return m.values[0], m.slopes[0], N


@inner
def slip_is_lost(t, mode_set, x, h, T):
    """Whether slip under a law with memory settles within h at a speed whose rounding changes its friction.

    Where the slip speed only passes through zero, it has no time to settle.
    """
    for p in range(t.slip.shape[0]):
        if t.code[mode_set, p] == MEMORY and t.sigma[mode_set, p] != 0.0:
            uncertain = rounding(t.slip[p], x) * _ONE_OPERATION
            if abs(dot(t.slip[p], x)) < uncertain / _SMALL:
                mu, steep, N = friction_slope(t, mode_set, p, x, T)
                settles = abs(steep * N * dot(t.slip[p], t.b[mode_set, :, p])) * h > 1.0
                if settles and abs(steep) * uncertain > max(_SHARE_LOST * abs(mu), _SMALL):
                    return True
    return False


@inner
def friction_error(t, mode_set, x, y, e, size, T):
    """The error of the friction of laws with memory in a step from x to y with the local error e, over what is allowed.

    The slip speed is a difference of states, whose errors are scaled by the states. Near w = 0 friction may rise within
    less than that (rate and state friction: over 1e-12 m/s), and the error estimate itself, which is linear, holds
    only where the slope of the friction does. Where an error of the slip speed is a small share of it, no law is
    that steep.
    """
    worst = 0.0
    for p in range(t.slip.shape[0]):
        sigma = t.sigma[mode_set, p]
        if t.code[mode_set, p] == MEMORY and sigma != 0.0:
            error = abs(dot(t.slip[p], e))
            begin, end = sigma * dot(t.slip[p], x), sigma * dot(t.slip[p], y)
            if error > _SHARE_UNSURE * min(begin, end) and error > rounding(t.slip[p], size):
                mu, steep, _ = friction_slope(t, mode_set, p, x, T)
                if end > 0.0:  # else the step contains a reversal, where it will end
                    mu_end, steep_end, _ = friction_slope(t, mode_set, p, y, T)
                    mu, steep = max(abs(mu), abs(mu_end)), max(abs(steep), abs(steep_end))
                worst = max(worst, abs(steep) * error / max(_SHARE_UNSURE * abs(mu), _SMALL))
    return worst


@by_address
def memory_errors(shape, t, w, state, log, seg, plan, ticks):
    """Whether slip under a law with memory is lost in a step from state.x to w.y, with the local error w.rates.

    If not, w.right[0] is the error of the friction over what is allowed. A part (rig.solve.specialised).
    """
    mode_set, x, h = t.mode_set_of[state.progress[0].key], state.x, state.progress[0].step_length
    if slip_is_lost(t, mode_set, x, h, w.T) and slip_is_lost(t, mode_set, w.y, h, w.T):
        return 1
    w.right[0] = friction_error(t, mode_set, x, w.y, w.rates, w.size, w.T)
    return 0


@inlined
def local_error(shape, e, y, size, tolerance):
    """The largest local error e of the step; as rig.solve.dopri5.local_error."""
    worst = 0.0
    for i in range(state_count(shape)):
        if not (abs(e[i]) + abs(y[i]) < np.inf):
            return np.inf
        largest = max(size[i], abs(y[i]))
        if largest > 0.0:
            worst = max(worst, abs(e[i]) * (1.0 / (SHARE * tolerance * largest)))
    return worst


@inlined
def quartic_of_step(shape, u, x, y, d):
    """Coefficients d[0..4] of the quartic through the step, in powers of theta."""
    for i in range(state_count(shape)):
        g0, g1, g2 = 0.0, 0.0, 0.0
        for j in range(STAGES):
            g0 += DENSE[0, j] * u[j, i]
            g1 += DENSE[1, j] * u[j, i]
            g2 += DENSE[2, j] * u[j, i]
        d[0, i] = x[i]
        d[1, i] = (y[i] - x[i]) + g0
        d[2, i] = g1 - g0
        d[3, i] = g2 - g1
        d[4, i] = -g2


@by_address
def take_implicit_steps(shape, t, w, state, log, seg, plan, ticks):
    """Take steps from state.x to the end of the ticks, or to a step that `stretch` must handle.

    As rig.solve.dopri5.take_steps, with the same results, of w.k only the derivative w.k[0].
    """
    n, tick_length, mode_set = state_count(shape), t.step[0], t.mode_set_of[state.progress[0].key]
    now, x, size = state.progress[0], state.x, w.size
    looked = plan.with_energy or plan.emitting
    f = lent(right_hand_side(t, mode_set, w.T, w.scratch))
    plain, remembers = not (has_products(shape) or f.coupled), t.memory.values.shape[0] > 0
    inside = plain and not plan.many_states
    u, M, order = local(shape, w.stages), local_square(shape, w.matrix), local(shape, w.row_order)
    y, rates, right, d = local(shape, w.y), local(shape, w.y2), local(shape, w.right), local(shape, w.derivatives)
    here = local(shape, w.copy)
    tick, place, next_h, hoped, most = now.tick, now.place, now.next_length, now.suggested_length, now.trial_limit
    copy(n, x, here)
    if hoped == 0.0:
        copy(n, x, w.at)
        call(plan.whole_derivative, shape, t, w, state, log, seg, plan, 0)
        raise_scales(x, w.rates, t.damping.shape[1], tick_length, size)
    ends = ENDED
    while tick < ticks:
        left = ((ticks - tick) - place) * tick_length
        h = next_h if next_h < left - 1e-9 * tick_length else left
        copy(n, here, x)
        write_matrix(shape, f, plain, x, h, M, t, w, state, log, seg, plan)
        factorise(shape, M, order)
        for s in range(STAGES):
            for i in range(n):
                y[i], right[i] = here[i], 0.0
            for j in range(s):
                for i in range(n):
                    y[i] += A[s, j] * u[j, i]
                    right[i] += C[s, j] * u[j, i]
            if inside:
                derivative_by_state(shape, f, True, y, rates)
            else:
                copy(n, y, w.at)
                call(plan.whole_derivative, shape, t, w, state, log, seg, plan, 0)
                copy(n, w.rates, rates)
            if s == 0:
                copy(n, rates, w.k[0])
            for i in range(n):
                right[i] = rates[i] + right[i] * (1.0 / h)
            solve(shape, M, order, right, u[s])
        for i in range(n):
            y[i] += u[STAGES - 1, i]
        e = local_error(shape, u[STAGES - 1], y, size, plan.tolerance)
        now.trials += 1
        if remembers and e <= 1.0:
            now.step_length = h
            copy(n, y, w.y)
            copy(n, u[STAGES - 1], w.rates)
            if call(plan.memory_errors, any_shape(n), t, w, state, log, seg, plan, 0):
                ends = ROUNDED
                break
            e = max(e, w.right[0])
        if not (e <= 1.0):
            next_h = h * max(SHRINK, SAFETY * e ** (-0.2))
            if next_h < 1e-14 * tick_length or now.trials > most:
                ends = FAILED
                break
            now.next_length = next_h
            call(plan.raise_to_rounding, any_shape(n), t, w, state, log, seg, plan, 0)
            continue
        grow = step_factor(e)
        if h >= next_h or grow < 1.0:  # the error is likely to go on growing
            next_h = h * max(SHRINK, min(grow, (grow * grow) * (h / hoped)))
        hoped = h * grow
        quartic_of_step(shape, u, here, y, d)
        plain_path = free_of_events(shape, f, d, 4, size)
        if looked or not plain_path:
            now.step_length = h
            copy(n, y, w.y)
            for c in range(5):
                copy(n, d[c], w.derivatives[c])
            ends = EVENT_FREE if plain_path else UNDECIDED
            break
        tick, place, done = log_ticks(shape, log, d, 4, mode_set, tick, place, ticks, tick_length / h, h == left)
        if done < 1.0:
            place += (1.0 - done) * h / tick_length
        set_generators(shape, t, w, ((tick - now.reached) + place) * tick_length, y)
        accept_step(shape, t, mode_set, w, y, x, here)
    now.tick, now.place, now.next_length, now.suggested_length = tick, place, next_h, hoped
    copy(n, here, x)
    return ends
