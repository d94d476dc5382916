"""Carrying a state through ticks: the compiled loop that hands it from method to method, and what it works on."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from rig.kernel import inlined, inner, kernel, lent
from rig.solve import dopri5, exact, kick, ledger, rk4
from rig.solve.emit import crowded, emit_linear
from rig.solve.forces import dot, inputs
from rig.solve.lanes import multiply
from rig.solve.roots import DEGREE, WORK_COLUMNS, WORK_ROWS
from rig.solve.settle import BEGUN, CHATTER, DONE, LOST, OVERFULL, READY, SETTLE, digit, of_sector, settle
from rig.solve.system import G_NEXT, System
from rig.solve.wide import quiet

Array = NDArray[np.float64]
TICK, KEY, PENDING, EVENTS, OPENED, TRIALS, REPEAT, BEYOND, PAST, REACHED = range(10)  # of State.ic, and
COUNTERS = BEGUN + 1
PLACE, TRY = range(2)  # of State.fc
TALLIED = 256
_FLUSH = 1e-150


class Work(NamedTuple):
    """Scratch of one motion, allocated once."""

    k: Array
    y: Array
    y2: Array
    x0: Array
    copy: Array
    size: Array
    ask: Array
    ask_x: Array
    bear: Array
    bear_x: Array
    at: Array
    rates: Array
    T: Array
    scratch: Array
    swung: Array  # [generator, 2] its signals when the block began
    derivatives: Array
    spare: Array
    poly: Array
    roots: Array
    g: Array
    fits: Array
    values: Array
    nodes: Array
    weights: Array
    nodes3: Array
    weights3: Array


def workspace(system: System, read: int, guards: int) -> Work:
    """Scratch for a system, of which `read` quantities are read and a mode set has at most `guards` guards."""
    n, P = system.n, len(system.patches)
    nodes, weights = np.polynomial.legendre.leggauss(3)
    return Work(
        k=np.zeros((7, n)),
        y=np.zeros(n),
        y2=np.zeros(n),
        x0=np.zeros(n),
        copy=np.zeros(n),
        size=np.zeros(n),
        ask=np.zeros(n),
        ask_x=np.zeros(n),
        bear=np.zeros(n),
        bear_x=np.zeros(n),
        at=np.zeros(n),
        rates=np.zeros(n),
        T=np.zeros(system.inputs),
        scratch=np.zeros((P, P)),
        swung=np.zeros((len(system.generators), 2)),
        derivatives=np.zeros((DEGREE + 1, n)),
        spare=np.zeros((DEGREE + 1, n)),
        poly=np.zeros(DEGREE + 1),
        roots=np.zeros((WORK_ROWS, WORK_COLUMNS)),
        g=np.zeros(guards),
        fits=np.zeros((guards, 7)),
        values=np.zeros((5, read)),
        nodes=ledger.NODES,
        weights=ledger.WEIGHTS,
        nodes3=0.5 * (nodes + 1.0),
        weights3=0.5 * weights,
    )


class Log(NamedTuple):
    """What one call writes: states and slots at ticks, events."""

    out: Array  # [tick, n]
    modes: NDArray[np.int64]  # [tick]
    event: NDArray[np.int64]  # [event, 4] tick, guard kind, owner, key before
    place: Array  # [event] place in the tick


class State(NamedTuple):
    """What lives between calls."""

    ic: NDArray[np.int64]
    fc: Array
    x: Array
    energy: Array
    edges: Array  # [1] energy that came in with the stiffness of new sectors
    tally: NDArray[np.int64]  # ticks spent in each slot; the last counts all beyond
    watched: NDArray[np.int64]  # outputs that have a bound
    bound: Array  # of their sizes


@kernel
def advance(shape, tables, loan, begin, origin, ticks, wide, tolerance, substeps, booking, emitting, limit):
    """Carry the state from row `origin` of the log up to row `ticks`; returns a status.

    To be called again, no longer with `begin`, when that asks for a mode set or for more room for segments.
    ic[REACHED]: row up to which blocks are done; ic[BEYOND]: number of the first output beyond its bound, or -1;
    ic[PAST]: events of all calls so far.
    `tolerance` is None for a system that is linear in every mode set, `substeps` is None for methods without fixed
    steps: what is not asked for is not compiled. `wide` is None for a rig of few states (rig.solve.wide).
    """
    w, state, log, seg = loan.content
    t, work, now, written, read = lent(tables.content), lent(w), lent(state), lent(log), lent(seg)
    if begin:
        start(t, work, now, read, origin)
    return carry(
        shape,
        t,
        work,
        now,
        written,
        read,
        origin,
        ticks,
        wide,
        tolerance,
        substeps,
        booking,
        emitting,
        limit,
    )


@inner
def start(t, w, state, seg, origin):
    """Begin a block at row `origin` of the log: modes are settled first, no event and no segment was yet."""
    for g in range(t.swing.shape[0]):
        for i in range(2):
            w.swung[g, i] = state.x[t.swing[g, i]]
    state.ic[REACHED] = state.ic[TICK] = origin
    state.ic[EVENTS] = 0
    state.ic[PENDING] = max(state.ic[PENDING], SETTLE)
    seg.count[0] = 0


@inlined
def propagate(shape, wide, t, slot, ic, fc, x, w, origin, ticks, log, energy, booking, emitting, seg):
    """Quiet ticks as far as they go, else one opened tick, in a linear mode set. Returns the guard that fell or -1."""
    if fc[PLACE] == 0.0 and wide is not None:
        while quiet(t, slot, x, log.out[ic[TICK]], w, booking, emitting, (ic[TICK] - origin) * t.step[0], seg):
            for i in range(x.shape[0]):
                x[i] = log.out[ic[TICK], i]
            log.modes[ic[TICK]] = slot
            ic[TICK] += 1
            if ic[TICK] == ticks or (emitting and crowded(t, slot, seg, ticks - ic[TICK])):
                return -1
    elif fc[PLACE] == 0.0:
        first = ic[TICK]
        for g in range(t.guards[slot]):
            w.g[g] = dot(t.G[slot, g], x)
        for i in range(len(shape)):
            w.x0[i] = x[i]
        block = 1 if emitting else ticks - first
        done = exact.quiet(shape, t.E[slot, 0], t.G[slot], t.B[slot], t.guards[slot], x, w.g, block, log.out[first:])
        for tick in range(first, first + done):
            log.modes[tick] = slot
        if booking:
            for tick in range(first, first + done):
                ledger.book(t.work[slot, 0], t.active[slot], w.x0 if tick == first else log.out[tick - 1], energy)
        if emitting and done:
            emit_linear(t, slot, w.x0, (first - origin) * t.step[0], t.step[0], seg, w.derivatives)
        ic[TICK] += done
        if done == block:
            return -1
    ic[OPENED] += 1
    begin = (ic[TICK] - origin) * t.step[0]
    guard = exact.opened(shape, wide, t, slot, ic, fc, x, w, energy, booking, emitting, seg, begin)
    if guard < 0:
        for i in range(len(shape)):
            log.out[ic[TICK], i] = x[i]
        log.modes[ic[TICK]] = slot
        ic[TICK] += 1
    return guard


@inner
def carry(shape, t, w, state, log, seg, origin, ticks, wide, tolerance, substeps, booking, emitting, limit):
    """One block, begun, on borrowed arrays; the rest as in `advance`."""
    ic, fc, x, energy = state.ic, state.fc, state.x, state.energy
    while True:
        if ic[PENDING] != READY:
            status = settle(t, ic, x, w.size, w.T, w.scratch, w.copy, ic[REPEAT] > 1, energy)
            if status != DONE:
                return status
        if ic[TICK] >= ticks:
            break
        slot = t.slot_of[ic[KEY]]
        if emitting and crowded(t, slot, seg, ticks - ic[TICK]):
            return OVERFULL
        before, first = ic[KEY], ic[TICK]
        guard = -1
        if substeps is not None:
            guard = fixed(
                t.flow,
                shape,
                t,
                slot,
                ic,
                fc,
                x,
                w,
                origin,
                ticks,
                substeps,
                log.out,
                log.modes,
                energy,
                booking,
                emitting,
                seg,
                tolerance,
            )
        elif tolerance is not None and t.curved[slot]:
            guard = dopri5.stretch(
                shape,
                t,
                slot,
                ic,
                fc,
                x,
                w,
                origin,
                ticks,
                log.out,
                log.modes,
                energy,
                booking,
                emitting,
                seg,
                tolerance,
            )
            fc[PLACE] = min(fc[PLACE], 1.0 - 1.2e-16)
            if guard == -2:
                return LOST
        else:
            guard = propagate(shape, wide, t, slot, ic, fc, x, w, origin, ticks, log, energy, booking, emitting, seg)
        state.tally[min(slot, TALLIED - 1)] += ic[TICK] - first
        if guard >= 0:
            if t.change.shape[0] and t.kind[slot, guard] >= G_NEXT:
                state.edges[0] += gained(t, t.owner[slot, guard], before, ic[KEY], x)
            e = ic[EVENTS]
            if e >= log.event.shape[0]:
                return CHATTER
            same = e > 0 and log.event[e - 1, 0] == ic[TICK] and abs(log.place[e - 1] - fc[PLACE]) < 1e-12
            ic[REPEAT] = ic[REPEAT] + 1 if same else 0
            log.event[e, 0], log.event[e, 1] = ic[TICK], t.kind[slot, guard]
            log.event[e, 2], log.event[e, 3] = t.owner[slot, guard], before
            log.place[e] = fc[PLACE]
            ic[EVENTS] = e + 1
    ic[PAST] += ic[EVENTS]
    for i in range(len(shape)):
        if abs(x[i]) < _FLUSH:
            x[i] = 0.0
        if not (abs(x[i]) <= limit):
            return LOST
    ic[BEYOND] = beyond(t, t.slot_of[ic[KEY]], x, w, state.watched, state.bound)
    ic[REACHED] = ticks
    return DONE


@inner
def fixed(flow, shape, t, slot, ic, fc, x, w, origin, ticks, steps, out, modes, energy, booking, emitting, seg, bent):
    """A stretch by a method of fixed steps: kick where there is a `flow`, else rk4."""
    if flow is not None:
        fallen = kick.stretch(
            shape, t, flow, slot, ic, fc, x, w, origin, ticks, steps, out, modes, energy, booking, emitting, seg
        )
    else:
        fallen = rk4.stretch(
            shape, t, slot, ic, fc, x, w, origin, ticks, steps, out, modes, energy, booking, emitting, seg, bent
        )
    return fallen


@inner
def gained(t, sector, before, after, x):
    """What the stiffness stores more at x when the mode set `after` follows on `before` at an edge of a sector."""
    base, places = of_sector(t, sector), t.sectors[sector]
    old, new = t.change[sector, digit(before, base, places)], t.change[sector, digit(after, base, places)]
    s = 0.0
    for i in range(old.shape[0]):
        for j in range(old.shape[0]):
            s += 0.5 * x[i] * (new[i, j] - old[i, j]) * x[j]
    return s


@inner
def beyond(t, slot, x, w, watched, bound):
    """The first watched output whose size is beyond its bound; -1 if none is."""
    if watched.shape[0]:
        inputs(t, slot, x, w.T, w.scratch)
        for i in range(watched.shape[0]):
            value = dot(t.signals[slot, watched[i]], x) + dot(t.signals_t[slot, watched[i]], w.T)
            if not abs(value) <= bound[i]:
                return watched[i]
    return -1


@kernel
def evaluate(tables, loan, states, slots, values):
    """values[i, output] = every output of the rig at states[i] in slot slots[i]."""
    judge(lent(tables.content), lent(loan.content[0]), tables.content.wide, states, slots, values)


@inner
def judge(t, w, wide, states, slots, values):
    """`evaluate` on borrowed arrays."""
    for i in range(states.shape[0]):
        s, x = slots[i], states[i]
        inputs(t, s, x, w.T, w.scratch)
        if wide is not None:
            multiply(wide.output[s], x, 0, wide.output.shape[1], wide.product)
            for k in range(values.shape[1]):
                values[i, k] = wide.product[k] + dot(t.signals_t[s, k], w.T)
        else:
            for k in range(values.shape[1]):
                values[i, k] = dot(t.signals[s, k], x) + dot(t.signals_t[s, k], w.T)
