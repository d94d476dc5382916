"""Steps of dopri5 in stiff mode sets: exact propagators, with the inputs as polynomials.

x' = A x + b T(x). Where A has states that decay or vibrate within a tiny part of a tick, an explicit method needs steps
as short as that. Here the linear part is exact at every length of a step, as in rig.solve.exact. In a cell of
step / 2^level the inputs T, the friction forces and products, are polynomials through their values at the nodes among
PLACES (rig.solve.exact). The states there are rows over the state at the begin and these values; both are found
by fixed-point iteration. A cell is accepted if, at the checks, the inputs and the polynomials of states, guards and
outputs are right within the tolerance; otherwise the next one is half as long. If even the shortest cell is too long
for a steep law, dopri5 takes an explicit step of this length, which is then stable.

Source: Hochbruck and Ostermann, Exponential integrators, Acta Numerica 19 (2010) 209, section 2.2 (collocation).
"""

from __future__ import annotations

import numpy as np

from rig.compiled.kernel import by_address, inlined, inner
from rig.solve.column_blocks import LANE, ROUND, copy, dot, rounding
from rig.solve.contact_state import project_stick
from rig.solve.exact import CHECKS, PLACES, POWERS, evaluate_series
from rig.solve.forces import inputs
from rig.solve.places import add_powers, inputs_at
from rig.solve.roots import NONE, first_crossing
from rig.solve.segment_output import DEGREE

SHORT = -2  # of `take_cell`: the shortest cell is too long
_SHARE = 0.7  # share of the tolerance that an error at a check may use
_LEAST = 1e-6  # share of the largest coordinate or speed
_NEAR = 1e-9  # least relative error of an output
_FINEST = 1e-14  # least relative error of an input at the end of the iteration
_SWEEPS = 20  # most iterations of the inputs in a cell
_EASY = 1e-2  # error up to which the next cell is twice as long
_OFF = 4.0  # safety factor on the error of a guard at the checks: bounds it everywhere
_EARLY = 0.5  # share of a cell
_NODES = DEGREE + 1  # with the begin of the cell


@inlined
def write_state(rows, x, values, change, state):
    """Write the state at a place of a cell and its change since the begin, which keeps the digits of small ones.

    `rows` [n, n + len(values)], `values` of the inputs at the nodes.
    """
    n = x.shape[0]
    for i in range(n):
        s = 0.0
        for j in range(n):
            s += rows[i, j] * x[j]
        for j in range(values.shape[0]):
            s += rows[i, n + j] * values[j]
        change[i] = s
        state[i] = x[i] + s


@inlined
def find_inputs(t, mode_set, level, x, w, tolerance):
    """Find the inputs at the nodes of a cell by fixed-point iteration; whether it converged.

    w.node_inputs holds, for each input, its value at the begin and its changes to the nodes.
    """
    rows, values, count = t.reach[mode_set, level], w.node_inputs, w.T.shape[0]
    inputs(t, mode_set, x, w.T, w.scratch)
    for k in range(count):
        values[k * _NODES] = w.T[k]
        for i in range(1, _NODES):
            values[k * _NODES + i] = 0.0
    before = change = np.inf
    for sweep in range(_SWEEPS):
        before, change = change, 0.0
        for node in range(1, _NODES):
            write_state(rows[2 * node - 1], x, values, w.cell_changes[2 * node - 1], w.y)
            inputs(t, mode_set, w.y, w.T, w.scratch)
            for k in range(count):
                begin, new = values[k * _NODES], w.T[k] - values[k * _NODES]
                off = abs(new - values[k * _NODES + node])
                if not (off < np.inf):
                    return False
                if off > 0.0:
                    change = max(change, off / max(abs(begin), abs(w.T[k])))
                values[k * _NODES + node] = new
        if change <= max(0.01 * tolerance, _FINEST):
            return True
        if sweep > 2 and change > 0.5 * before:
            return False
    return False


@inlined
def raise_cell_scales(x, changes, count, size):
    """Raise the scale of each state to its values in the cell, and small scales to a share `_LEAST` of the largest.

    `count`: number of coordinates, and of speeds.
    """
    for i in range(x.shape[0]):
        for p in range(changes.shape[0]):
            size[i] = max(size[i], abs(x[i] + changes[p, i]))
    for first in (0, count):
        top = 0.0
        for i in range(first, first + count):
            top = max(top, size[i])
        for i in range(first, first + count):
            size[i] = max(size[i], _LEAST * top)


