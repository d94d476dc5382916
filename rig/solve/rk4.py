"""The classical Runge-Kutta method with a fixed step and events by bisection, as in the papers.

Guards are tested for their sign at the ends of steps only, so a stick phase shorter than a step is missed. This is
inherent to the method and the reason why it is not the default. It serves for comparison and treats every mode set
alike.
"""

from __future__ import annotations

from rig.kernel import inlined, inner
from rig.lent_records import lent
from rig.solve.contact_state import land, passed
from rig.solve.forces import guard, inputs, lend, rate
from rig.solve.instant_readings import add_energy, read
from rig.solve.records import CROSSED, KEY, LENGTH, PLACE, REACHED, TICK
from rig.solve.rows import rounding
from rig.solve.segment_output import crowded, emit_quartic
from rig.solve.specialised import bends, call, local, states

ENDED, ASKS = range(2)  # results of `steps`


@inlined
def move(shape, f, bent, k, x, h, y, z):
    """Take one step of length h from x, with the derivative k[0] known, to its end y; z is scratch."""
    n = states(shape)
    for stage in range(3):
        reach = h if stage == 2 else 0.5 * h
        for i in range(n):
            z[i] = x[i] + reach * k[stage, i]
        rate(shape, f, bent, z, k[stage + 1])
    for i in range(n):
        y[i] = x[i] + (h / 6.0) * (k[0, i] + 2.0 * (k[1, i] + k[2, i]) + k[3, i])


@inner
def noise(row, row_t, needs, x, T):
    """The size of the rounding error of a guard at x; `needs`: the guard depends on the inputs T."""
    size = rounding(row, x)
    if needs:
        size = max(size, rounding(row_t, T))
    return size


@inlined
def crossed_guard(shape, f, bent, x, y):
    """The first guard that is positive at x and not at y, or is clearly negative at y; -1 if there is none."""
    crossed = -1
    for g in range(f.G.shape[0]):
        if crossed < 0 and guard(shape, f, bent, g, y) <= 0.0:
            before = guard(shape, f, bent, g, x)
            if before > noise(f.G[g], f.GT[g], f.needs[g], x, f.T):
                crossed = g
            elif guard(shape, f, bent, g, y) < -noise(f.G[g], f.GT[g], f.needs[g], y, f.T):
                crossed = g
    return crossed


@inlined
def bisect(shape, f, bent, x, h, w):
    """Shorten the step from x until the first guard is zero to rounding.

    Returns the length and the guard; the end is in w.y.
    """
    k, y, z = local(shape, w.k), local(shape, w.y), local(shape, w.y2)
    rate(shape, f, bent, x, k[0])
    low, high = 0.0, h
    for _ in range(60):
        middle = 0.5 * (low + high)
        if middle <= low or middle >= high:
            break
        move(shape, f, bent, k, x, middle, y, z)
        if crossed_guard(shape, f, bent, x, y) >= 0:
            high = middle
        else:
            low = middle
    move(shape, f, bent, k, x, high, y, z)
    for i in range(states(shape)):
        w.y[i] = y[i]
    return high, max(crossed_guard(shape, f, bent, x, y), 0)


@inlined
def between(shape, k, x, y, h, u, z):
    """Write the cubic through x and y with the slopes k[0] and k[1], at u in [0, 1], to z."""
    a, b = 2.0 * u * u * u - 3.0 * u * u + 1.0, u * u * u - 2.0 * u * u + u
    c, d = 1.0 - a, u * u * u - u * u
    for i in range(states(shape)):
        z[i] = a * x[i] + c * y[i] + h * (b * k[0, i] + d * k[1, i])


@inlined
def observe(shape, f, w, energy, seg, plan, h, start):
    """Add the energy terms (Simpson's rule) and write the outputs along a step of length h from w.x0 to w.y."""
    x, bent, with_energy, emitting = w.x0, plan.bends, plan.with_energy, plan.emitting
    rate(shape, f, bent, x, w.k[0])
    rate(shape, f, bent, w.y, w.k[1])
    for q in range(5):
        between(shape, w.k, x, w.y, h, 0.25 * q, w.y2)
        inputs(f.t, f.mode_set, w.y2, w.T, w.scratch)
        if with_energy and q % 2 == 0:
            add_energy(f.t, f.mode_set, w.T, w.y2, (4.0 if q == 2 else 1.0) * h / 6.0, energy)
        if emitting:
            read(f.t, f.mode_set, w.T, w.y2, w.values[q])
    if emitting and h > 0.0:
        emit_quartic(w.values, start, h, seg)


