"""Exact propagation within a mode set: quiet ticks, and ticks that are subdivided.

A quiet tick is one product y = x + E x with a proof that no guard has an event in it. A tick without this proof is
subdivided into cells of step / 2^j, from left to right. Each cell is as long as alignment and certificate allow, and
has its own propagator. In a cell of the smallest size every guard is a Taylor polynomial, whose first zero crossing is
located. After an event a Taylor series carries the state to the next grid point, and the cells become longer again.
Event times are exact to rounding at every step size.

In a stiff mode set a tick has very many cells, because some states decay within a tiny part of it. As soon as these
states have decayed, everything is smooth again. So outputs and guards are evaluated with the exact propagators at the
Chebyshev-Lobatto places of a cell, [0, PLACES], however long it is. Every second place is a node of a polynomial, the
others check it. A cell is as long as its polynomials are accurate: short after an event, then each is twice as long as
the one before, and a whole tick at last. The number of cells grows with the logarithm of the stiffness.
"""

from __future__ import annotations

from math import comb

import numpy as np
from numpy.typing import NDArray

from rig.compiled.kernel import by_address, inlined, inner
from rig.solve.column_blocks import ROUND, copy, dot, rounding
from rig.solve.contact_state import apply_event
from rig.solve.energy_balance import add_energy
from rig.solve.many_states import (
    add_cell_energy,
    add_tick_energy,
    emit_cells,
    evaluate_cell,
    expand_cell,
    first_event_of_cell,
    quiet_tick,
)
from rig.solve.roots import NONE, first_crossing
from rig.solve.segment_output import DEGREE, emit_linear, nearly_full
from rig.solve.specialised import call, local, state_count

PLACES = 0.5 - 0.5 * np.cos(np.pi * np.arange(1, 2 * DEGREE + 1) / (2 * DEGREE))
"""In turn a check and a node; the node at the begin of the cell is left out."""
_NEAR = 1e-9  # error of an output at a check, relative to its values at the ends of the cell
_EXACT = 1e-12  # error of a guard with which an event is located, of its changes
_FAINT = 1.0 / 64.0  # the same, of its noise
_OFF = 4.0  # safety factor on the error of a guard at the checks: bounds it everywhere
FULL = -3  # of `stretch`: no room for the segments of a tick or a cell


def _lagrange() -> tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.float64]]:
    """What the polynomial makes of the changes from the begin of a cell to its nodes, each [., node].

    Coefficients of u^1 .. u^DEGREE; values at the checks; all Bernstein coefficients.
    """
    nodes = np.concatenate([[0.0], PLACES[1::2]])
    powers, checks = np.zeros((2, DEGREE, DEGREE))
    for i in range(DEGREE):
        others = np.delete(nodes, i + 1)
        powers[:, i] = np.polynomial.polynomial.polyfromroots(others)[1:] / np.prod(nodes[i + 1] - others)
        checks[:, i] = np.prod((PLACES[::2, None] - others) / (nodes[i + 1] - others), axis=1)
    hulls = np.zeros((DEGREE + 1, DEGREE))
    for b in range(DEGREE + 1):
        hulls[b] = [comb(b, k) / comb(DEGREE, k) for k in range(1, DEGREE + 1)]
    return powers, checks, hulls @ powers


POWERS, CHECKS, _HULL = _lagrange()


@inlined
def fit(rows, x, change):
    """Write the changes to the nodes, as far as `rows` [place, n] give them; returns the largest error at a check."""
    worst = 0.0
    for i in range(DEGREE):
        change[i] = dot(rows[2 * i + 1], x)
    for c in range(DEGREE):
        off = -dot(rows[2 * c], x)
        for i in range(DEGREE):
            off += CHECKS[c, i] * change[i]
        worst = max(worst, abs(off))
    return worst


