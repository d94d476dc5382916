"""Dormand-Prince 5(4) with dense output and events, for mode sets that are not linear.

x' = A x + b T(x), with speed-dependent friction forces and products as inputs T. Steps are not cut at ticks: the
quartic dense output gives the state there. Guards are polynomials along the dense output; the first event ends the
step. Stick is linear for any friction law; without products it is left to the exact propagator. Undamped generators,
such as dither, are set to their exact values after every step. The friction law is continued smoothly through w = 0, so
a trial step beyond an event keeps its order.

Source: Dormand and Prince, J. Comp. Appl. Math. 6 (1980) 19; dense output: Hairer, Norsett, Wanner, Solving Ordinary
Differential Equations I, section II.6.

A guard that is a row over the state is a quartic too. A guard that depends on the inputs is approximated by a quartic.
The guard itself is evaluated to estimate the error of this fit and to confirm the event that the fit predicts.
"""

from __future__ import annotations

import numpy as np

from rig.compiled.kernel import by_address, inlined, inner
from rig.compiled.records import lent
from rig.solve.column_blocks import LANE, ROUND, alike, copy, dot, lane, lanes, rounding
from rig.solve.contact_state import apply_event, project_stick
from rig.solve.forces import inputs, right_hand_side
from rig.solve.places import PART, add_powers, inputs_at, row_times, states_at, write_output_quartic, write_quartic
from rig.solve.roots import NONE, first_crossing
from rig.solve.runge_kutta_stage import begin_stages, complete_derivative, derivative, patch_friction, stage
from rig.solve.segment_output import close_segment, nearly_full, part_of_quartic, quartic_coefficients
from rig.solve.specialised import any_shape, call, local, state_count

C = (0.0, 1 / 5, 3 / 10, 4 / 5, 8 / 9, 1.0, 1.0)
A = (
    (),
    (1 / 5,),
    (3 / 40, 9 / 40),
    (44 / 45, -56 / 15, 32 / 9),
    (19372 / 6561, -25360 / 2187, 64448 / 6561, -212 / 729),
    (9017 / 3168, -355 / 33, 46732 / 5247, 49 / 176, -5103 / 18656),
    (35 / 384, 0.0, 500 / 1113, 125 / 192, -2187 / 6784, 11 / 84),
)
B = (*A[6], 0.0)
E = (71 / 57600, 0.0, -71 / 16695, 71 / 1920, -17253 / 339200, 22 / 525, -1 / 40)
"""Differences from the weights of the embedded method of fourth order."""
D = (
    -12715105075 / 11282082432,
    0.0,
    87487479700 / 32700410799,
    -10690763975 / 1880347072,
    701980252875 / 199316789632,
    -1453857185 / 822651844,
    69997945 / 29380423,
)
"""Weights of the last coefficient of the dense output."""

ENDED, UNDECIDED, EVENT_FREE, FAILED, ROUNDED = range(5)  # results of `take_steps`
_EARLY = 0.5  # share of a step
PROBE = 0.9  # place in a step where the error of a quartic through the quarters is largest
_OFF = 4.0  # safety factor on the error found there: bounds it everywhere
_FAINT = 0.03  # share of the rounding bound of a guard: its actual rounding error
SAFETY = 0.9  # share of the step that an error estimate allows
SHRINK = 0.2  # smallest factor from a step to the next
_GROW = 5.0  # largest factor from a step to the next
_LEAST = 1e-6  # share of the largest coordinate or speed
_MOST = 200_000  # trial steps for one tick
SHARE = 0.7  # share of the tolerance that a local error may use; keeps event times within ten times the tolerance


@inlined
def quartic_of_step(shape, k, x, y, h, d):
    """Coefficients d[0..4] of the quartic through the step, in powers of theta."""
    n = state_count(shape)
    for i in range(n):
        difference = y[i] - x[i]
        bulge = h * k[0, i] - difference
        r3 = difference - h * k[6, i] - bulge
        r4 = D[0] * k[0, i] + D[2] * k[2, i] + D[3] * k[3, i] + D[4] * k[4, i] + D[5] * k[5, i] + D[6] * k[6, i]
        r4 *= h
        # x + th (difference + (1 - th)(bulge + th (r3 + (1 - th) r4)))
        d[0, i] = x[i]
        d[1, i] = difference + bulge
        d[2, i] = -bulge + r3 + r4
        d[3, i] = -r3 - 2.0 * r4
        d[4, i] = r4


