"""Whether no rig of a box grows: proved for the whole box, refuted by a rig, or undecided.

The matrix of a rig is a polynomial of the uncertain values. In a box, changes of first and second order (secants,
squares and products of two values, each as a value of its own between -1 and 1) make it A0 + L diag(d) R, and what is
left is a matrix E of known size. No such matrix has the eigenvalue s if

    B(s) = [ |R G L|   |R G| ]        G = (s - A0)^-1, in the coordinates of the eigenvectors of A0
           [ e |G L|   e |G| ]        e: size of E

has a Perron root below 1. If this holds all along the edge of the region that eigenvalues must not enter, and the rig
in the middle has none inside, no rig of the box has. Else the box is halved along the value that contributes most to
the root, and the halves are examined.

    continuous in time   the edge is Re s = limit within the band, Re s = max(limit, 0) outside of it
    sampled loop         the same for z = exp(s T): circles

The edge is covered by cells, not by single frequencies: 1/(s - lambda) within a cell is a Taylor polynomial about its
middle and a rest that is bounded. A cell that is too large for the proof is halved.

What it rests on: rounding; that the matrix is the polynomial, which is compared at points that the fit does not know;
that E, which is computed at 2^(count + 1) points of each box, is nowhere larger than twice what it is there.
"""

from __future__ import annotations

import itertools
import math
import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from rig.analysis.linear.control_loop import VANISHED

Array = NDArray[np.float64]
Complex = NDArray[np.complex128]
Matrices = Callable[[Array], Array]
PROVED, REFUTED, UNDECIDED = "proved", "refuted", "undecided"
BOXES = 4000
"""Most boxes that are examined."""
_TERMS = 500  # of the polynomial
_DEGREE = 15  # highest power of a value
_FALLS = 1e-3  # size of a term over that of the next lower power, at least: values may act together only
_POINTS = 3  # for each term
_SMOOTH = 1e-7  # of the largest entry: with a larger error the matrix is no polynomial
_LITTLE = 1e-13  # of the largest entry: terms of the polynomial that are left out
_CHECKS = 24  # rigs at which the polynomial is compared
_RANK = 1e-9  # of the largest singular value of a change: the rest of it goes into E
_DEFECTIVE = 1e9  # condition of eigenvectors: beyond, A0 is moved
_MOVED = 1e-10  # of its largest entry
_LARGER = 2.0  # times what E is at the points of a box
_CORNERS = 5  # most uncertain values of which all corners are compared; else as many random ones
_TAYLOR = 3  # terms of a cell
_AROUND = (1.0, 4.0, 16.0)  # distances of an eigenvalue from the edge: ends of the first cells
_CELLS = 20_000  # of a box, at most
_HALVED = 40  # times a cell, at most
_POWERS = 60  # steps to a Perron root
_FAR = 4.0  # times the largest eigenvalue: there the last cell begins, which has no end
_FARTHEST = 8  # times that it moves on
_NEUTRAL = 1e-9  # of the largest eigenvalue: a mode without growth outside of the band grows less


@dataclass(frozen=True)
class Certificate:
    """What is known of a box: `verdict` is "proved", "refuted" or "undecided".

    `rig` [count]: of a refuted one, a rig that grows faster than the limit, in the unit cube. `boxes`: how many were
    examined, `left`: how many are undecided, `share`: of the volume, that is proved. `cells`: how many cells of the
    edge. `degree`, `error`: of the polynomial, in its largest entry; `rest`: the largest E of a proved box over the
    distance of an eigenvalue from the edge.
    """

    verdict: str
    limit: float
    rig: Array | None = None
    boxes: int = 0
    left: int = 0
    share: float = 0.0
    cells: int = 0
    degree: int = 0
    error: float = 0.0
    rest: float = 0.0
    seconds: float = 0.0
    why: str = ""