@by_address
def first_event_of_fits(shape, t, w, state, log, seg, plan, level):
    """The first event of any guard over the cell of step / 2^level from state.x; a part, of stiff mode sets.

    Returns the guard, and its place in the cell in w.poly[0]: -1 without an event, and -2 if a polynomial is not
    accurate enough to locate one. w.poly and w.roots are overwritten. A guard that falls is followed to its zero from
    any positive value: its terms may be so large beside it (the force that holds a body to a surface behind a fast
    drive) that their rounding error is no small time. A change within this error of a guard that is zero or less
    decides nothing; the next cell decides (rig.solve.roots).
    """
    mode_set, x = t.mode_set_of[state.progress[0].key], state.x
    first, guard, change = NONE, -1, w.roots[0]
    for g in range(t.guards[mode_set]):
        begin, zero = dot(t.G[mode_set, g], x), rounding(t.G[mode_set, g], w.size)
        off, lowest, largest = _OFF * fit(t.along[mode_set, level, g], x, change), begin, 0.0
        for b in range(DEGREE + 1):
            bound = begin
            for i in range(DEGREE):
                bound += _HULL[b, i] * change[i]
            lowest = min(lowest, bound)
        for i in range(DEGREE):
            largest = max(largest, abs(change[i]))
        if lowest > off + zero or (-zero <= begin <= 0.0 and off + largest <= zero):
            continue
        if off > _EXACT * largest + _FAINT * zero:
            return -2
        w.poly[0] = begin
        for k in range(DEGREE):
            w.poly[k + 1] = 0.0
            for i in range(DEGREE):
                w.poly[k + 1] += POWERS[k, i] * change[i]
        u = first_crossing(w.poly, DEGREE, 0.0 if begin > 0.0 > w.poly[1] else zero, w.roots)
        if u < first:
            first, guard = u, g
    w.poly[0] = first
    return guard


@inner
def fit_outputs(t, mode_set, level, x, seg, w):
    """Write the polynomials of the outputs over the cell of step / 2^level from x to the next segment.

    Returns False if one of them is not accurate. w.poly is overwritten.
    """
    change, guards = w.poly, t.G.shape[1]
    for s in range(seg.coef.shape[1]):
        signal, coef, noise = t.signals[mode_set, s], seg.coef[seg.count[0], s], 0.0
        for j in range(x.shape[0]):
            noise += abs(signal[j]) * max(w.size[j], abs(x[j]))
        coef[0] = dot(signal, x)
        error = fit(t.along[mode_set, level, guards + s], x, change)
        if error > _NEAR * max(abs(coef[0]), abs(coef[0] + change[DEGREE - 1])) + ROUND * noise:
            return False
        for k in range(DEGREE):
            coef[k + 1] = 0.0
            for i in range(DEGREE):
                coef[k + 1] += POWERS[k, i] * change[i]
    return True


@by_address
def emit_graded(shape, t, w, state, log, seg, plan, level):
    """Write segments of the outputs over a cell of step / 2^level, each as long as its polynomials allow.

    A part, of stiff mode sets. The state at the begin of the cell is in w.y2, its time [s] in w.poly[0]. Returns 0,
    writing nothing, if there is too little room. w.y2, w.copy, w.poly, w.derivatives are overwritten.
    """
    mode_set, here, moved, start = t.mode_set_of[state.progress[0].key], w.y2, w.copy, w.poly[0]
    n, depth, first, done = state.x.shape[0], t.depth[mode_set], seg.count[0], 0
    cells, finest = 1 << (depth - level), t.step[0] / 2.0**depth
    while done < cells:
        at, width = depth, 1
        while width < cells and done % (2 * width) == 0:
            at, width = at - 1, 2 * width
        if seg.count[0] + 1 > seg.start.shape[0]:
            seg.count[0] = first
            return 0
        while at < depth and not fit_outputs(t, mode_set, at, here, seg, w):
            at, width = at + 1, width // 2
        if at < depth:
            seg.start[seg.count[0]], seg.length[seg.count[0]] = start + done * finest, width * finest
            seg.count[0] += 1
        elif plan.many_states:
            emit_cells(t, mode_set, here, 1.0, start + done * finest, finest, seg)
        else:
            emit_linear(t, mode_set, here, start + done * finest, finest, seg, w.derivatives)
        done += width
        for i in range(n):
            moved[i] = dot(t.E[mode_set, at, i], here)
        for i in range(n):
            here[i] += moved[i]
    return 1