@inlined
def evaluate_path(shape, d, degree, theta, x):
    """Evaluate the dense output, of `degree`, at theta and write the state to x."""
    for i in range(state_count(shape)):
        value = d[degree, i]
        for c in range(degree - 1, -1, -1):
            value = d[c, i] + theta * value
        x[i] = value


@inner
def guard_value(t, mode_set, w, degree, g, theta):
    """The value of guard g, which depends on the inputs, at theta of the dense output."""
    evaluate_path(any_shape(w.y2.shape[0]), w.derivatives, degree, theta, w.y2)
    inputs(t, mode_set, w.y2, w.T, w.scratch)
    return dot(t.G[mode_set, g], w.y2) + dot(t.GT[mode_set, g], w.T)


@inlined
def guard_zero(t, mode_set, w, degree, g, theta, noise):
    """The place where guard g itself becomes zero, at most `noise` below zero; NONE if it has no zero.

    `theta`: zero of its fit. The state at the event has to agree with the event. A contact released only by the error
    of the fit would not move off; it would stick again at once.
    """
    low, high = theta, theta
    above = below = guard_value(t, mode_set, w, degree, g, theta)
    if above > 0.0:  # the fit was early: search up to its next node, where fit and guard agree
        if theta >= 1.0:
            return NONE
        high = min(0.25 * (np.floor(4.0 * theta) + 1.0), 1.0)
        below = guard_value(t, mode_set, w, degree, g, high)
        if below > 0.0:
            return NONE
    elif theta > 0.0:
        low = 0.25 * (np.ceil(4.0 * theta) - 1.0)
        above = guard_value(t, mode_set, w, degree, g, low)
    kept = 0  # the end kept by the last secant; its value is halved if it is kept twice (Illinois)
    while above > 0.0 and below < -noise:
        u = low + (high - low) * above / (above - below)
        if not low < u < high:
            u = 0.5 * (low + high)
            if not low < u < high:
                break
        value = guard_value(t, mode_set, w, degree, g, u)
        if value > 0.0:
            low, above = u, value
            if kept == 1:
                below *= 0.5
            kept = 1
        else:
            high, below = u, value
            if kept == -1:
                above *= 0.5
            kept = -1
    return high


@inlined
def sample_guards(t, mode_set, w, degree):
    """Evaluate the guards that depend on the inputs, at the quarters of the step and at `PROBE`.

    w.fits[g, 0..5] = values; w.fits[g, 6] = bound on their rounding error.
    """
    needed, fits = False, w.guard_samples
    for g in range(t.guards[mode_set]):
        if t.guard_needs_inputs[mode_set, g]:
            needed = True
            fits[g, 6] = 0.0
    if needed:
        states_at(w.derivatives, degree, lanes(w.probes), w.x_at)
        inputs_at(t, mode_set, w, 0, 6)
        for g in range(t.guards[mode_set]):
            if t.guard_needs_inputs[mode_set, g]:
                values = row_times(t.G[mode_set, g], w.x_at) + row_times(t.GT[mode_set, g], w.T_at)
                for q in range(6):
                    fits[g, q] = lane(values, q)
                    error = 0.0
                    for j in range(w.T_at.shape[0]):
                        error += abs(t.GT[mode_set, g, j] * w.T_at[j, q])
                    fits[g, 6] = max(fits[g, 6], error * ROUND)


