"""The compiled loop that advances a state through ticks and selects the method for each mode set."""

from __future__ import annotations

import numpy as np

from rig.compiled.kernel import by_address, inlined, inner, kernel
from rig.solve import film_steps
from rig.solve.column_blocks import LANE, dot, multiply
from rig.solve.contact_state import (
    CHATTER,
    CHECK,
    DONE,
    LOST,
    OVERFULL,
    READY,
    UNRESOLVED,
    mode_in_key,
    sector_weight,
)
from rig.solve.exact import FULL
from rig.solve.forces import MEMORY, STATES, evaluate_memory, inputs
from rig.solve.places import write_outputs
from rig.solve.records import G_NEXT
from rig.solve.segment_output import nearly_full
from rig.solve.specialised import any_shape, call

TALLIED = 256  # mode sets that are counted one by one; the last count takes all others
_FLUSH = 1e-150


@kernel
def advance(tables, loan, begin, origin, ticks):
    """Advance the state from row `origin` of the log to row `ticks`. Returns a status.

    `tables`, `loan`: Tables and MotionRecords, lent (rig.compiled.records). If the status asks for a mode set or for
    more room for segments, the caller provides it and calls again without `begin`.
    """
    state = loan.state
    if begin:
        begin_block(tables, loan.work, state, loan.segments, origin)
    shape = any_shape(state.x.shape[0])
    return call(loan.plan.advance_block, shape, tables, loan.work, state, loan.log, loan.segments, loan.plan, ticks)


@inner
def begin_block(t, w, state, seg, origin):
    """Begin a block at row `origin` of the log, with no events and no segments yet.

    The contact state is made consistent first, unless the state is the one with which the previous block ended.
    """
    for g in range(t.generators.shape[0]):
        for i in range(2):
            w.generators_at_begin[g, i] = state.x[t.generators[g, i]]
    now = state.progress[0]
    now.reached = now.tick = origin
    now.events = 0
    same = now.pending == READY
    for i in range(state.x.shape[0]):
        same = same and state.x[i] == w.x_at_end[i]
        w.size[i] = max(w.size[i], abs(state.x[i]))
    if not same:
        now.pending = max(now.pending, CHECK)
    seg.count[0] = 0


@by_address
def advance_block(shape, t, w, state, log, seg, plan, ticks):
    """Advance the state through a block that has begun, up to row `ticks`; arguments and status as in `advance`."""
    now, x = state.progress[0], state.x
    while True:
        if now.pending != READY:
            status = call(plan.make_consistent, shape, t, w, state, log, seg, plan, ticks)
            if status != DONE:
                return status
        if now.tick >= ticks:
            break
        mode_set = t.mode_set_of[now.key]
        t.used[mode_set] = now.events_before + now.events
        if plan.emitting and nearly_full(t, mode_set, seg, ticks - now.tick):
            return OVERFULL
        before, first = now.key, now.tick
        if plan.fixed_steps or t.curved[mode_set]:
            guard = call(plan.stretch, shape, t, w, state, log, seg, plan, ticks)
            now.place = min(now.place, 1.0 - 1.2e-16)
            if guard == -2:
                return LOST
            if guard == -4:
                return UNRESOLVED
        else:
            guard = call(plan.linear_stretch, shape, t, w, state, log, seg, plan, ticks)
        state.tally[min(mode_set, TALLIED - 1)] += now.tick - first
        if guard == FULL:
            return OVERFULL
        if guard >= 0:
            if t.change.shape[0] and t.kind[mode_set, guard] >= G_NEXT:
                state.edges[0] += sector_energy_gain(t, t.owner[mode_set, guard], before, now.key, x)
            e = now.events
            if e >= log.event.shape[0]:
                return CHATTER
            same = e > 0 and log.event[e - 1, 0] == now.tick and abs(log.place[e - 1] - now.place) < 1e-12
            now.repeat = now.repeat + 1 if same else 0
            log.event[e, 0], log.event[e, 1] = now.tick, t.kind[mode_set, guard]
            log.event[e, 2], log.event[e, 3] = t.owner[mode_set, guard], before
            log.place[e] = now.place
            now.events = e + 1
    now.events_before += now.events
    for i in range(x.shape[0]):
        if abs(x[i]) < _FLUSH:
            x[i] = 0.0
        if not (abs(x[i]) <= plan.limit):
            return LOST
        w.x_at_end[i] = x[i]
    now.beyond = output_beyond_bound(t, t.mode_set_of[now.key], x, w, state.watched, state.bound)
    now.reached = ticks
    return DONE