class _Region(NamedTuple):
    """Where eigenvalues must not be: `limit` [1/s] within `band` [rad/s], `outer` outside of it, up to `top` [rad/s].

    `period` [s]: of a sampled loop, else 0.
    """

    limit: float
    outer: float
    band: tuple[float, float]
    top: float
    period: float

    def holds(self, values: Complex) -> bool:
        """Whether one of the eigenvalues is in it."""
        rates: Complex = values
        if self.period:
            values = values[np.abs(values) > VANISHED]
            rates = np.asarray(np.log(values.astype(np.complex128)) / self.period, dtype=np.complex128)
        tone = np.abs(rates.imag)
        inside = (tone >= self.band[0]) & (tone <= self.band[1])
        return bool(np.any((rates.real > np.where(inside, self.limit, self.outer)) & (tone <= self.top)))

    def edge(self, far: float) -> Iterator[tuple[complex, complex]]:
        """Its edge in the upper half plane as straight pieces of the s-plane, up to `far` [rad/s]."""
        top = min(far, self.top)
        low, high = (min(end, top) for end in self.band)
        if self.limit == self.outer:
            low = high = top
        if low > 0.0:
            yield complex(self.outer, 0.0), complex(self.outer, low)
        if high > low:
            if low > 0.0:
                yield complex(self.limit, low), complex(self.outer, low)
            yield complex(self.limit, low), complex(self.limit, high)
            if high < top:
                yield complex(self.limit, high), complex(self.outer, high)
                yield complex(self.outer, high), complex(self.outer, top)
        if self.top < far:
            yield complex(self.limit if high == top else self.outer, top), complex(far, top)


class _Polynomial:
    """The matrix [n, n] of rigs u [k, count] as a polynomial, scaled so that rows and columns are alike in size.

    `error`: the largest one at rigs that the fit does not know, over the largest entry `size`.
    """

    def __init__(self, matrix: Matrices, count: int) -> None:
        from scipy.linalg import matrix_balance

        middle = matrix(np.full(count, 0.5))
        self.n = len(middle)
        _, (scales, _) = matrix_balance(middle, permute=False, separate=True)
        self._matrix = matrix
        self._scale = scales[None, :] / scales[:, None]
        chance = np.random.default_rng(1)
        self.powers = _powers([self._sizes(i, count) for i in range(count)])
        # most points near the ends of each value: there a polynomial through points that are evenly spread fails
        points = 0.5 - 0.5 * np.cos(math.pi * chance.random((_POINTS * len(self.powers), count)))
        held = self._true(points)
        self.size = max(float(np.abs(held).max(initial=0.0)), 1e-300)
        self.coefficients = np.linalg.lstsq(self._basis(points), held, rcond=None)[0]
        kept = np.abs(self.coefficients).max(axis=1) > _LITTLE * self.size
        self.powers = self.powers[kept]
        self.coefficients = self.coefficients[kept]
        checked = chance.random((_CHECKS, count))
        missed = self._basis(checked) @ self.coefficients - self._true(checked)
        self.error = float(np.abs(missed).max()) / self.size

    def _true(self, points: Array) -> Array:
        return np.array([(self._matrix(u) * self._scale).ravel() for u in points])

    def _sizes(self, i: int, count: int) -> Array:
        """The sizes [power] of the terms of one value, with the others in the middle, over that of the first."""
        nodes = 0.5 - 0.5 * np.cos(math.pi * (np.arange(_DEGREE + 1) + 0.5) / (_DEGREE + 1))
        points = np.full((len(nodes), count), 0.5)
        points[:, i] = nodes
        series = np.polynomial.chebyshev.chebfit(2.0 * nodes - 1.0, self._true(points), _DEGREE)
        sizes = np.abs(series).max(axis=1) / max(float(np.abs(series).max()), 1e-300)
        falling = np.maximum.accumulate(sizes[::-1])[::-1]
        return np.where(falling > _LITTLE, falling, 0.0)

    @property
    def degree(self) -> int:
        """The highest power of a value."""
        return int(self.powers.max(initial=0))

    def _basis(self, points: Array) -> Array:
        """Products of Chebyshev polynomials [point, term]."""
        each = np.polynomial.chebyshev.chebvander(2.0 * points - 1.0, self.degree)  # [point, value, power]
        terms = np.ones((len(points), len(self.powers)))
        for value in range(points.shape[1]):
            terms *= each[:, value, self.powers[:, value]]
        return terms

    def __call__(self, points: Array) -> Array:
        """Return the matrices [k, n, n] of rigs [k, count]."""
        return (self._basis(points) @ self.coefficients).reshape(-1, self.n, self.n)