@inlined
def first_event_of_fit(t, mode_set, w, degree, g, noise):
    """The first event of guard g, which depends on the inputs, and whether the step is too long to be sure.

    Returns theta (or NONE) and a flag. The guard is fitted by a quartic through five points; a sixth point gives the
    error of the fit. The flag is set if, within this error, an event is possible in an earlier quarter than the one
    found.
    """
    fit, poly = w.guard_samples[g], w.poly
    poly[0], poly[1], poly[2], poly[3], poly[4] = quartic_coefficients(fit[0], fit[1], fit[2], fit[3], fit[4])
    value = poly[0] + PROBE * (poly[1] + PROBE * (poly[2] + PROBE * (poly[3] + PROBE * poly[4])))
    off = _OFF * abs(value - fit[5])
    if off <= noise:
        off = 0.0
    poly[0] -= off
    early = theta = first_crossing(poly, 4, noise, w.roots)
    poly[0] += off
    if early < NONE:
        if off > 0.0:
            theta = first_crossing(poly, 4, noise, w.roots)
        if theta < NONE:
            theta = guard_zero(t, mode_set, w, degree, g, theta, _FAINT * noise)
    return theta, int(4.0 * early) < int(4.0 * theta)


@inner
def may_rise(t, mode_set, g, w, h, noise):
    """Whether guard g, zero at the begin of a step h, may rise there, by the derivative w.k[0] and its rounding."""
    rise, error = 0.0, 0.0
    for i in range(w.y.shape[0]):
        entry = t.G[mode_set, g, i]
        if entry != 0.0:
            rise += entry * w.k[0, i]
            error += abs(entry) * (rounding(t.A[mode_set, i], w.derivatives[0]) + rounding(t.b[mode_set, i], w.T))
    return h * (rise + error) >= -noise


@inner
def first_event(t, mode_set, w, degree, h):
    """The first event of any guard along the dense output in w.derivatives of a step h.

    Returns theta (or NONE), the guard, and whether the step is too long to be sure. The flag is also set if a guard
    begins at zero, as after a contact was released, and has its event early in the step without falling at the begin.
    The guard is small there, but the error of the step is not, so the event may be nothing but this error. Whether it
    falls at the begin, the derivative w.k[0] decides too: the dense output of rosenbrock begins with its own error.
    """
    first, guard, doubtful = NONE, -1, False
    sample_guards(t, mode_set, w, degree)
    poly = w.poly
    for g in range(t.guards[mode_set]):
        noise = rounding(t.G[mode_set, g], w.size)
        unseen = False
        if t.guard_needs_inputs[mode_set, g]:
            noise = max(noise, w.guard_samples[g, 6])
            theta, unseen = first_event_of_fit(t, mode_set, w, degree, g, noise)
        else:
            for c in range(degree + 1):
                poly[c] = dot(t.G[mode_set, g], w.derivatives[c])
            theta = first_crossing(poly, degree, noise, w.roots)
        if theta < first:
            first, guard = theta, g
            if abs(poly[0]) <= noise and theta < _EARLY:
                unseen = unseen or poly[1] >= -noise or may_rise(t, mode_set, g, w, h, noise)
        doubtful = doubtful or unseen
    return first, guard, doubtful


@inlined
def free_of_events(shape, f, d, degree, size):
    """Whether the coefficients alone prove that no guard has an event along the dense output.

    If not, `first_event` decides.
    """
    for g in range(f.G.shape[0]):
        if f.guard_needs_inputs[g]:
            return False
        begin, lowest = 0.0, 0.0
        for c in range(degree + 1):
            value = 0.0
            for j in range(state_count(shape)):
                value += f.G[g, j] * d[c, j]
            if c == 0:
                begin = lowest = value
            else:
                lowest += min(value, 0.0)
        if not (lowest > 0.0 and begin > rounding(f.G[g], size)):
            return False
    return True


