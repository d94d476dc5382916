"""The classical Runge-Kutta method with a fixed step and events by bisection, as in the papers.

Guards are tested for their sign at the ends of steps only, so a stick phase shorter than a step is missed. This is
inherent to the method and the reason why it is not the default. It serves for comparison and treats every mode set
alike.
"""

from __future__ import annotations

from rig.compiled.kernel import by_address, inlined, inner
from rig.compiled.records import lent
from rig.solve.column_blocks import copy, dot, lanes, rounding, write
from rig.solve.contact_state import apply_event, project_stick
from rig.solve.forces import right_hand_side
from rig.solve.places import PART, add_powers, inputs_at, write_output_quartic
from rig.solve.runge_kutta_stage import derivative
from rig.solve.segment_output import close_segment, nearly_full
from rig.solve.specialised import any_shape, call, is_nonlinear, local, state_count

A = ((), (1 / 2,), (0.0, 1 / 2), (0.0, 0.0, 1.0))
WEIGHTS = (1.0, 2.0, 2.0, 1.0)  # b, in sixths
ENDED, UNDECIDED = range(2)  # results of `take_steps`


@inlined
def runge_kutta_step(shape, f, nonlinear, k, x, h, y, z, t, w, state, log, seg, plan):
    """Take one step of length h from x, with the derivative k[0] known, to its end y; z is scratch."""
    n = state_count(shape)
    for stage in range(3):
        reach = h * A[3][2] if stage == 2 else h * A[1][0]  # the second stage reaches as far as the first
        for i in range(n):
            z[i] = x[i] + reach * k[stage, i]
        derivative(shape, f, nonlinear, z, k[stage + 1], t, w, state, log, seg, plan)
    for i in range(n):
        y[i] = x[i] + (h / 6.0) * (WEIGHTS[0] * k[0, i] + WEIGHTS[1] * (k[1, i] + k[2, i]) + WEIGHTS[3] * k[3, i])


@inner
def guard_rounding(row, row_t, needs, x, T):
    """The size of the rounding error of a guard at x; `needs`: the guard depends on the inputs T."""
    size = rounding(row, x)
    if needs:
        size = max(size, rounding(row_t, T))
    return size


@inlined
def guard_at(shape, f, nonlinear, g, x, t, w, state, log, seg, plan):
    """The value of guard g at x."""
    value = 0.0
    for j in range(state_count(shape)):
        value += f.G[g, j] * x[j]
    if nonlinear:
        if f.guard_needs_inputs[g]:
            copy(state_count(shape), x, w.at)
            call(plan.inputs_of_state, any_shape(state_count(shape)), t, w, state, log, seg, plan, 0)
            value += dot(f.GT[g], f.T)
    return value


@inlined
def crossed_guard(shape, f, nonlinear, x, y, t, w, state, log, seg, plan):
    """The first guard that is positive at x and not at y, or is clearly negative at y; -1 if there is none."""
    crossed = -1
    for g in range(f.G.shape[0]):
        if crossed < 0:
            row, row_t, needs = f.G[g], f.GT[g], f.guard_needs_inputs[g]
            after = guard_at(shape, f, nonlinear, g, y, t, w, state, log, seg, plan)
            if after <= 0.0:
                below = after < -guard_rounding(row, row_t, needs, y, f.T)
                if below:
                    crossed = g
                else:
                    before = guard_at(shape, f, nonlinear, g, x, t, w, state, log, seg, plan)
                    if before > guard_rounding(row, row_t, needs, x, f.T):
                        crossed = g
    return crossed


@inner
def bisect(shape, f, nonlinear, x, h, t, w, state, log, seg, plan):
    """Shorten the step from x until the first guard is zero to rounding.

    Returns the length and the guard; the end is in w.y.
    """
    k, y, z = local(shape, w.k), local(shape, w.y), local(shape, w.y2)
    derivative(shape, f, nonlinear, x, k[0], t, w, state, log, seg, plan)
    low, high, crossed, ends = 0.0, h, -1, False
    for halving in range(61):
        length = 0.5 * (low + high)
        ends = halving == 60 or length <= low or length >= high
        if ends:
            length = high
        runge_kutta_step(shape, f, nonlinear, k, x, length, y, z, t, w, state, log, seg, plan)
        crossed = crossed_guard(shape, f, nonlinear, x, y, t, w, state, log, seg, plan)
        if ends:
            break
        if crossed >= 0:
            high = length
        else:
            low = length
    copy(state_count(shape), y, w.y)
    return high, max(crossed, 0)