@inlined
def emit_cell(shape, t, w, state, log, seg, plan, x, level, start, length):
    """Write the outputs over [start, start + length] s, the cell of step / 2^level from x.

    Returns False, writing nothing, if there is too little room: only in stiff mode sets (`nearly_full`).
    """
    mode_set = t.mode_set_of[state.progress[0].key]
    if t.room[mode_set] == 0:
        copy(x.shape[0], x, w.y2)
        w.poly[0] = start
        return call(plan.emit_graded, shape, t, w, state, log, seg, plan, level) == 1
    if plan.many_states:
        emit_cells(t, mode_set, x, 2.0 ** (t.depth[mode_set] - level), start, length, seg)
    else:
        emit_linear(t, mode_set, x, start, length, seg, w.derivatives)
    return True


@by_address
def quiet_ticks(shape, t, w, state, log, seg, plan, ticks):
    """Advance state.x by up to `ticks` certified ticks and write the rows of the log. Returns the number of ticks done.

    A specialised kernel (rig.solve.specialised).
    """
    now, n = state.progress[0], state_count(shape)
    mode_set, first = t.mode_set_of[now.key], now.tick
    count = t.guards[mode_set]
    E, G, B, g, x, out = t.E[mode_set, 0], t.G[mode_set], t.B[mode_set], w.g, state.x, log.out[first:]
    here, y = local(shape, x), local(shape, x)
    copy(n, x, here)
    for k in range(count):
        g[k] = dot(G[k], x)
    done = ticks
    for tick in range(ticks):
        for i in range(n):
            s = 0.0
            for j in range(n):
                s += E[i, j] * here[j]
            y[i] = here[i] + s
        certain = True
        for k in range(count):
            after, bound = 0.0, 0.0
            for j in range(n):
                after += G[k, j] * y[j]
                bound += B[k, j] * abs(here[j])
            certain = certain and g[k] > bound and after > bound
            g[k] = after
        if not certain:
            done = tick
            break
        for i in range(n):
            out[tick, i] = here[i] = y[i]
    copy(n, here, x)
    return done


@by_address
def certified_cell(shape, t, w, state, log, seg, plan, level):
    """Whether it is proved that no guard has an event in the cell of step / 2^level from state.x; its end is in w.y.

    A specialised kernel.
    """
    mode_set, n, width = t.mode_set_of[state.progress[0].key], state_count(shape), 1.0 / (1 << level)
    shrink = width * width
    E, G, GA, B, BA = t.E[mode_set, level], t.G[mode_set], t.GA[mode_set], t.B[mode_set], t.BA[mode_set]
    x, y = state.x, w.y
    for i in range(n):
        s = 0.0
        for j in range(n):
            s += E[i, j] * x[j]
        y[i] = x[i] + s
    for k in range(t.guards[mode_set]):
        before, after, bound = 0.0, 0.0, 0.0
        for j in range(n):
            before += G[k, j] * x[j]
            after += G[k, j] * y[j]
            bound += B[k, j] * abs(x[j])
        if before > bound * shrink and after > bound * shrink:
            continue
        begins, ends, slope_bound = 0.0, 0.0, 0.0
        for j in range(n):
            begins += GA[k, j] * x[j]
            ends += GA[k, j] * y[j]
            slope_bound += BA[k, j] * abs(x[j])
        steepest = slope_bound * shrink
        if begins > steepest and ends > steepest and before >= -rounding(G[k], x):
            continue
        if begins < -steepest and ends < -steepest and after > 0.0:
            continue
        return 0
    return 1