@inlined
def trial_step(shape, f, friction, k, x, h, y, z):
    """Compute the stages k[1..6] and the end y of a step h from x; k[0] is known, z is scratch."""
    n = state_count(shape)
    copy(n, x, z)
    late = stage(shape, f, friction, h * A[1][0], z, k, 0, begin_stages(shape, friction, k, 0))
    for i in range(n):
        z[i] = x[i] + h * (A[2][0] * k[0, i])
    late = stage(shape, f, friction, h * A[2][1], z, k, 1, late)
    for i in range(n):
        z[i] = x[i] + h * (A[3][0] * k[0, i] + A[3][1] * k[1, i])
    late = stage(shape, f, friction, h * A[3][2], z, k, 2, late)
    for i in range(n):
        z[i] = x[i] + h * (A[4][0] * k[0, i] + A[4][1] * k[1, i] + A[4][2] * k[2, i])
    late = stage(shape, f, friction, h * A[4][3], z, k, 3, late)
    for i in range(n):
        z[i] = x[i] + h * (A[5][0] * k[0, i] + A[5][1] * k[1, i] + A[5][2] * k[2, i] + A[5][3] * k[3, i])
    late = stage(shape, f, friction, h * A[5][4], z, k, 4, late)
    for i in range(n):
        y[i] = x[i] + h * (A[6][0] * k[0, i] + A[6][2] * k[2, i] + A[6][3] * k[3, i] + A[6][4] * k[4, i])
    late = stage(shape, f, friction, h * A[6][5], y, k, 5, late)
    complete_derivative(shape, f, friction, k, 6, late)


@inlined
def local_error(shape, k, y, size, h, tolerance):
    """The largest local error of the step; each state is scaled by `tolerance` times its largest value so far.

    Returns infinity if a stage overflowed. A law continued far below w = 0 grows without bound; the step must then
    shrink instead of being accepted as free of error.
    """
    n = state_count(shape)
    worst = 0.0
    for i in range(n):
        e = E[0] * k[0, i] + E[2] * k[2, i] + E[3] * k[3, i] + E[4] * k[4, i] + E[5] * k[5, i]
        e = h * e + (h * E[6]) * k[6, i]  # k[6] comes last
        if not (abs(e) + abs(y[i]) < np.inf):
            return np.inf
        largest = max(size[i], abs(y[i]))
        if largest > 0.0:
            worst = max(worst, abs(e) * (1.0 / (SHARE * tolerance * largest)))
    return worst


@inlined
def step_factor(e):
    """The factor for the next step: 0.9 e^(-1/5) for 0 <= e <= 1, at most `_GROW`.

    A cubic approximates it to 3 % where the step is about right: the next step waits for this value, and a power takes
    as long as a stage.
    """
    if e < 1e-4:
        return _GROW
    if e < 0.1:
        return min(_GROW, SAFETY * e ** (-0.2))
    return (1.6 - 2.3 * e) + (e * e) * (2.9 - 1.3 * e)


@inlined
def raise_scales(x, rates, count, step, size):
    """Raise the scale of each state to its value, and that of very small coordinates, and speeds, to a share `_LEAST`
    of the largest one.

    A state that is moved by rounding alone, such as a mode of a plate in equilibrium, has an error as large as itself.
    """
    for i in range(x.shape[0]):
        size[i] = max(size[i], abs(x[i]))
    for first in (0, count):
        top = 0.0
        for i in range(first, first + count):
            top = max(top, size[i], step * abs(rates[i]))
        for i in range(first, first + count):
            size[i] = max(size[i], _LEAST * top)


@by_address
def raise_to_rounding(shape, t, w, state, log, seg, plan, ticks):
    """Raise the scale of each state so far that the tolerance times it is not below the rounding error of a step h,
    the next one; a part (rig.solve.specialised).

    Near an equilibrium large forces balance, and the largest value of a speed so far may itself be rounding. The terms
    of the rates give an absolute scale: each rate has the rounding error r of its terms, and couplings pass it on,
    (h + h^2 |A| / 2 + h^3 |A|^2 / 6 + ...) r, one term for each stage. A step longer than a finest cell of exact
    propagation counts like such a cell, because the sum is a bound only while |A| h is small. Only a refused step needs
    the scale.
    """
    mode_set, x = t.mode_set_of[state.progress[0].key], state.x
    n, size, error, sources = x.shape[0], w.size, w.y, w.y2
    h = min(state.progress[0].next_length, t.step[0] / 2.0 ** t.depth[mode_set])
    copy(n, x, w.at)
    call(plan.inputs_of_state, any_shape(n), t, w, state, log, seg, plan, 0)
    for i in range(n):
        sources[i] = h * (rounding(t.A[mode_set, i], x) + rounding(t.b[mode_set, i], w.T))
        error[i] = 0.0
    for order in range(w.k.shape[0], 0, -1):
        copy(n, error, w.at)
        for i in range(n):
            error[i] = sources[i]
            for j in range(n):
                error[i] += h * abs(t.A[mode_set, i, j]) * w.at[j] / (order + 1.0)
    for i in range(n):
        size[i] = max(size[i], error[i] / plan.tolerance)
    return 0