@inner
def solve_cell(t, mode_set, level, x, w, tolerance):
    """Solve the cell of step / 2^level from x; its error in units of the tolerance, infinity without a solution.

    The changes of states and inputs to the places are then in w.cell_changes and w.cell_inputs, their polynomials in
    w.derivatives and w.input_powers, the scales of the states in w.cell_size. w.y is overwritten.
    """
    n, count, X, values, size = x.shape[0], w.T.shape[0], w.cell_changes, w.node_inputs, w.cell_size
    if not find_inputs(t, mode_set, level, x, w, tolerance):
        return np.inf
    for p in range(X.shape[0]):
        write_state(t.reach[mode_set, level, p], x, values, X[p], w.y)
        inputs(t, mode_set, w.y, w.T, w.scratch)
        for k in range(count):
            w.cell_inputs[p, k] = w.T[k] - values[k * _NODES]
    for i in range(n):
        size[i] = max(w.size[i], abs(x[i]))
    rows = t.reach[mode_set, level, PLACES.shape[0] - 1]
    for i in range(n):  # at rest the changes are rounding
        size[i] = max(size[i], (rounding(rows[i, :n], x) + rounding(rows[i, n:], values)) / tolerance)
    raise_cell_scales(x, X, t.damping.shape[1], size)
    gain, worst = t.gain[mode_set, level], 0.0
    for c in range(DEGREE):
        for i in range(n):
            off = -X[2 * c, i]
            for node in range(DEGREE):
                off += CHECKS[c, node] * X[2 * node + 1, i]
            error = abs(off)
            for k in range(count):
                off = -w.cell_inputs[2 * c, k]
                for node in range(DEGREE):
                    off += CHECKS[c, node] * values[k * _NODES + 1 + node]
                error += gain[i, k] * abs(off)
            if error > 0.0:
                worst = max(worst, error / (_SHARE * tolerance * size[i]))
    for power in range(1, _NODES):
        for i in range(n):
            w.derivatives[power, i] = 0.0
            for node in range(DEGREE):
                w.derivatives[power, i] += POWERS[power - 1, node] * X[2 * node + 1, i]
        for k in range(count):
            w.input_powers[power, k] = 0.0
            for node in range(DEGREE):
                w.input_powers[power, k] += POWERS[power - 1, node] * values[k * _NODES + 1 + node]
    copy(n, x, w.derivatives[0])
    for k in range(count):
        w.input_powers[0, k] = values[k * _NODES]
    return worst


@inlined
def row_over_cell(row, row_t, w, coef):
    """Write the polynomial of a row over states and inputs to `coef`; returns its largest error at a check."""
    for power in range(_NODES):
        coef[power] = dot(row, w.derivatives[power]) + dot(row_t, w.input_powers[power])
    worst = 0.0
    for c in range(0, PLACES.shape[0], 2):
        change = 0.0
        for power in range(DEGREE, 0, -1):
            change = (change + coef[power]) * PLACES[c]
        worst = max(worst, abs(change - dot(row, w.cell_changes[c]) - dot(row_t, w.cell_inputs[c])))
    return worst


@inlined
def row_noise(row, row_t, w):
    """The size of the rounding error of a row over states and inputs in the cell."""
    noise = rounding(row, w.cell_size)
    for k in range(row_t.shape[0]):
        if row_t[k] != 0.0:
            for p in range(PLACES.shape[0]):
                noise = max(noise, ROUND * abs(row_t[k] * (w.input_powers[0, k] + w.cell_inputs[p, k])))
    return noise