@inlined
def taylor_terms(A, x, length, terms, derivatives):
    """Taylor terms: derivatives[k] = A^k x length^k / k!, k = 0 .. terms."""
    n = x.shape[0]
    copy(n, x, derivatives[0])
    for k in range(1, terms + 1):
        f = length / k
        for i in range(n):
            derivatives[k, i] = f * dot(A[i], derivatives[k - 1])


@inner
def evaluate_series(derivatives, terms, u, x):
    """Evaluate the Taylor series: x = sum_k derivatives[k] u^k."""
    for i in range(x.shape[0]):
        s = derivatives[terms, i]
        for k in range(terms - 1, -1, -1):
            s = s * u + derivatives[k, i]
        x[i] = s


@inlined
def first_event_of_series(t, mode_set, size, derivatives, terms, poly, work):
    """The first event of any guard along a Taylor cell: (u in [0, 1] or NONE, guard)."""
    G, first, guard = t.G[mode_set], NONE, -1
    for k in range(t.guards[mode_set]):
        for d in range(terms + 1):
            poly[d] = dot(G[k], derivatives[d])
        u = first_crossing(poly, terms, rounding(G[k], size), work)
        if u < first:
            first, guard = u, k
    return first, guard


@inner
def add_quiet_energy(work, active, x, rows, energy):
    """Add the energy terms of quiet ticks from x through all `rows` [tick, n] but the last."""
    for tick in range(rows.shape[0]):
        add_energy(work, active, x if tick == 0 else rows[tick - 1], energy)


@by_address
def stretch(shape, t, w, state, log, seg, plan, ticks):
    """Advance by quiet ticks as far as possible, or else by one subdivided tick, in a linear mode set.

    A part (rig.solve.specialised). Returns the guard of the event, -1, or FULL.
    """
    now, x, with_energy, emitting = state.progress[0], state.x, plan.with_energy, plan.emitting
    n, origin, mode_set = x.shape[0], now.reached, t.mode_set_of[now.key]
    if now.place == 0.0 and plan.many_states:
        while quiet_tick(t, mode_set, x, log.out[now.tick], w):
            start = (now.tick - origin) * t.step[0]
            if emitting and not emit_cell(shape, t, w, state, log, seg, plan, x, 0, start, t.step[0]):
                return FULL
            if with_energy:
                add_tick_energy(t, mode_set, x)
            copy(n, log.out[now.tick], x)
            log.modes[now.tick] = mode_set
            now.tick += 1
            if now.tick == ticks or (emitting and nearly_full(t, mode_set, seg, ticks - now.tick)):
                return -1
    elif now.place == 0.0:
        first = now.tick
        copy(n, x, w.x0)
        block = 1 if emitting else ticks - first
        done = call(plan.quiet_ticks, shape, t, w, state, log, seg, plan, block)
        if emitting and done:
            start = (first - origin) * t.step[0]
            if not emit_cell(shape, t, w, state, log, seg, plan, w.x0, 0, start, t.step[0]):
                copy(n, w.x0, x)
                return FULL
        for tick in range(first, first + done):
            log.modes[tick] = mode_set
        if with_energy and done > 0:
            add_quiet_energy(t.work[mode_set, 0], t.active[mode_set], w.x0, log.out[first : first + done], state.energy)
        now.tick += done
        if done == block:
            return -1
    guard = subdivide(shape, t, w, state, log, seg, plan, mode_set)
    if guard == -1:
        copy(n, x, log.out[now.tick])
        log.modes[now.tick] = mode_set
        now.tick += 1
    return guard