@inner
def look_inside(t, mode_set, w, degree, from_theta, to_theta, asked, end, h, energy):
    """Evaluate states and inputs at the quarters between two places in the step (lanes 0 to 4 of w.x_at and w.T_at).

    `asked`: whether they are needed. In the same pass the energy terms up to the place `end` are added, by
    Gauss-Legendre quadrature; 0: none.
    """
    quarters = from_theta * lanes(w.in_part) + (to_theta - from_theta) * lanes(w.quarters)
    states_at(w.derivatives, degree, quarters + end * lanes(w.nodes3), w.x_at)
    inputs_at(t, mode_set, w, 0 if asked else PART, LANE if end > 0.0 else PART)
    if end > 0.0:
        add_powers(t, mode_set, w.x_at, w.T_at, w.weights3, end * h, energy)


@inner
def add_long_powers(t, mode_set, w, degree, end, h, energy):
    """Add the energy terms up to the place `end` of a step that is too long for three nodes, at eight."""
    states_at(w.derivatives, degree, end * lanes(w.nodes), w.x_at)
    inputs_at(t, mode_set, w, 0, LANE)
    add_powers(t, mode_set, w.x_at, w.T_at, w.weights, end * h, energy)


@inner
def emit_segment(t, mode_set, w, degree, from_theta, to_theta, end, h, start, seg, energy):
    """Write one segment of the outputs between two places in the step; `end`, `energy`: as in `look_inside`.

    An output that depends on no input is a row over the path of the state. Any other, and one along a path of higher
    degree, is a quartic through five points.
    """
    at_once, width, asked = seg.count[0], to_theta - from_theta, False
    for s in range(seg.coef.shape[1]):
        if t.output_needs_inputs[mode_set, s]:
            asked = True
            continue
        coef, path = seg.coef[at_once, s], w.poly
        for c in range(degree + 1):
            path[c] = 0.0
        for i in range(t.signals.shape[2]):
            f = t.signals[mode_set, s, i]
            if f != 0.0:  # most outputs depend on few states
                for c in range(degree + 1):
                    path[c] += f * w.derivatives[c, i]
        if degree > 4:
            y = alike(path[degree])
            for c in range(degree - 1, -1, -1):
                y = path[c] + (from_theta + width * lanes(w.quarters)) * y
            write_quartic(y, coef)
        else:
            copy(5, path, coef)
            part_of_quartic(coef, from_theta, width)
    if asked or end > 0.0:
        look_inside(t, mode_set, w, degree, from_theta, to_theta, asked, end, h, energy)
    if asked:
        for s in range(seg.coef.shape[1]):
            if t.output_needs_inputs[mode_set, s]:
                write_output_quartic(t, mode_set, s, w.x_at, w.T_at, seg.coef[at_once, s])
    close_segment(start, width * h, seg)


@inlined
def set_generators(shape, t, w, time, x):
    """Set the generators among the state variables to their exact values, `time` [s] after the block began.

    Generators are undamped, so the errors of the steps would accumulate in amplitude and phase. Every index of x is a
    constant of the compiled code, so that x stays in registers.
    """
    for g in range(t.generators.shape[0]):
        turn = t.generator_rate[g] * time
        sine, cosine = np.sin(turn), np.cos(turn)
        a, b = w.generators_at_begin[g, 0], w.generators_at_begin[g, 1]
        for i in range(state_count(shape)):
            if i == t.generators[g, 0]:
                x[i] = cosine * a + sine * b
            elif i == t.generators[g, 1]:
                x[i] = cosine * b - sine * a


