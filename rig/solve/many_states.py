"""Exact propagation of rigs with many states: what a tick needs of the state is one product with one table.

    columns of a mode set   E | certificates of the guards   and, where somebody reads, coefficients of the signals

Over a cell (a tick, or a half, quarter ... of it, where the fastest eigenvalue turns by two radians at most) the state
is a polynomial of degree ORDER, x(u) = sum_k u^k P_k x, economised (rig.model.economisation), and so is all that is
linear in it. A guard is certified over a tick by the Bernstein coefficients of a polynomial of low degree: they bound
it, less `margin`.|x|, which bounds what that degree leaves out. A guard that is not is looked at on its polynomial of
full degree; only if that falls is the tick opened.

The energy of a term over a tick is x.W x, of all ticks in a mode set therefore the sum of W[i, j] S[i, j] with
S = sum x x^T: ticks add to S alone, and terms are worked out when somebody asks. So it is with the powers along parts
of a tick. Products run along blocks of columns: the order of every sum is fixed, whatever the processor's registers.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from rig.kernel import inlined, inner, kernel
from rig.solve.column_blocks import BLOCK, gather, multiply
from rig.solve.roots import DEGREE as ORDER
from rig.solve.roots import NONE, first_fall
from rig.solve.rows import rounding
from rig.solve.segments import DEGREE

Array = NDArray[np.float64]
QUICK = 4  # degree of a certificate
TURN = 2.2  # rad, of the fastest eigenvalue in a cell: degree ORDER leaves 6e-13 of its amplitude
SIZE = 6.0  # |A| of the balanced matrix times a cell: TERMS terms then leave 1e-14
TERMS = 36
NODES, WEIGHTS = np.polynomial.legendre.leggauss(6)  # powers turn by twice as much: 1e-9 of those of the fastest motion
CHECKS = np.linspace(0.0, 1.0, 33)
MARGIN = 1.25


class Wide(NamedTuple):
    """Tables of wide rigs, stacked by mode set, in blocks of BLOCK columns: [mode set, block, n, BLOCK]."""

    tick: Array  # n + guard (QUICK + 1) columns, over a tick
    signal: Array  # signal (DEGREE + 1) columns, over a cell
    output: Array  # a column for each output, now
    margin: Array  # guard columns
    state: Array  # ORDER n columns, over a cell
    guard: Array  # a block of ORDER + 1 columns for each guard, over a cell
    field: Array  # n columns over [x, T]: the derivative, of rigs that are not linear
    whole: Array  # [mode set, n, n and what fills the block] sum of x x^T over the ticks that were booked as a whole
    part: Array  # the same, integral of x x^T over the parts of ticks that were
    nodes: Array  # in [0, 1], and their weights: of Gauss and Legendre, for the powers along a part of a cell
    weights: Array
    product: Array  # scratch [widest of these]
    bound: Array  # scratch [guard columns]
    poly: Array  # scratch [BLOCK]
    size: Array  # scratch [n]
    filled: Array  # scratch [n and what fills the block]
    path: Array  # scratch [block, ORDER + 1, BLOCK]: coefficients of the state over a cell
    power: Array  # scratch [ORDER + 1]


@kernel
def powers(table, out):
    """out[j] = out[j - 1] B / j, rows filled up to whole blocks; `table`: B in blocks of columns."""
    terms, n, width = out.shape
    for j in range(1, terms):
        for i in range(n):
            multiply(table, out[j - 1, i, :n], 0, table.shape[0], out[j, i])
            for k in range(width):
                out[j, i, k] /= j


@inner
def quiet(t, mode_set, x, y, w, plan, start, seg):
    """One certified tick from x to y, its energy and its segments with it; False, and nothing done, without a proof.

    `w`: Workspace, whose `size` holds the sizes of the states so far.
    """
    n, guards = x.shape[0], t.guards[mode_set]
    z, size, bound = t.wide.product, t.wide.size, t.wide.bound
    for j in range(n):
        size[j] = abs(x[j])
    multiply(t.wide.margin[mode_set], size, 0, t.wide.margin.shape[1], bound)
    multiply(t.wide.tick[mode_set], x, 0, (n + guards * (QUICK + 1) + BLOCK - 1) // BLOCK, z)
    for g in range(guards):
        for k in range(QUICK + 1):
            if not z[n + g * (QUICK + 1) + k] > bound[g]:
                if t.depth[mode_set] > 0 or falls(t, mode_set, g, x, w):
                    return False
                break
    for i in range(n):
        y[i] = x[i] + z[i]
    if plan.with_energy:
        filled = t.wide.filled
        for i in range(n):
            filled[i] = x[i]
        gather(t.wide.whole[mode_set], filled, 1.0)
    if plan.emitting:
        emit(t, mode_set, x, 2.0 ** t.depth[mode_set], start, t.step[0], seg)
    return True


@inlined
def falls(t, mode_set, g, x, w):
    """Whether guard g falls in a tick from x on that is one cell."""
    poly = t.wide.poly
    multiply(t.wide.guard[mode_set], x, g, 1, poly)
    return first_fall(poly, ORDER, rounding(t.G[mode_set, g], w.size), w.roots) < NONE


@inner
def put(z, share, start, length, seg):
    """One segment from the coefficients z of the signals over a cell, of which the first `share` is meant."""
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
def emit(t, mode_set, x, cells, start, length, seg):
    """Segments of the signals from x on, over [start, start + length] s: `cells` cells, or a part of one."""
    n, level = x.shape[0], t.depth[mode_set]
    pieces = max(int(cells + 0.5), 1)
    here, z = t.wide.size, t.wide.product
    for i in range(n):
        here[i] = x[i]
    for p in range(pieces):
        multiply(t.wide.signal[mode_set], here, 0, t.wide.signal.shape[1], z)
        put(z, min(cells, 1.0), start + p * (length / pieces), length / pieces, seg)
        if p + 1 < pieces:
            for i in range(n):
                s = 0.0
                for j in range(n):
                    s += t.E[mode_set, level, i, j] * here[j]
                z[i] = s
            for i in range(n):
                here[i] += z[i]


@inlined
def expand(t, mode_set, x):
    """Lay down the state over a cell from x on, for `along` and `book`."""
    n, z, path = x.shape[0], t.wide.product, t.wide.path
    multiply(t.wide.state[mode_set], x, 0, t.wide.state.shape[1], z)
    for i in range(n):
        path[i // BLOCK, 0, i % BLOCK] = x[i]
    for k in range(1, ORDER + 1):
        for i in range(n):
            path[i // BLOCK, k, i % BLOCK] = z[(k - 1) * n + i]


@inner
def along(t, u):
    """The state at u in the cell, filled up; to be read before the next."""
    power, out = t.wide.power, t.wide.filled
    power[0] = 1.0
    for k in range(1, ORDER + 1):
        power[k] = u * power[k - 1]
    multiply(t.wide.path, power, 0, t.wide.path.shape[0], out)


@inner
def add_energy(t, mode_set, share, length):
    """Book the first `share` of the cell, `length` s, at the nodes of Gauss and Legendre."""
    for q in range(t.wide.nodes.shape[0]):
        along(t, t.wide.nodes[q] * share)
        gather(t.wide.part[mode_set], t.wide.filled, t.wide.weights[q] * length)


@inner
def earliest(t, mode_set, x, size, share, poly, work):
    """First fall of any guard over `share` of a cell from x: (u in [0, 1] or NONE, guard)."""
    guards, z = t.guards[mode_set], t.wide.product
    multiply(t.wide.guard[mode_set], x, 0, guards, z)
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
        u = first_fall(poly, ORDER, rounding(t.G[mode_set, g], size), work)
        if u < first:
            first, guard = u, g
    return first, guard