@inner
def observe_step(t, mode_set, w, state, log, seg, plan, h, start):
    """Add the energy terms (Simpson's rule) and write the outputs along a step of length h from w.x0 to w.y.

    The step is the cubic through both ends with the slopes there.
    """
    x, y, k = w.x0, w.y, w.k
    f = right_hand_side(t, mode_set, w.T, w.scratch)
    for q in range(2):
        at = y if q else x
        derivative(any_shape(x.shape[0]), f, plan.nonlinear, at, k[q], t, w, state, log, seg, plan)
    u = lanes(w.quarters)
    a, b = 2.0 * u * u * u - 3.0 * u * u + 1.0, u * u * u - 2.0 * u * u + u
    c, d = 1.0 - a, u * u * u - u * u
    for i in range(x.shape[0]):
        write(a * x[i] + c * y[i] + h * (b * k[0, i] + d * k[1, i]), w.x_at[i])
    inputs_at(t, mode_set, w, 0, PART)
    if plan.with_energy:
        add_powers(t, mode_set, w.x_at, w.T_at, w.simpson, h, state.energy)
    if plan.emitting and h > 0.0:
        for s in range(seg.coef.shape[1]):
            write_output_quartic(t, mode_set, s, w.x_at, w.T_at, seg.coef[seg.count[0], s])
        close_segment(start, h, seg)


@inlined
def next_step(place, substeps, full):
    """From `place` in a tick: the number of the step that ends next, and the length up to its end."""
    position = place * substeps
    whole = int(position + 1e-12) + 1
    return whole, full if position - (whole - 1) <= 1e-12 else (whole - position) * full


@by_address
def take_steps(shape, t, w, state, log, seg, plan, ticks):
    """Take steps from state.x to the end of the ticks or to a step that `stretch` must handle.

    A specialised kernel (rig.solve.specialised). Returns ENDED or UNDECIDED. With UNDECIDED the end of the step is in
    w.y, its length in now.step_length, the guard that had an event in now.crossed; state, tick and place are those at
    its begin.
    """
    n, looked, nonlinear = state_count(shape), plan.with_energy or plan.emitting, is_nonlinear(shape)
    now, x, substeps, out = state.progress[0], state.x, plan.substeps, log.out
    full, mode_set = t.step[0] / substeps, t.mode_set_of[now.key]
    f = right_hand_side(t, mode_set, w.T, w.scratch)
    k, y, z, here = local(shape, w.k), local(shape, w.y), local(shape, w.y2), local(shape, w.x0)
    tick, place, ends = now.tick, now.place, ENDED
    copy(n, x, here)
    whole, h = next_step(place, substeps, full)
    while tick < ticks:
        derivative(shape, f, nonlinear, here, k[0], t, w, state, log, seg, plan)
        runge_kutta_step(shape, f, nonlinear, k, here, h, y, z, t, w, state, log, seg, plan)
        crossed = crossed_guard(shape, f, nonlinear, here, y, t, w, state, log, seg, plan)
        if looked or crossed >= 0:
            now.crossed, now.step_length, ends = crossed, h, UNDECIDED
            copy(n, y, w.y)
            break
        copy(n, y, here)
        if nonlinear and t.stuck[mode_set]:
            copy(n, here, x)
            project_stick(t, mode_set, x, w.copy)
            copy(n, x, here)
        place = whole / substeps
        if whole >= substeps:
            copy(n, here, out[tick])
            log.modes[tick] = mode_set
            tick, place, whole = tick + 1, 0.0, 0
        whole, h = whole + 1, full
    now.tick, now.place = tick, place
    copy(n, here, x)
    return ends


@by_address
def stretch(shape, t, w, state, log, seg, plan, ticks):
    """Advance the state to an event or to the end of the ticks; a part (rig.solve.specialised).

    Returns the guard of the event, or -1.
    """
    now, x, substeps, nonlinear = state.progress[0], state.x, plan.substeps, plan.nonlinear
    n, full, origin = x.shape[0], t.step[0] / plan.substeps, now.reached
    mode_set = t.mode_set_of[now.key]
    f = lent(right_hand_side(t, mode_set, w.T, w.scratch))
    crossed = -1
    while now.tick < ticks and crossed < 0 and not (plan.emitting and nearly_full(t, mode_set, seg, ticks - now.tick)):
        if call(plan.take_steps, shape, t, w, state, log, seg, plan, ticks) == ENDED:
            break
        tick, place, length, crossed = now.tick, now.place, now.step_length, now.crossed
        if crossed >= 0:
            length, crossed = bisect(shape, f, nonlinear, x, length, t, w, state, log, seg, plan)
        if plan.with_energy or plan.emitting:
            start = (tick - origin + place) * t.step[0]
            copy(n, x, w.x0)
            observe_step(t, mode_set, w, state, log, seg, plan, length, start)
        copy(n, w.y, x)
        if nonlinear and t.stuck[mode_set]:
            project_stick(t, mode_set, x, w.copy)
        whole, _ = next_step(place, substeps, full)
        reached = place * substeps + length / full
        if crossed >= 0 and reached < substeps - 1e-12:
            place = reached / substeps
        elif whole >= substeps:
            copy(n, x, log.out[tick])
            log.modes[tick] = mode_set
            tick, place = tick + 1, 0.0
        else:
            place = whole / substeps
        now.tick, now.place = tick, place
    if crossed >= 0:
        apply_event(t, mode_set, crossed, now, x)
    return crossed