@inlined
def sector_energy_gain(t, sector, before, after, x):
    """The increase of the stiffness energy at x when mode set `after` follows `before` at the edge of a sector."""
    base, places = sector_weight(t, sector), t.sectors[sector]
    old, new = t.change[sector, mode_in_key(before, base, places)], t.change[sector, mode_in_key(after, base, places)]
    s = 0.0
    for i in range(old.shape[0]):
        for j in range(old.shape[0]):
            s += 0.5 * x[i] * (new[i, j] - old[i, j]) * x[j]
    return s


@inlined
def output_beyond_bound(t, mode_set, x, w, watched, bound):
    """The first watched output whose absolute value exceeds its bound; -1 if there is none."""
    if watched.shape[0]:
        needed = False
        for i in range(watched.shape[0]):
            needed = needed or t.output_needs_inputs[mode_set, watched[i]] != 0
        if needed:
            inputs(t, mode_set, x, w.T, w.scratch)
        for i in range(watched.shape[0]):
            value = dot(t.signals[mode_set, watched[i]], x)
            if t.output_needs_inputs[mode_set, watched[i]]:
                value += dot(t.signals_t[mode_set, watched[i]], w.T)
            if not abs(value) <= bound[i]:
                return watched[i]
    return -1


@kernel
def evaluate_outputs(tables, loan, states, mode_sets, values, first):
    """Write every output of the rig at states[i] in mode set mode_sets[i] to values[output, first + i]."""
    t, w, count, i = tables, loan.work, states.shape[0], 0
    while i < count:
        alike = 1
        while alike < LANE and i + alike < count and mode_sets[i + alike] == mode_sets[i]:
            alike += 1
        s = np.int32(mode_sets[i])  # the type of mode sets everywhere else
        if t.film.begins.shape[0]:
            film_steps.film_outputs(t.film, states[i], values[:, first + i])
            i += 1
        elif alike == LANE:
            write_outputs(t, s, w, states[i : i + LANE], values, first + i)
            i += LANE
        else:
            write_outputs_at_one(t, s, w, states[i], loan.plan.many_states, values, first + i)
            i += 1


@kernel
def energy_in_contacts(tables, loan, mode_set):
    """The energy [J] that the laws with memory store at the present state, in mode set `mode_set`."""
    t, w, x, energy = tables, loan.work, loan.state.x, 0.0
    inputs(t, mode_set, x, w.T, w.scratch)
    for p in range(t.slip.shape[0]):
        if t.code[mode_set, p] == MEMORY:
            evaluate_memory(t, mode_set, p, x, w.T, True)
            energy += t.memory.values[int(t.numbers[mode_set, p, STATES]) + 1]
    return energy


@inner
def write_outputs_at_one(t, mode_set, w, x, many_states, values, at):
    """Write every output at x to values[output, at]."""
    needed = False
    for k in range(values.shape[0]):
        needed = needed or t.output_needs_inputs[mode_set, k] != 0
    if needed:
        inputs(t, mode_set, x, w.T, w.scratch)
    if many_states:
        multiply(t.many_states.output[mode_set], x, 0, t.many_states.output.shape[1], t.many_states.product)
    for k in range(values.shape[0]):
        value = t.many_states.product[k] if many_states else dot(t.signals[mode_set, k], x)
        if t.output_needs_inputs[mode_set, k]:
            value += dot(t.signals_t[mode_set, k], w.T)
        values[k, at] = value