@inlined
def accept_step(shape, t, mode_set, w, y, x, here):
    """Accept the end y of a step as the new state `here`; x is passed to functions that are not inlined."""
    copy(state_count(shape), y, here)
    for i in range(state_count(shape)):
        w.size[i] = max(w.size[i], abs(here[i]))
    if t.stuck[mode_set]:
        copy(state_count(shape), here, x)
        project_stick(t, mode_set, x, w.copy)
        copy(state_count(shape), x, here)


@inlined
def end_of_tick(tick, place, done, share, ticks, last):
    """The place in the step at which the tick ends; `done` is the place already reached.

    It is 1 for the last of the ticks if the step was cut to end there (`last`).
    """
    to = done + (1.0 - place) * share
    if last and tick == ticks - 1:
        to = 1.0
    return to


@inlined
def log_ticks(shape, log, d, degree, mode_set, tick, place, ticks, share, last):
    """Log the states at the ticks that end in a step with the dense output d; tick and place at the end of the step.

    `share`: the length of a tick as a share of the step.
    """
    done = 0.0
    while tick < ticks:
        to = end_of_tick(tick, place, done, share, ticks, last)
        if to > 1.0:
            break
        evaluate_path(shape, d, degree, to, log.out[tick])
        log.modes[tick] = mode_set
        tick, place, done = tick + 1, 0.0, to
    return tick, place, done


@by_address
def take_steps(shape, t, w, state, log, seg, plan, ticks):
    """Take steps from state.x to the end of the ticks, or to a step that `stretch` must handle.

    A specialised kernel (rig.solve.specialised). The derivative at state.x must be in w.k[0], except at the begin of a
    stretch, where now.suggested_length is 0. Returns ENDED; UNDECIDED; EVENT_FREE, if the step is proved free of
    events; or FAILED, if no step is short enough. With UNDECIDED and EVENT_FREE the length of the step is in
    now.step_length, its end in w.y, its stages in w.k and its dense output in w.derivatives; state, tick and place are
    those at its begin. Working arrays are only passed to inlined functions, so they stay in registers.
    """
    n, tick_length, mode_set = state_count(shape), t.step[0], t.mode_set_of[state.progress[0].key]
    now, x, size, graded = state.progress[0], state.x, w.size, t.graded[mode_set] > 0
    looked = plan.with_energy or plan.emitting or graded
    field = right_hand_side(t, mode_set, w.T, w.scratch)
    f, friction = lent(field), lent(patch_friction(shape, field, False, t, w, state, log, seg, plan))
    k, y, z, d = local(shape, w.k), local(shape, w.y), local(shape, w.y2), local(shape, w.derivatives)
    here = local(shape, w.copy)
    tick, place, next_h, hoped, most = now.tick, now.place, now.next_length, now.suggested_length, now.trial_limit
    copy(n, x, here)
    copy(n, w.k[0], k[0])
    if hoped == 0.0:
        derivative(shape, f, True, here, k[0], t, w, state, log, seg, plan)
        copy(n, k[0], w.k[0])
        raise_scales(x, w.k[0], t.damping.shape[1], min(tick_length, next_h) if graded else tick_length, size)
    ends = ENDED
    while tick < ticks:
        left = ((ticks - tick) - place) * tick_length
        h = next_h if next_h < left - 1e-9 * tick_length else left
        trial_step(shape, f, friction, k, here, h, y, z)
        e = local_error(shape, k, y, size, h, plan.tolerance)
        now.trials += 1
        if not (e <= 1.0):
            next_h = h * max(SHRINK, SAFETY * e ** (-0.2))
            if next_h < 1e-14 * tick_length or now.trials > most:
                ends = FAILED
                break
            copy(n, here, x)
            now.next_length = next_h
            call(plan.raise_to_rounding, any_shape(n), t, w, state, log, seg, plan, 0)
            continue
        grow = step_factor(e)
        if h >= next_h or grow < 1.0:  # the error is likely to go on growing
            next_h = h * max(SHRINK, min(grow, (grow * grow) * (h / hoped)))
        hoped = h * grow
        quartic_of_step(shape, k, here, y, h, d)
        plain = free_of_events(shape, f, d, 4, size)
        if looked or not plain:
            now.step_length = h
            copy(n, y, w.y)
            copy(n, k[6], w.k[6])
            for c in range(5):
                copy(n, d[c], w.derivatives[c])
            ends = EVENT_FREE if plain else UNDECIDED
            break
        tick, place, done = log_ticks(shape, log, d, 4, mode_set, tick, place, ticks, tick_length / h, h == left)
        if done < 1.0:
            place += (1.0 - done) * h / tick_length
        set_generators(shape, t, w, ((tick - now.reached) + place) * tick_length, y)
        accept_step(shape, t, mode_set, w, y, x, here)
        copy(n, k[6], k[0])
    now.tick, now.place, now.next_length, now.suggested_length = tick, place, next_h, hoped
    copy(n, here, x)
    copy(n, k[0], w.k[0])
    return ends


