"""Exact propagation of rigs with many states: what a tick needs of the state is one product with one table.

    columns of a slot   E | certificates of the guards | coefficients of the signals | squares of the ledger

Over a cell (a tick, or a half, quarter ... of it, where the fastest eigenvalue turns by two radians at most) the state
is a polynomial of degree ORDER, x(u) = sum_k u^k P_k x, economised (rig.solve.economy), and so is all that is linear in
it. A guard is certified over a tick by the Bernstein coefficients of a polynomial of low degree: they bound it, less
`margin`.|x|, which bounds what that degree leaves out. The fall of a guard that is not is found on its polynomial of
full degree. The energy of a term over a tick, x.W x, is a sum of as many squares as W has eigenvalues that are not
rounding: 70 in place of 190 columns for a brake. Products run along columns: the order of every sum is fixed, and the
compiler can still use wide registers.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from rig.kernel import inner
from rig.solve import expm
from rig.solve.economy import bernstein, economy
from rig.solve.forces import rounding
from rig.solve.ledger import RESISTOR
from rig.solve.roots import DEGREE as ORDER
from rig.solve.roots import NONE, first_fall
from rig.solve.segments import DEGREE

Array = NDArray[np.float64]
QUICK = 4  # degree of a certificate
TURN = 2.2  # rad, of the fastest eigenvalue in a cell: degree ORDER leaves 6e-13 of its amplitude
SIZE = 6.0  # |A| of the balanced matrix times a cell: TERMS terms then leave 1e-14
TERMS = 36
NODES, WEIGHTS = np.polynomial.legendre.leggauss(6)  # powers turn by twice as much: 1e-9 of those of the fastest motion
_CHECKS = np.linspace(0.0, 1.0, 33)
_MARGIN = 1.25
_NONE = 1e-15  # of the largest eigenvalue of a form: rounding


class Wide(NamedTuple):
    """Tables of wide rigs, stacked by slot; columns first, so that a product runs along them."""

    tick: Array  # [slot, n, n + guard (QUICK + 1) + signal (DEGREE + 1) + squares]; over a tick, signals over a cell
    squares: NDArray[np.int64]  # [slot] number of squares
    sign: Array  # [slot, square]
    term: NDArray[np.int64]  # [slot, square] of the ledger
    margin: Array  # [slot, n, guard]
    state: Array  # [slot, n, ORDER n] over a cell
    guard: Array  # [slot, n, guard (ORDER + 1)] over a cell
    factor: Array  # [slot, n, factors]: what is multiplied in the powers, see `book`
    nodes: Array  # in [0, 1], and their weights: of Gauss and Legendre, for the powers along a part of a cell
    weights: Array
    product: Array  # scratch [widest of these]
    size: Array  # scratch [n]


def depth(A: Array, step: float) -> int:
    """Halvings of a tick down to a cell."""
    turn = float(np.abs(np.linalg.eigvals(A)).max(initial=0.0)) * step
    size = float(expm.norm(A, expm.balance(A))) * step
    level = 0
    while turn > TURN or size > SIZE:
        turn, size, level = 0.5 * turn, 0.5 * size, level + 1
    return level


def empty(n: int, guards: int, signals: int, terms: int, factors: int) -> Wide:
    """Tables without a slot."""
    tick, state = n + guards * (QUICK + 1) + signals * (DEGREE + 1) + terms * n, ORDER * n
    z = np.zeros
    return Wide(
        tick=z((0, n, tick)),
        squares=z(0, dtype=np.int64),
        sign=z((0, terms * n)),
        term=z((0, terms * n), dtype=np.int64),
        margin=z((0, n, guards)),
        state=z((0, n, state)),
        guard=z((0, n, guards * (ORDER + 1))),
        factor=z((0, n, factors)),
        nodes=0.5 * (NODES + 1.0),
        weights=0.5 * WEIGHTS,
        product=z(max(tick, state, guards * (ORDER + 1), factors)),
        size=z(n),
    )


def series(A: Array, length: float) -> Array:
    """A^j length^j / j!, j = 0 .. TERMS, [j, n, n]; summed in the balanced scale."""
    n = len(A)
    d = expm.balance(A)
    B = A * d[:, None] / d[None, :] * length
    out = np.zeros((TERMS + 1, n, n))
    out[0] = np.eye(n)
    for j in range(1, TERMS + 1):
        expm.multiply(out[j - 1], B, out[j])
        out[j] /= j
    return np.asarray(out * d[None, None, :] / d[None, :, None])


def tables(
    terms: Array,
    E: Array,
    landing: Array,
    guards: Array,
    bounds: Array,
    signals: Array,
    factors: Array,
    work: Array,
    scale: Array,
) -> dict[str, Array]:
    """The tables of one slot. `terms`: `series` over a cell; E [level, n, n] as in Slots.

    bounds [guard, n]: of chords; factors [row, n]: see `book`; work [term, n, n]: integrals of the powers over a tick;
    scale [n]: of the balanced matrix.
    """
    n, levels = len(landing), len(E)
    polynomial = landing @ _combine(economy(ORDER, TERMS)[1:], terms) @ landing  # [ORDER, n, n]
    along = np.concatenate([np.eye(n)[None], polynomial])
    over_guards = np.einsum("gi,kij->gkj", guards, along)
    over_signals = np.einsum("si,kij->skj", signals, _combine(economy(DEGREE, TERMS), terms))
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
    squares, sign, term = _squares(work, scale)
    parts = (E[0], quick.reshape(-1, n), over_signals.reshape(-1, n), squares)
    return {
        "squares": np.count_nonzero(sign),
        "sign": sign,
        "term": term,
        "tick": np.concatenate(parts).T,
        "margin": margin.T,
        "state": polynomial.reshape(-1, n).T,
        "guard": over_guards.reshape(-1, n).T,
        "factor": factors.T,
    }


def _squares(work: Array, scale: Array) -> tuple[Array, Array, NDArray[np.int64]]:
    """Rows r, signs s, terms: x.W x = sum s (r.x)^2 over the rows of a term, [terms n] of them, zeros behind."""
    terms, n, _ = work.shape
    rows, sign, term = np.zeros((terms * n, n)), np.zeros(terms * n), np.zeros(terms * n, dtype=np.int64)
    first = 0
    for number, form in enumerate(work):
        values, shapes = np.linalg.eigh(form / np.outer(scale, scale))
        kept = np.flatnonzero(np.abs(values) > _NONE * np.abs(values).max(initial=0.0))
        last = first + len(kept)
        rows[first:last] = (np.sqrt(np.abs(values[kept])) * shapes[:, kept] * scale[:, None]).T
        sign[first:last], term[first:last] = np.sign(values[kept]), number
        first = last
    return rows, sign, term


def at(places: Array, terms: Array) -> Array:
    """exp(A u) at places u of a cell, [place, n, n]."""
    return _combine(places[:, None] ** np.arange(TERMS + 1), terms)


def _combine(weights: Array, terms: Array) -> Array:
    """sum_j weights[k, j] terms[j], [k, n, n]."""
    out = np.zeros((len(weights), terms[0].size))
    expm.multiply(np.ascontiguousarray(weights), np.ascontiguousarray(terms.reshape(len(terms), -1)), out)
    return out.reshape(len(weights), *terms.shape[1:])


@inner
def product(table, x, first, count, out):
    """out[r] = sum_j x[j] table[j, first + r] for r < count, four columns at a time."""
    n = x.shape[0]
    for r in range(count):
        out[r] = 0.0
    j = 0
    while j + 4 <= n:
        a, b, c, d = x[j], x[j + 1], x[j + 2], x[j + 3]
        ta, tb, tc, td = table[j], table[j + 1], table[j + 2], table[j + 3]
        for r in range(count):
            out[r] += ((a * ta[first + r] + b * tb[first + r]) + c * tc[first + r]) + d * td[first + r]
        j += 4
    while j < n:
        a = x[j]
        ta = table[j]
        for r in range(count):
            out[r] += a * ta[first + r]
        j += 1


@inner
def quiet(t, slot, x, y, bounds, booking, energy, emitting, start, seg):
    """One certified tick from x to y, its energy and its segments with it; False, and nothing done, without a proof."""
    n, guards = x.shape[0], t.guards[slot]
    z, size, signals = t.wide.product, t.wide.size, seg.coef.shape[1] * (DEGREE + 1)
    first = n + t.G.shape[1] * (QUICK + 1)
    for j in range(n):
        size[j] = abs(x[j])
    product(t.wide.margin[slot], size, 0, guards, bounds)
    count = first
    if emitting or booking:
        count += signals
    if booking:
        count += t.wide.squares[slot]
    product(t.wide.tick[slot], x, 0, count, z)
    for g in range(guards):
        for k in range(QUICK + 1):
            if not z[n + g * (QUICK + 1) + k] > bounds[g]:
                return False
    for i in range(n):
        y[i] = x[i] + z[i]
    if booking:
        at = first + signals
        for r in range(t.wide.squares[slot]):
            energy[t.wide.term[slot, r]] += t.wide.sign[slot, r] * z[at + r] * z[at + r]
    if emitting:
        if t.depth[slot] == 0:
            put(z, first, 1.0, start, t.step[0], seg)
        else:
            emit(t, slot, x, 2.0 ** t.depth[slot], start, t.step[0], seg)
    return True


@inner
def put(z, first, share, start, length, seg):
    """One segment from the coefficients z[first:] of the signals over a cell, of which the first `share` is meant."""
    at = seg.count[0]
    seg.count[0] = at + 1
    if at >= seg.start.shape[0]:  # counted, not kept: the run stops with the number needed
        return
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
    first, count = n + t.G.shape[1] * (QUICK + 1), seg.coef.shape[1] * (DEGREE + 1)
    pieces = max(int(cells + 0.5), 1)
    here, z = t.wide.size, t.wide.product
    for i in range(n):
        here[i] = x[i]
    for p in range(pieces):
        product(t.wide.tick[slot], here, first, count, z)
        put(z, 0, min(cells, 1.0), start + p * (length / pieces), length / pieces, seg)
        if p + 1 < pieces:
            for i in range(n):
                s = 0.0
                for j in range(n):
                    s += t.E[slot, level, i, j] * here[j]
                z[i] = s
            for i in range(n):
                here[i] += z[i]


@inner
def expand(t, slot, x, share, derivatives):
    """derivatives[k] of x(u), 0 <= u <= 1, over `share` of a cell."""
    n, z = x.shape[0], t.wide.product
    product(t.wide.state[slot], x, 0, ORDER * n, z)
    for i in range(n):
        derivatives[0, i] = x[i]
    f = 1.0
    for k in range(1, ORDER + 1):
        f *= share
        for i in range(n):
            derivatives[k, i] = f * z[(k - 1) * n + i]


@inner
def earliest(t, slot, x, size, share, poly, work):
    """First fall of any guard over `share` of a cell from x: (u in [0, 1] or NONE, guard)."""
    guards, z = t.guards[slot], t.wide.product
    product(t.wide.guard[slot], x, 0, guards * (ORDER + 1), z)
    first, guard = NONE, -1
    for g in range(guards):
        f, lowest = share, z[g * (ORDER + 1)]
        poly[0] = lowest
        for k in range(1, ORDER + 1):
            poly[k] = f * z[g * (ORDER + 1) + k]
            lowest += min(poly[k], 0.0)
            f *= share
        if lowest > 0.0:
            continue
        u = first_fall(poly, ORDER, rounding(t.G[slot, g], size), work)
        if u < first:
            first, guard = u, g
    return first, guard


@inner
def book(t, slot, w, reach, length, energy):
    """Energy along a part of a cell, whose derivatives are in w, up to `reach`, by Gauss and Legendre's nodes.

    Factors of the powers: of each patch its force, slip and what the drive supplies; of each normal its force and the
    speed along it; the damping forces; the forces; of each resistor what
    its heat is the square of. See rig.solve.ledger.
    """
    n, nq, z = w.y.shape[0], t.force.shape[0], t.wide.product
    patches, normals = t.slip.shape[0], t.of_patch.shape[0]
    count = t.wide.factor.shape[2]
    for q in range(t.wide.nodes.shape[0]):
        u = t.wide.nodes[q] * reach
        for i in range(n):
            s = w.derivatives[ORDER, i]
            for k in range(ORDER - 1, -1, -1):
                s = s * u + w.derivatives[k, i]
            w.y[i] = s
        product(t.wide.factor[slot], w.y, 0, count, z)
        scale = t.wide.weights[q] * reach * length
        at = 3 * patches + 2 * normals
        for p in range(patches):
            energy[0] += scale * z[p] * z[2 * patches + p]
            energy[1] += scale * z[p] * z[patches + p]
        for i in range(nq):
            energy[2] += scale * w.y[nq + i] * z[at + i]
            energy[3] += scale * w.y[nq + i] * z[at + nq + i]
        for k in range(normals):
            energy[4] += scale * z[3 * patches + k] * z[3 * patches + normals + k]
        for r in range(t.conductance.shape[0]):
            energy[RESISTOR] += scale * t.conductance[r] * z[at + 2 * nq + r] ** 2