def _powers(sizes: list[Array]) -> NDArray[np.int64]:
    """The powers [term, value] of a polynomial: a term of several values is as small as the product of theirs."""
    terms: list[tuple[tuple[int, ...], float]] = [((), 1.0)]
    for falling in sizes:
        own = np.maximum(falling, _FALLS ** np.arange(len(falling)))
        own[0] = 1.0
        terms = [((*p, k), size * own[k]) for p, size in terms for k in range(len(own)) if size * own[k] > _LITTLE]
        terms = sorted(terms, key=lambda term: -term[1])[:_TERMS]
    return np.array([p for p, _ in terms], dtype=np.int64).reshape(len(terms), len(sizes))


class _Box(NamedTuple):
    """A box of rigs in the coordinates of the eigenvectors of its A0.

    `poles` [n]: eigenvalues of A0; `left` [n, change], `right` [change, n]; `of` [change, count]: which uncertain
    values a change belongs to; `rest`: the size of E; `middle` [n]: eigenvalues of the rig in the middle.
    """

    poles: Complex
    left: Complex
    right: Complex
    of: Array
    rest: float
    middle: Complex


def certify(
    matrix: Matrices,
    count: int,
    limit: float = 0.0,
    band: tuple[float, float] = (0.0, math.inf),
    period: float = 0.0,
    up_to: float = math.inf,
    suspects: Array | None = None,
    most: int = BOXES,
    progress: Callable[[int, int], None] | None = None,
) -> Certificate:
    """Return whether no rig grows by more than `limit` [1/s] in a `band` [Hz], or at all outside of it.

    `matrix`: u [count] in the unit cube -> [n, n], continuous in time, or of one `period` [s]; eigenvalues count up to
    the frequency `up_to` [Hz]. `suspects` [k, count]: rigs that may refute it. `most`: boxes that are examined. The
    answer depends on these alone. Raises what `matrix` raises.
    """
    begin = time.perf_counter()
    of_rigs = _Polynomial(matrix, count)
    middle = np.linalg.eigvals(of_rigs(np.full((1, count), 0.5))[0])
    region = _region(limit, band, period, up_to, middle)
    known = {"limit": limit, "degree": of_rigs.degree, "error": of_rigs.error}
    for u in np.zeros((0, count)) if suspects is None else suspects:
        if region.holds(np.linalg.eigvals(matrix(u)).astype(np.complex128)):
            return Certificate(REFUTED, rig=np.array(u), seconds=time.perf_counter() - begin, **known)  # type: ignore[arg-type]
    if of_rigs.error > _SMOOTH:
        why = f"the matrix of a rig is no smooth function of the uncertain values (polynomial: {of_rigs.error:.1e})"
        return Certificate(UNDECIDED, left=1, seconds=time.perf_counter() - begin, why=why, **known)  # type: ignore[arg-type]
    todo = [(np.zeros(count), np.ones(count))]
    boxes = cells = 0
    proved = rest = 0.0
    rig = None
    while todo and boxes < most and rig is None:
        low, high = todo.pop()
        boxes += 1
        box = _made(of_rigs, low, high)
        u = 0.5 * (low + high)
        if region.holds(box.middle) and region.holds(np.linalg.eigvals(matrix(u)).astype(np.complex128)):
            rig = u
            continue
        taken, weights, size = _examined(box, region)
        cells += taken
        if weights is None:
            proved += float(np.prod(high - low))
            rest = max(rest, size)
        elif count:
            i = int(np.argmax(weights))
            first, second = high.copy(), low.copy()
            first[i] = second[i] = u[i]
            todo += [(low, first), (second, high)]
        else:
            todo.append((low, high))
            break
        if progress is not None:
            progress(round(1000 * proved), 1000)
    verdict = REFUTED if rig is not None else (UNDECIDED if todo else PROVED)
    seconds = time.perf_counter() - begin
    of_box = {"boxes": boxes, "left": len(todo), "share": proved, "cells": cells, "rest": rest, "seconds": seconds}
    return Certificate(verdict, rig=rig, **known, **of_box)  # type: ignore[arg-type]