@inlined
def subdivide(shape, t, w, state, log, seg, plan, mode_set):
    """Subdivide one tick, or the rest of it, and advance the state to its end or to the first event.

    Returns the guard of the event, -1 at the end of the tick, or FULL before the end.
    """
    now, x, energy = state.progress[0], state.x, state.energy
    with_energy, many_states = plan.with_energy, plan.many_states
    n, h, y = x.shape[0], t.step[0], w.y
    begin = (now.tick - now.reached) * h
    depth, terms = t.depth[mode_set], t.order[mode_set]
    cells = 2.0**depth
    now.subdivided += 1
    u, event_at, event_of = now.place, NONE, -1  # event located beforehand: place in the tick, guard
    while u < 1.0:
        if plan.emitting and seg.count[0] + 2 > seg.start.shape[0]:
            return full(now, u)
        position = u * cells
        whole = int(position)
        level, width = depth, 1.0 / cells
        partial = position != whole
        if not partial:
            while level > 0 and whole % 2 == 0 and u + 2.0 * width <= 1.0:
                whole //= 2
                level -= 1
                width *= 2.0
            held = False
            while not many_states or depth > 0:  # of a rig with many states, the whole tick was tried before
                certified = call(plan.certified_cell, shape, t, w, state, log, seg, plan, level)
                if event_of < 0 and certified == 0 and t.room[mode_set] == 0 and level < depth:
                    event_of = call(plan.first_event_of_fits, shape, t, w, state, log, seg, plan, level)
                    certified = 1 if event_of == -1 else 0
                    event_at = u + width * w.poly[0] if event_of >= 0 else NONE
                if u + width <= event_at if event_of >= 0 else certified:
                    held = True
                    break
                if level == depth:
                    break
                level += 1
                width *= 0.5
            if held:
                start, length = begin + u * h, width * h
                if plan.emitting and not emit_cell(shape, t, w, state, log, seg, plan, x, level, start, length):
                    return full(now, u)
                if with_energy:
                    add_energy(t.work[mode_set, level], t.active[mode_set], x, energy)
                copy(n, y, x)
                u += width
                continue
        length = (int(position) + 1) / cells - u
        if event_of >= 0:
            place, guard = max(event_at - u, 0.0) / length, event_of
            if many_states:
                expand_cell(t, mode_set, x)
            else:
                taylor_terms(t.A[mode_set], x, length * h, terms, w.derivatives)
        elif many_states:
            place, guard = first_event_of_cell(t, mode_set, x, w.size, length * cells, w.poly, w.roots)
            expand_cell(t, mode_set, x)
        else:
            taylor_terms(t.A[mode_set], x, length * h, terms, w.derivatives)
            place, guard = first_event_of_series(t, mode_set, w.size, w.derivatives, terms, w.poly, w.roots)
        reach = 1.0 if guard < 0 else place
        if reach > 0.0:
            if plan.emitting:
                if many_states:
                    emit_cells(t, mode_set, x, reach * length * cells, begin + u * h, reach * length * h, seg)
                else:
                    emit_linear(t, mode_set, x, begin + u * h, reach * length * h, seg, w.spare)
            if with_energy:
                if many_states:
                    add_cell_energy(t, mode_set, reach * length * cells, reach * length * h)
                else:
                    add_series_energy(t, mode_set, w, terms, reach, length * h, energy)
            if many_states:
                evaluate_cell(t, reach * length * cells)
                copy(n, t.many_states.filled, x)
            else:
                evaluate_series(w.derivatives, terms, reach, x)
        u = u + reach * length if guard >= 0 else (int(position) + 1) / cells
        if guard >= 0:
            now.place = u
            apply_event(t, mode_set, guard, now, x)
            return guard
    now.place = 0.0
    return -1


@inlined
def full(now, place):
    """Note the place in the tick from which `subdivide` continues when there is more room."""
    now.subdivided -= 1
    now.place = place
    return FULL


@inlined
def add_series_energy(t, mode_set, w, terms, reach, length, energy):
    """Add the energy terms along a Taylor cell up to `reach`, by Gauss-Legendre quadrature at eight nodes."""
    for q in range(w.nodes.shape[0]):
        evaluate_series(w.derivatives, terms, w.nodes[q] * reach, w.y)
        scale = w.weights[q] * reach * length
        for term in range(energy.shape[0]):
            if t.active[mode_set, term]:
                s = 0.0
                for i in range(w.y.shape[0]):
                    s += w.y[i] * dot(t.powers[mode_set, term, i], w.y)
                energy[term] += scale * s
