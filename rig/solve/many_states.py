"""Exact propagation of rigs with many states: everything that a tick needs is one product of a table with the state.

    columns of a mode set   E | certificates of the guards   and, if sensors read, coefficients of the outputs

A cell is a tick, or a half, a quarter ... of it, in which the fastest eigenvalue turns by at most two radians. Over a
cell the state is a polynomial of degree ORDER, x(u) = sum_k u^k P_k x, economised (rig.model.many_states_tables), and
so is everything that is linear in it. A guard is certified over a tick by the Bernstein coefficients of a polynomial of
low degree. They bound it from below after `margin`.|x| is subtracted, which bounds the truncation error of that degree.
A guard that is not certified is evaluated with its polynomial of full degree. The tick is subdivided only if this one
has a zero.

The energy of a term over a tick is x.W x. The energy over all ticks in a mode set is therefore the sum of W[i, j] S[i,
j] with S = sum x x^T: a tick only adds to S, and the terms are computed when they are read. The same holds for the
powers along parts of a tick. Products run along blocks of columns, so the order of every sum is the same on any
processor.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from rig.compiled.kernel import inlined, inner, kernel
from rig.solve.column_blocks import BLOCK, copy, gather, multiply, rounding
from rig.solve.roots import DEGREE as ORDER
from rig.solve.roots import NONE, first_crossing
from rig.solve.segment_output import DEGREE

Array = NDArray[np.float64]
QUICK = 4  # degree of a certificate
TURN = 2.2  # rad, turn of the fastest eigenvalue in a cell: the error of degree ORDER is 6e-13 of its amplitude
SIZE = 6.0  # |A| of the balanced matrix times a cell: the error of TERMS terms is then 1e-14
TERMS = 36
NODES, WEIGHTS = np.polynomial.legendre.leggauss(6)  # powers turn twice as fast: error 1e-9 for the fastest mode
CHECKS = np.linspace(0.0, 1.0, 33)
MARGIN = 1.25


class ManyStatesTables(NamedTuple):
    """Tables of rigs with many states, stacked by mode set, in blocks of BLOCK columns: [mode set, block, n, BLOCK]."""

    tick: Array  # n + guard (QUICK + 1) columns, over a tick
    signal: Array  # output (DEGREE + 1) columns, over a cell: the outputs that sensors read
    output: Array  # a column for each output, at the present state
    margin: Array  # guard columns
    state: Array  # ORDER n columns, over a cell
    guard: Array  # a block of ORDER + 1 columns for each guard, over a cell
    field: Array  # [mode set, n + inputs, n padded to lanes] the derivative over [x, T], for rigs that are not linear
    whole: Array  # [mode set, n, n padded to blocks] sum of x x^T over whole ticks
    part: Array  # the same: integral of x x^T over parts of ticks
    nodes: Array  # Gauss-Legendre nodes in [0, 1], for the powers along a part of a cell; their weights
    weights: Array
    product: Array  # scratch [widest of these]
    bound: Array  # scratch [guard columns]
    poly: Array  # scratch [BLOCK]
    size: Array  # scratch [n]
    filled: Array  # scratch [n padded to blocks]
    path: Array  # scratch [block, ORDER + 1, BLOCK]: coefficients of the state over a cell
    power: Array  # scratch [ORDER + 1]


@kernel
def taylor_matrices(table, out):
    """out[j] = out[j - 1] B / j, rows padded to whole blocks. `table`: B in blocks of columns."""
    terms, n, width = out.shape
    for j in range(1, terms):
        for i in range(n):
            multiply(table, out[j - 1, i, :n], 0, table.shape[0], out[j, i])
            for k in range(width):
                out[j, i, k] /= j


@inner
def quiet_tick(t, mode_set, x, y, w):
    """Advance from x to y by one certified tick. Returns False, changing nothing, if a guard is not certified.

    `w`: Workspace; w.size holds the largest values of the states so far.
    """
    n, guards = x.shape[0], t.guards[mode_set]
    z, size, bound = t.many_states.product, t.many_states.size, t.many_states.bound
    for j in range(n):
        size[j] = abs(x[j])
    multiply(t.many_states.margin[mode_set], size, 0, t.many_states.margin.shape[1], bound)
    multiply(t.many_states.tick[mode_set], x, 0, (n + guards * (QUICK + 1) + BLOCK - 1) // BLOCK, z)
    for g in range(guards):
        for k in range(QUICK + 1):
            if not z[n + g * (QUICK + 1) + k] > bound[g]:
                if t.depth[mode_set] > 0 or has_event(t, mode_set, g, x, w):
                    return False
                break
    for i in range(n):
        y[i] = x[i] + z[i]
    return True


@inlined
def add_tick_energy(t, mode_set, x):
    """Add a tick from x to the energy sums."""
    filled = t.many_states.filled
    copy(x.shape[0], x, filled)
    gather(t.many_states.whole[mode_set], filled, 1.0)


@inlined
def has_event(t, mode_set, g, x, w):
    """Whether guard g has an event in a tick from x that is a single cell."""
    poly = t.many_states.poly
    multiply(t.many_states.guard[mode_set], x, g, 1, poly)
    return first_crossing(poly, ORDER, rounding(t.G[mode_set, g], w.size), w.roots) < NONE


@inner
def put_segment(z, share, start, length, seg):
    """Write one segment from the coefficients z of the outputs over a cell; it covers the first `share` of the cell."""
    at = seg.count[0]
    seg.count[0] = at + 1
    first = 0
    for s in range(seg.coef.shape[1]):
        f = 1.0
        for k in range(DEGREE + 1):
            seg.coef[at, s, k] = f * z[first]
            f *= share
            first += 1
    seg.start[at], seg.length[at] = start, length


@inner
def emit_cells(t, mode_set, x, cells, start, length, seg):
    """Write the segments of the outputs from x over [start, start + length] s: `cells` cells, or a part of one."""
    n, level = x.shape[0], t.depth[mode_set]
    pieces = max(int(cells + 0.5), 1)
    here, z = t.many_states.size, t.many_states.product
    copy(n, x, here)
    for p in range(pieces):
        multiply(t.many_states.signal[mode_set], here, 0, t.many_states.signal.shape[1], z)
        put_segment(z, min(cells, 1.0), start + p * (length / pieces), length / pieces, seg)
        if p + 1 < pieces:
            for i in range(n):
                s = 0.0
                for j in range(n):
                    s += t.E[mode_set, level, i, j] * here[j]
                z[i] = s
            for i in range(n):
                here[i] += z[i]


@inlined
def expand_cell(t, mode_set, x):
    """Compute the polynomial of the state over a cell from x, for `evaluate_cell` and `add_cell_energy`."""
    n, z, path = x.shape[0], t.many_states.product, t.many_states.path
    multiply(t.many_states.state[mode_set], x, 0, t.many_states.state.shape[1], z)
    for i in range(n):
        path[i // BLOCK, 0, i % BLOCK] = x[i]
    for k in range(1, ORDER + 1):
        for i in range(n):
            path[i // BLOCK, k, i % BLOCK] = z[(k - 1) * n + i]


@inner
def evaluate_cell(t, u):
    """Evaluate the state at u in the cell into `filled`, padded to whole blocks; the next call overwrites it."""
    power, out = t.many_states.power, t.many_states.filled
    power[0] = 1.0
    for k in range(1, ORDER + 1):
        power[k] = u * power[k - 1]
    multiply(t.many_states.path, power, 0, t.many_states.path.shape[0], out)


@inner
def add_cell_energy(t, mode_set, share, length):
    """Add the first `share` of the cell, `length` s long, to the energy sums by Gauss-Legendre quadrature."""
    for q in range(t.many_states.nodes.shape[0]):
        evaluate_cell(t, t.many_states.nodes[q] * share)
        gather(t.many_states.part[mode_set], t.many_states.filled, t.many_states.weights[q] * length)


@inner
def first_event_of_cell(t, mode_set, x, size, share, poly, work):
    """The first event of any guard over `share` of a cell from x: (u in [0, 1] or NONE, guard)."""
    guards, z = t.guards[mode_set], t.many_states.product
    multiply(t.many_states.guard[mode_set], x, 0, guards, z)
    first, guard = NONE, -1
    for g in range(guards):
        f, lowest = share, z[g * BLOCK]
        poly[0] = lowest
        for k in range(1, ORDER + 1):
            poly[k] = f * z[g * BLOCK + k]
            lowest += min(poly[k], 0.0)
            f *= share
        if lowest > 0.0:
            continue
        u = first_crossing(poly, ORDER, rounding(t.G[mode_set, g], size), work)
        if u < first:
            first, guard = u, g
    return first, guard