def _region(limit: float, band: tuple[float, float], period: float, up_to: float, values: Complex) -> _Region:
    """The region that eigenvalues must not enter."""
    size = float(np.abs(values).max(initial=0.0))
    neutral = _NEUTRAL * (1.0 / period if period else size)
    low, high = (2.0 * math.pi * edge for edge in band)
    outer = max(limit, 0.0) + neutral
    if limit >= 0.0:  # one line, which a mode without growth does not touch
        limit = outer
    nyquist = math.pi / period if period else math.inf
    return _Region(limit, outer, (low, high), min(2.0 * math.pi * up_to, nyquist), period)


def _made(of_rigs: _Polynomial, low: Array, high: Array) -> _Box:
    """Return the box between two corners."""
    m = len(low)
    unit = np.eye(m)
    first, second = np.array([*itertools.combinations(range(m), 2)], dtype=int).reshape(-1, 2).T
    both = unit[first] + unit[second]
    ends = _ends(m)
    tried = np.vstack([ends, 0.5 * ends])
    steps = np.vstack([np.zeros((1, m)), unit, -unit, both, tried])
    A = of_rigs(0.5 * (low + high) + 0.5 * (high - low) * steps)
    centre, plus, minus, mixed, others = np.split(A, np.cumsum([1, m, m, len(both)]))
    squares = 0.5 * (plus + minus) - centre  # of d^2, which is 1/2 + 1/2 d'
    products = mixed - plus[first] - plus[second] + centre  # of d_i d_j
    changes = np.concatenate([0.5 * (plus - minus), 0.5 * squares, products])
    L, R, kept, owners = _factors(changes, np.vstack([unit, unit, both]), of_rigs.error * of_rigs.size * of_rigs.n)
    A0 = centre[0] + 0.5 * squares.sum(axis=0)
    poles, V, back = _diagonalised(A0)
    size = float(np.linalg.norm(back @ (A0 @ V - V * poles)))
    size += of_rigs.error * of_rigs.size * float(np.linalg.norm(back) * np.linalg.norm(V))
    d = np.hstack([tried, 2.0 * tried**2 - 1.0, tried[:, first] * tried[:, second]])
    missed = back @ (others - A0 - np.tensordot(d, kept, 1)) @ V
    size += _LARGER * float(np.linalg.norm(missed, axis=(1, 2)).max())
    values = np.linalg.eigvals(centre[0]).astype(np.complex128)
    return _Box(poles.astype(np.complex128), back @ L, R @ V, owners, size, values)


def _diagonalised(A: Array) -> tuple[Complex, Complex, Complex]:
    """Eigenvalues, eigenvectors V and V^-1 of A, or of a matrix close to it, if A has too few eigenvectors.

    What this changes goes into E.
    """
    poles, V = np.linalg.eig(A)
    if np.linalg.cond(V) > _DEFECTIVE:
        moved = np.random.default_rng(len(A)).random(A.shape) - 0.5
        poles, V = np.linalg.eig(A + _MOVED * float(np.abs(A).max()) * moved)
    return poles, V, np.linalg.inv(V)


def _ends(m: int) -> Array:
    """Corners [k, m] of a box from -1 to 1, all or as many random ones."""
    if m <= _CORNERS:
        return np.array([*itertools.product((-1.0, 1.0), repeat=m)]).reshape(2**m, m)
    return np.sign(np.random.default_rng(m).random((2**_CORNERS, m)) - 0.5)