@inner
def first_event_of_cell(t, mode_set, w):
    """The first event of any guard in the cell, as in rig.solve.dopri5.first_event: place, guard, doubtful."""
    first, guard, doubtful, poly = NONE, -1, False, w.poly
    for g in range(t.guards[mode_set]):
        row, row_t = t.G[mode_set, g], t.GT[mode_set, g]
        noise, off = row_noise(row, row_t, w), _OFF * row_over_cell(row, row_t, w, poly)
        if off <= noise:
            off = 0.0
        if abs(poly[0]) <= noise and poly[1] < 0.0 and poly[1] * poly[1] <= 4.0 * noise * poly[2]:
            poly[1] = 0.0  # it rises again before it has fallen by more than its rounding error
        poly[0] -= off
        early = theta = first_crossing(poly, DEGREE, noise, w.roots)
        poly[0] += off
        if early < NONE and off > 0.0:
            theta = first_crossing(poly, DEGREE, noise, w.roots)
        unseen = int(4.0 * early) < int(4.0 * theta)
        if theta < first:
            first, guard = theta, g
            unseen = unseen or (abs(poly[0]) <= noise and poly[1] >= -noise and theta < _EARLY)
        doubtful = doubtful or unseen
    return first, guard, doubtful


@inlined
def emit_outputs(t, mode_set, w, end, start, length, near, seg):
    """Write one segment of the outputs, of `length` s: the cell up to its place `end`. False if one is not accurate."""
    for s in range(seg.coef.shape[1]):
        row, row_t, coef = t.signals[mode_set, s], t.signals_t[mode_set, s], seg.coef[seg.count[0], s]
        error, last = row_over_cell(row, row_t, w, coef), 0.0
        for power in range(_NODES):
            last += coef[power]
        if error > near * max(abs(coef[0]), abs(last)) + row_noise(row, row_t, w):
            return False
        scale = 1.0
        for power in range(1, _NODES):
            scale *= end
            coef[power] *= scale
    seg.start[seg.count[0]], seg.length[seg.count[0]] = start, length
    seg.count[0] += 1
    return True


@inlined
def add_cell_powers(t, mode_set, w, end, length, energy):
    """Add the energy terms over the cell up to its place `end`, by Gauss-Legendre quadrature at LANE nodes."""
    for q in range(LANE):
        evaluate_series(w.derivatives, DEGREE, w.nodes[q] * end, w.y)
        for i in range(w.y.shape[0]):
            w.x_at[i, q] = w.y[i]
    inputs_at(t, mode_set, w, 0, LANE)
    add_powers(t, mode_set, w.x_at, w.T_at, w.weights, length, energy)


@by_address
def take_cell(shape, t, w, state, log, seg, plan, ticks):
    """Advance state.x over one cell, at most to the end of the tick, or to the first event; a part, of stiff mode sets.

    Returns the guard of the event, -1, or SHORT; then now.next_length is the length of the shortest cell [s].
    """
    now, x, h = state.progress[0], state.x, t.step[0]
    mode_set = t.mode_set_of[now.key]
    deepest, left, level, width, halved = t.graded[mode_set] - 1, 1.0 - now.place, 0, 1.0, False
    while level < deepest and (width * h > now.next_length * (1.0 + 1e-9) or 0.5 * width >= left):
        level, width = level + 1, 0.5 * width
    while True:
        now.trials += 1
        error = solve_cell(t, mode_set, level, x, w, plan.tolerance)
        if error <= 1.0:
            place, guard, doubtful = first_event_of_cell(t, mode_set, w)
            whole = left >= width
            end = 1.0 if whole else left / width
            if place <= end:
                end = place
            else:
                guard = -1
            start, length = (now.tick - now.reached + now.place) * h, end * width * h
            near = max(_NEAR, plan.tolerance)
            if not doubtful and (
                not plan.emitting or length == 0.0 or emit_outputs(t, mode_set, w, end, start, length, near, seg)
            ):
                break
        if level == deepest:
            now.next_length = width * h
            return SHORT
        level, width, halved = level + 1, 0.5 * width, True
    if plan.with_energy:
        add_cell_powers(t, mode_set, w, end, length, state.energy)
    copy(x.shape[0], w.cell_size, w.size)
    if guard < 0 and whole:
        for i in range(x.shape[0]):
            x[i] += w.cell_changes[PLACES.shape[0] - 1, i]
    else:
        evaluate_series(w.derivatives, DEGREE, end, x)
    longest = width * h * (2.0 if error <= _EASY else 1.0)
    now.next_length = longest if halved else max(now.next_length, longest)
    now.place += end * width
    if guard < 0:
        if t.stuck[mode_set]:
            project_stick(t, mode_set, x, w.copy)
        if not whole or left == width:
            copy(x.shape[0], x, log.out[now.tick])
            log.modes[now.tick] = mode_set
            now.tick += 1
            now.place = 0.0
    return guard