@inlined
def next_step(place, substeps, full):
    """From `place` in a tick: the number of the step that ends next, and the length up to its end."""
    position = place * substeps
    whole = int(position + 1e-12) + 1
    return whole, full if position - (whole - 1) <= 1e-12 else (whole - position) * full


@inner
def steps(shape, t, w, state, log, seg, plan, ticks):
    """Take steps from state.x to the end of the ticks or to a step that `stretch` must handle.

    A specialised kernel (rig.solve.specialised). Returns ENDED or ASKS. With ASKS the end of the step is in w.y, its
    length in fc[LENGTH], the guard that had an event in ic[CROSSED]; state, tick and place are those at its begin.
    """
    n, looked, bent = states(shape), plan.with_energy or plan.emitting, bends(shape)
    ic, fc, x, substeps, out = state.ic, state.fc, state.x, plan.substeps, log.out
    full, mode_set = t.step[0] / substeps, t.mode_set_of[ic[KEY]]
    f = lend(t, mode_set, w.T, w.scratch)
    k, y, z, here = local(shape, w.k), local(shape, w.y), local(shape, w.y2), local(shape, w.x0)
    tick, place, ends = ic[TICK], fc[PLACE], ENDED
    for i in range(n):
        here[i] = x[i]
    whole, h = next_step(place, substeps, full)
    while tick < ticks:
        rate(shape, f, bent, here, k[0])
        move(shape, f, bent, k, here, h, y, z)
        crossed = crossed_guard(shape, f, bent, here, y)
        if looked or crossed >= 0:
            ic[CROSSED], fc[LENGTH], ends = crossed, h, ASKS
            for i in range(n):
                w.y[i] = y[i]
            break
        for i in range(n):
            here[i] = y[i]
        if bent and t.stuck[mode_set]:
            for i in range(n):
                x[i] = here[i]
            land(t, mode_set, x, w.copy)
            for i in range(n):
                here[i] = x[i]
        place = whole / substeps
        if whole >= substeps:
            for i in range(n):
                out[tick, i] = here[i]
            log.modes[tick] = mode_set
            tick, place, whole = tick + 1, 0.0, 0
        whole, h = whole + 1, full
    ic[TICK], fc[PLACE] = tick, place
    for i in range(n):
        x[i] = here[i]
    return ends


@inner
def stretch(shape, t, w, state, log, seg, plan, ticks):
    """Advance the state to an event or to the end of the ticks; a part (rig.solve.specialised).

    Returns the guard of the event, or -1.
    """
    ic, fc, x, substeps, bent = state.ic, state.fc, state.x, plan.substeps, plan.bends
    n, full, origin = x.shape[0], t.step[0] / plan.substeps, ic[REACHED]
    mode_set = t.mode_set_of[ic[KEY]]
    f = lent(lend(t, mode_set, w.T, w.scratch))
    crossed = -1
    while ic[TICK] < ticks and crossed < 0 and not (plan.emitting and crowded(t, mode_set, seg, ticks - ic[TICK])):
        if call(plan.steps, shape, t, w, state, log, seg, plan, ticks) == ENDED:
            break
        tick, place, length, crossed = ic[TICK], fc[PLACE], fc[LENGTH], ic[CROSSED]
        if crossed >= 0:
            length, crossed = bisect(shape, f, bent, x, length, w)
        if plan.with_energy or plan.emitting:
            start = (tick - origin + place) * t.step[0]
            for i in range(n):
                w.x0[i] = x[i]
            observe(shape, f, w, state.energy, seg, plan, length, start)
        for i in range(n):
            x[i] = w.y[i]
        if bent and t.stuck[mode_set]:
            land(t, mode_set, x, w.copy)
        whole, _ = next_step(place, substeps, full)
        reached = place * substeps + length / full
        if crossed >= 0 and reached < substeps - 1e-12:
            place = reached / substeps
        elif whole >= substeps:
            for i in range(n):
                log.out[tick, i] = x[i]
            log.modes[tick] = mode_set
            tick, place = tick + 1, 0.0
        else:
            place = whole / substeps
        ic[TICK], fc[PLACE] = tick, place
    if crossed >= 0:
        passed(t, mode_set, crossed, ic, x)
    return crossed