def _factors(changes: Array, of: Array, smallest: float) -> tuple[Array, Array, Array, Array]:
    """Changes [k, n, n] as products of columns [n, rank] and rows [rank, n]; the changes that these are, without what
    is smaller than `smallest`; and the values [rank, count] that each belongs to.
    """
    k, n, _ = changes.shape
    kept = np.zeros_like(changes)
    columns, rows = [np.zeros((n, 0))], [np.zeros((0, n))]
    owners = []
    least = max(_RANK * float(np.abs(changes).max(initial=0.0)), smallest)
    for i in range(k):
        if np.abs(changes[i]).max() <= least:
            continue
        U, sizes, V = np.linalg.svd(changes[i])
        rank = int(np.sum(sizes > max(_RANK * sizes[0], least)))
        root = np.sqrt(sizes[:rank])
        columns.append(U[:, :rank] * root)
        rows.append(V[:rank] * root[:, None])
        kept[i] = columns[-1] @ rows[-1]
        owners += [of[i]] * rank
    return np.hstack(columns), np.vstack(rows), kept, np.array(owners).reshape(len(owners), of.shape[1])


def _examined(box: _Box, region: _Region) -> tuple[int, Array | None, float]:
    """Examine the edge: number of cells; None if it is proved, else how much each value contributes; the largest
    size of E over the distance of an eigenvalue.
    """
    products = (box.right[:, None, :] * box.left.T[None, :, :]).reshape(-1, len(box.poles)).T
    far = region.top if region.period else _FAR * max(float(np.abs(box.poles).max(initial=0.0)), 1e-300)
    taken = 0
    largest = 0.0
    if region.top == math.inf:
        far, bound = _farthest(box, far)
        if not bound:
            return taken, _contributions(box, _beyond(box, far)), largest
    for piece in region.edge(far):
        cells = _first(piece, box.poles, region.period)
        for _ in range(_HALVED):
            taken += len(cells)
            B, at_middle, share = _bounds(box, region.period, piece, cells, products)
            below, above = _roots(B)
            fails = (_roots(at_middle)[0] >= 1.0) & (below >= 1.0)
            if fails.any() or taken > _CELLS:
                worst = int(np.argmax(np.where(fails, below, 0.0) if fails.any() else below))
                return taken, _contributions(box, at_middle[worst] if fails.any() else B[worst]), largest
            open_ = above >= 1.0
            largest = max(largest, float(share[~open_].max(initial=0.0)))
            cells = cells[open_]
            if not len(cells):
                break
            middles = cells.mean(axis=1)
            cells = np.vstack([np.column_stack([cells[:, 0], middles]), np.column_stack([middles, cells[:, 1]])])
        else:
            return taken, _contributions(box, B[int(np.argmax(above))]), largest
    return taken, None, largest


def _first(piece: tuple[complex, complex], poles: Complex, period: float) -> Complex:
    """The first cells [k, 2] of a piece: ends at distances from each eigenvalue that grow with its own distance."""
    begin, end = piece
    rates = poles
    if period:
        lasting = np.where(np.abs(poles) > VANISHED, poles, VANISHED).astype(np.complex128)
        rates = np.asarray(np.log(lasting) / period, dtype=np.complex128)
    along = (end - begin) / abs(end - begin)
    offset = (rates - begin) * np.conj(along)
    widths = np.abs(offset.imag) + 1e-9 * abs(end - begin)
    places = [offset.real + sign * factor * widths for factor in _AROUND for sign in (-1.0, 1.0)]
    inner = np.concatenate(places) / abs(end - begin)
    ends = np.unique(np.concatenate([[0.0, 1.0], inner[(inner > 0.0) & (inner < 1.0)]]))
    points = begin + (end - begin) * ends
    return np.column_stack([points[:-1], points[1:]])