@by_address
def stretch(shape, t, w, state, log, seg, plan, ticks):
    """Advance the state within one mode set to an event or to the end of the ticks; a part (rig.solve.specialised).

    Returns the guard, -1 at the end of the ticks, -2 if no step is short enough, -4 if rounding hides a slip speed.
    """
    now, x = state.progress[0], state.x
    mode_set = t.mode_set_of[now.key]
    tick_length, origin, n = t.step[0], now.reached, x.shape[0]
    path, degree = w.derivatives, plan.degree
    now.trial_limit = now.trials + _MOST * (ticks - now.tick)
    now.suggested_length = 0.0
    crossed = -1
    while (
        now.tick < ticks and crossed == -1 and not (plan.emitting and nearly_full(t, mode_set, seg, ticks - now.tick))
    ):
        if t.graded[mode_set]:
            crossed = call(plan.take_cell, shape, t, w, state, log, seg, plan, ticks)
            if crossed >= -1:
                if now.trials > now.trial_limit:
                    return -2
                continue
            crossed, now.suggested_length = -1, 0.0
        ends = call(plan.take_steps, shape, t, w, state, log, seg, plan, ticks)
        if ends >= FAILED:
            return -2 if ends == FAILED else -4
        if ends == ENDED:
            break
        h, tick, place = now.step_length, now.tick, now.place
        left = ((ticks - tick) - place) * tick_length
        end = 1.0
        if ends == UNDECIDED:
            theta, crossed, doubtful = first_event(t, mode_set, w, degree, h)
            if doubtful and h > 1e-12 * tick_length:
                now.next_length, crossed = SHRINK * h, -1
                continue
            end = theta if crossed >= 0 else 1.0
        done, share, spent = 0.0, tick_length / h, end if plan.with_energy else 0.0
        if degree > 4 and spent > 0.0:
            add_long_powers(t, mode_set, w, degree, spent, h, state.energy)
            spent = 0.0
        while tick < ticks:  # ticks that end inside the step
            to = end_of_tick(tick, place, done, share, ticks, crossed < 0 and h == left)
            if to > end or (crossed >= 0 and to >= end):
                break
            if plan.emitting:
                since = (tick - origin + place) * tick_length
                emit_segment(t, mode_set, w, degree, done, to, spent, h, since, seg, state.energy)
                spent = 0.0
            evaluate_path(shape, path, degree, to, log.out[tick])
            log.modes[tick] = mode_set
            tick, place, done = tick + 1, 0.0, to
        if done < end:
            if plan.emitting:
                since = (tick - origin + place) * tick_length
                emit_segment(t, mode_set, w, degree, done, end, spent, h, since, seg, state.energy)
                spent = 0.0
            place += (end - done) * h / tick_length
        if spent > 0.0:
            look_inside(t, mode_set, w, degree, 0.0, 0.0, False, spent, h, state.energy)
        if crossed >= 0:
            evaluate_path(shape, path, degree, end, x)
        else:
            set_generators(shape, t, w, ((tick - origin) + place) * tick_length, w.y)
            accept_step(shape, t, mode_set, w, w.y, x, x)
            copy(n, w.k[6], w.k[0])
        now.tick, now.place = tick, place
    if crossed >= 0:
        apply_event(t, mode_set, crossed, now, x)
    elif now.tick == ticks:
        copy(n, x, log.out[ticks - 1])
    return crossed
