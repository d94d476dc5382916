"""Exact propagation of rigs with many states: what a tick needs of the state is one product with one table.

    columns of a slot   E | certificates of the guards   and, where somebody reads, coefficients of the signals

Over a cell (a tick, or a half, quarter ... of it, where the fastest eigenvalue turns by two radians at most) the state
is a polynomial of degree ORDER, x(u) = sum_k u^k P_k x, economised (rig.solve.economy), and so is all that is linear in
it. A guard is certified over a tick by the Bernstein coefficients of a polynomial of low degree: they bound it, less
`margin`.|x|, which bounds what that degree leaves out. A guard that is not is looked at on its polynomial of full
degree; only if that falls is the tick opened.

The energy of a term over a tick is x.W x, of all ticks in a mode set therefore the sum of W[i, j] S[i, j] with
S = sum x x^T: ticks add to S alone, and terms are worked out when somebody asks. So it is with the powers along parts
of a tick. Products run along blocks of columns: the order of every sum is fixed, whatever the processor's registers.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from rig.kernel import inlined, inner, kernel
from rig.solve import expm
from rig.solve.economy import bernstein, economy
from rig.solve.lanes import BLOCK, blocks, gather, multiply, zeros
from rig.solve.ledger import gathered
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
_CHECKS = np.linspace(0.0, 1.0, 33)
_MARGIN = 1.25


class Wide(NamedTuple):
    """Tables of wide rigs, stacked by slot, in blocks of BLOCK columns: [slot, block, n, BLOCK]."""

    tick: Array  # n + guard (QUICK + 1) columns, over a tick
    signal: Array  # signal (DEGREE + 1) columns, over a cell
    output: Array  # a column for each output, now
    margin: Array  # guard columns
    state: Array  # ORDER n columns, over a cell
    guard: Array  # a block of ORDER + 1 columns for each guard, over a cell
    field: Array  # n columns over [x, T]: the derivative, of rigs that are not linear
    whole: Array  # [slot, n, n and what fills the block] sum of x x^T over the ticks that were booked as a whole
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


def depth(A: Array, step: float) -> int:
    """Halvings of a tick down to a cell."""
    turn = float(np.abs(np.linalg.eigvals(A)).max(initial=0.0)) * step
    size = float(expm.norm(A, expm.balance(A))) * step
    level = 0
    while turn > TURN or size > SIZE:
        turn, size, level = 0.5 * turn, 0.5 * size, level + 1
    return level


def empty(n: int, inputs: int, guards: int, signals: int, outputs: int) -> Wide:
    """Tables without a slot."""
    count = {
        "tick": n + guards * (QUICK + 1),
        "signal": signals * (DEGREE + 1),
        "output": outputs,
        "margin": guards,
        "state": ORDER * n,
        "guard": guards * BLOCK,
    }
    needed = {name: -(-columns // BLOCK) for name, columns in count.items()}
    filled = -(-n // BLOCK) * BLOCK
    return Wide(
        **{name: zeros((0, many, n, BLOCK)) for name, many in needed.items()},
        field=zeros((0, filled // BLOCK, n + inputs, BLOCK)),
        whole=zeros((0, n, filled)),
        part=zeros((0, n, filled)),
        nodes=0.5 * (NODES + 1.0),
        weights=0.5 * WEIGHTS,
        product=zeros(BLOCK * max(needed.values())),
        bound=zeros(BLOCK * needed["margin"]),
        poly=zeros(BLOCK),
        size=zeros(n),
        filled=zeros(filled),
        path=zeros((filled // BLOCK, ORDER + 1, BLOCK)),
        power=zeros(ORDER + 1),
    )


def series(A: Array, length: float) -> Array:
    """A^j length^j / j!, j = 0 .. TERMS, [j, n, n]; summed in the balanced scale."""
    n = len(A)
    d = expm.balance(A)
    out = np.zeros((TERMS + 1, n, -(-n // BLOCK) * BLOCK))
    out[0, :, :n] = np.eye(n)
    _powers(blocks((A * d[:, None] / d[None, :] * length).T), out)
    return np.asarray(out[:, :, :n] * d[None, None, :] / d[None, :, None])


@kernel
def _powers(table, out):
    """out[j] = out[j - 1] B / j, rows filled up to whole blocks; `table`: B in blocks of columns."""
    terms, n, width = out.shape
    for j in range(1, terms):
        for i in range(n):
            multiply(table, out[j - 1, i, :n], 0, table.shape[0], out[j, i])
            for k in range(width):
                out[j, i, k] /= j


def tables(
    terms: Array,
    E: Array,
    landing: Array,
    guards: Array,
    bounds: Array,
    field: Array,
    outputs: Array,
    read: int,
) -> dict[str, Array]:
    """The tables of one slot. `terms`: `series` over a cell; E [level, n, n] as in Slots; bounds [guard, n]: of chords.

    field [n, n + inputs]: the derivative; outputs [output, n], of which the first `read` are signals for the sensors.
    """
    n, levels = len(landing), len(E)
    polynomial = landing @ _combine(economy(ORDER, TERMS)[1:], terms) @ landing  # [ORDER, n, n]
    along = np.concatenate([np.eye(n)[None], polynomial])
    over_guards = np.zeros((len(guards), BLOCK, n))
    over_guards[:, : ORDER + 1] = np.einsum("gi,kij->gkj", guards, along)
    over_signals = np.einsum("si,kij->skj", outputs[:read], _combine(economy(DEGREE, TERMS), terms))
    if levels == 1:
        low = economy(QUICK, TERMS)
        powers = _CHECKS[:, None] ** np.arange(TERMS + 1)
        left = (powers - powers[:, : QUICK + 1] @ low) @ np.einsum("gi,kij->kgj", guards, terms).reshape(TERMS + 1, -1)
        margin = _MARGIN * np.abs(left).max(axis=0).reshape(guards.shape)
        quick = np.einsum("bk,gkj->gbj", bernstein(QUICK), np.einsum("gi,kij->gkj", guards, _combine(low, terms)))
    else:  # the ends of the chord, and how far from it a guard can be
        margin = bounds
        quick = np.repeat(guards[:, None, :], QUICK + 1, axis=1)
        quick[:, 1:] += (guards @ E[0])[:, None, :]
    return {
        "tick": blocks(np.concatenate([E[0], quick.reshape(-1, n)])),
        "signal": blocks(over_signals.reshape(-1, n)),
        "output": blocks(outputs),
        "margin": blocks(margin),
        "state": blocks(polynomial.reshape(-1, n)),
        "guard": blocks(over_guards.reshape(-1, n)),
        "field": blocks(field),
        "whole": np.zeros((n, -(-n // BLOCK) * BLOCK)),
        "part": np.zeros((n, -(-n // BLOCK) * BLOCK)),
    }


def take(t: Wide, count: int, work: Array, powers: Array) -> Array:
    """What `whole` and `part` of the first `count` slots come to, [term], and empties them.

    work, powers [slot, term, n, n]: forms.
    """
    return gathered(work, t.whole, count) + gathered(powers, t.part, count)


def at(places: Array, terms: Array) -> Array:
    """exp(A u) at places u of a cell, [place, n, n]."""
    return _combine(places[:, None] ** np.arange(TERMS + 1), terms)


def _combine(weights: Array, terms: Array) -> Array:
    """sum_j weights[k, j] terms[j], [k, n, n]."""
    out = np.zeros((len(weights), terms[0].size))
    expm.multiply(np.ascontiguousarray(weights), np.ascontiguousarray(terms.reshape(len(terms), -1)), out)
    return out.reshape(len(weights), *terms.shape[1:])


@inner
def quiet(t, slot, x, y, w, plan, start, seg):
    """One certified tick from x to y, its energy and its segments with it; False, and nothing done, without a proof.

    `w`: Workspace, whose `size` holds the sizes of the states so far.
    """
    n, guards = x.shape[0], t.guards[slot]
    z, size, bound = t.wide.product, t.wide.size, t.wide.bound
    for j in range(n):
        size[j] = abs(x[j])
    multiply(t.wide.margin[slot], size, 0, t.wide.margin.shape[1], bound)
    multiply(t.wide.tick[slot], x, 0, (n + guards * (QUICK + 1) + BLOCK - 1) // BLOCK, z)
    for g in range(guards):
        for k in range(QUICK + 1):
            if not z[n + g * (QUICK + 1) + k] > bound[g]:
                if t.depth[slot] > 0 or falls(t, slot, g, x, w):
                    return False
                break
    for i in range(n):
        y[i] = x[i] + z[i]
    if plan.booking:
        filled = t.wide.filled
        for i in range(n):
            filled[i] = x[i]
        gather(t.wide.whole[slot], filled, 1.0)
    if plan.emitting:
        emit(t, slot, x, 2.0 ** t.depth[slot], start, t.step[0], seg)
    return True


@inlined
def falls(t, slot, g, x, w):
    """Whether guard g falls in a tick from x on that is one cell."""
    poly = t.wide.poly
    multiply(t.wide.guard[slot], x, g, 1, poly)
    return first_fall(poly, ORDER, rounding(t.G[slot, g], w.size), w.roots) < NONE


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
def emit(t, slot, x, cells, start, length, seg):
    """Segments of the signals from x on, over [start, start + length] s: `cells` cells, or a part of one."""
    n, level = x.shape[0], t.depth[slot]
    pieces = max(int(cells + 0.5), 1)
    here, z = t.wide.size, t.wide.product
    for i in range(n):
        here[i] = x[i]
    for p in range(pieces):
        multiply(t.wide.signal[slot], here, 0, t.wide.signal.shape[1], z)
        put(z, min(cells, 1.0), start + p * (length / pieces), length / pieces, seg)
        if p + 1 < pieces:
            for i in range(n):
                s = 0.0
                for j in range(n):
                    s += t.E[slot, level, i, j] * here[j]
                z[i] = s
            for i in range(n):
                here[i] += z[i]


@inlined
def expand(t, slot, x):
    """Lay down the state over a cell from x on, for `along` and `book`."""
    n, z, path = x.shape[0], t.wide.product, t.wide.path
    multiply(t.wide.state[slot], x, 0, t.wide.state.shape[1], z)
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
def book(t, slot, share, length):
    """Book the first `share` of the cell, `length` s, at the nodes of Gauss and Legendre."""
    for q in range(t.wide.nodes.shape[0]):
        along(t, t.wide.nodes[q] * share)
        gather(t.wide.part[slot], t.wide.filled, t.wide.weights[q] * length)


@inner
def earliest(t, slot, x, size, share, poly, work):
    """First fall of any guard over `share` of a cell from x: (u in [0, 1] or NONE, guard)."""
    guards, z = t.guards[slot], t.wide.product
    multiply(t.wide.guard[slot], x, 0, guards, z)
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
        u = first_fall(poly, ORDER, rounding(t.G[slot, g], size), work)
        if u < first:
            first, guard = u, g
    return first, guard