def _bounds(
    box: _Box, period: float, piece: tuple[complex, complex], cells: Complex, products: Complex
) -> tuple[Array, Array, Array]:
    """For each cell the matrix B [cell, change + 1, change + 1], that of its middle, and E over the distance."""
    ends = np.exp(cells * period) if period else cells
    middles = np.exp(cells.mean(axis=1) * period) if period else cells.mean(axis=1)
    radius = np.abs(ends - middles[:, None]).max(axis=1)[:, None]
    distance = np.abs(middles[:, None] - box.poles)
    nearest = np.maximum(distance - radius, _apart(box.poles, piece, period))
    resolvent = 1.0 / (middles[:, None] - box.poles)
    with np.errstate(divide="ignore", over="ignore", invalid="ignore"):
        rest = (radius / distance) ** _TAYLOR / nearest
        rest = np.where(np.isfinite(rest), rest, np.inf)
        closest = 1.0 / nearest
    exact = resolvent @ products
    total = np.abs(exact)
    term = resolvent
    for power in range(1, _TAYLOR):
        term = term * resolvent
        total = total + radius**power * np.abs(term @ products)
    total = total + np.minimum(rest, 1e200) @ np.abs(products)
    closest = np.minimum(closest, 1e150)
    return (
        _bordered(box, total, closest),
        _bordered(box, np.abs(exact), 1.0 / distance),
        box.rest * closest.max(axis=1),
    )


def _apart(poles: Complex, piece: tuple[complex, complex], period: float) -> Array:
    """A distance [n] that eigenvalues keep from a whole piece of the edge."""
    begin, end = piece
    upright = begin.real == end.real
    if period:
        apart = np.abs(np.abs(poles) - math.exp(begin.real * period)) * upright
    else:
        apart = np.abs(poles.real - begin.real) if upright else np.abs(poles.imag - begin.imag)
    return np.asarray(apart)


def _bordered(box: _Box, changes: Array, closest: Array) -> Array:
    """B of |R G L| [cell, change * change] and of bounds [cell, n] of |1 / (s - lambda)|."""
    k = len(box.right)
    B = np.empty((len(changes), k + 1, k + 1))
    B[:, :k, :k] = changes.reshape(len(changes), k, k)
    B[:, :k, k] = np.sqrt(closest**2 @ (np.abs(box.right) ** 2).T)
    B[:, k, :k] = box.rest * np.sqrt(closest**2 @ np.abs(box.left) ** 2)
    B[:, k, k] = box.rest * closest.max(axis=1)
    return B


def _beyond(box: _Box, far: float) -> Array:
    """B of all that lies beyond a distance [rad/s]: [change + 1, change + 1]."""
    closest = 1.0 / (far - np.abs(box.poles))[None]
    products = np.abs(box.right[:, None, :] * box.left.T[None, :, :]).reshape(-1, len(box.poles)).T
    return np.asarray(_bordered(box, closest @ products, closest)[0])


def _farthest(box: _Box, far: float) -> tuple[float, bool]:
    """A distance [rad/s] beyond which no rig has an eigenvalue; False if none is found."""
    for _ in range(_FARTHEST):
        if _roots(_beyond(box, far)[None])[1][0] < 1.0:
            return far, True
        far *= 4.0
    return far, False


def _roots(B: Array) -> tuple[Array, Array]:
    """Bounds of the Perron root of each matrix [cell, k, k], from below and above (Collatz and Wielandt)."""
    B = B + 1e-12 * B.max(axis=(1, 2), initial=0.0)[:, None, None] + 1e-300
    x = np.ones(B.shape[:2])
    for _ in range(_POWERS):
        y = np.matmul(B, x[:, :, None])[:, :, 0]
        ratio = y / x
        below = ratio.min(axis=1)
        above = ratio.max(axis=1)
        if np.all((above < 1.0) | (below >= 1.0)):
            break
        x = 0.5 * (x + y / y.max(axis=1)[:, None])
        x = np.maximum(x / x.max(axis=1)[:, None], 1e-200)
    return below, above


def _contributions(box: _Box, B: Array) -> Array:
    """How much each uncertain value contributes to the Perron root of B [change + 1, change + 1]."""
    values, vectors = np.linalg.eig(np.minimum(B, 1e100))
    right = np.abs(vectors[:, int(np.argmax(values.real))])
    values, vectors = np.linalg.eig(np.minimum(B, 1e100).T)
    left = np.abs(vectors[:, int(np.argmax(values.real))])
    return np.asarray((left * right)[:-1] @ box.of if len(box.of) else np.ones(box.of.shape[1]))
