"""Whether no rig of a box grows: its parts are proved, refuted by a rig, or halved.

The matrix of a rig is a polynomial of the uncertain values, in products of Chebyshev polynomials. Over a part of the
box it is expanded anew: A0 + L diag(d) R + E. Each d, a term of first or second order, lies between -1 and 1; E, all
that is left, is no larger than the sum of its terms. No such matrix has the eigenvalue s if

    B(s) = [ |R G L|   |R G| ]        G = (s - A0)^-1, in the coordinates of the eigenvectors of A0
           [ e |G L|   e |G| ]        e: size of E

has a Perron root below 1. If this holds all along the edge of the region that eigenvalues must not enter, and the rig
in the middle has none inside, no rig of the part has. Else it is halved along the value that contributes most to the
root, and the halves are examined.

    continuous in time   the edge is Re s = limit within the band, Re s = max(limit, 0) outside of it
    sampled loop         the same for z = exp(s T): circles

The edge is covered by cells, not by single frequencies: 1/(s - lambda) within a cell is a Taylor polynomial about its
middle and a rest that is bounded. A cell that is too large for the proof is halved.

What it rests on: rounding, and that the matrix is the polynomial, which is compared at points that the fit does not
know.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Callable
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from rig.analysis.linear.control_loop import VANISHED
from rig.analysis.robust.growth import Matrix
from rig.errors import RigError

Array = NDArray[np.float64]
Complex = NDArray[np.complex128]
Arrays = dict[str, NDArray[Any]]
_SMOOTH = 1e-7  # error of the polynomial, of the largest entry: with a larger one the matrix is none
_TERMS = 500  # of the polynomial
_DEGREE = 15  # highest power of a value
_FALLS = 1e-3  # size of a term over that of the next lower power, at least: values may act together only
_POINTS = 3  # for each term
_LITTLE = 1e-13  # of the largest entry: terms of the polynomial that are left out
_MOST = 2e8  # numbers of the matrices through which it is fitted: 1.6 GB
_CHECKS = 24  # rigs at which the polynomial is compared
_RANK = 1e-9  # of the largest singular value of a change: the rest of it goes into E
_DEFECTIVE = 1e9  # condition of eigenvectors: beyond, A0 is moved
_MOVED = 1e-10  # of its largest entry
_TOUCHES = 1e-60  # rad/s: least distance from an eigenvalue
_TAYLOR = 3  # terms of a cell
_AROUND = (0.0, 1.0, 3.0, 10.0)  # distances of an eigenvalue from the edge: ends of the first cells
_CELLS = 20_000  # of a part, at most
_HALVED = 40  # times a cell, at most
_POWERS = 12  # on the way to a Perron vector
_BEYOND = 1.001  # times a bound of all eigenvalues: there the edge ends
_NEUTRAL = 1e-9  # of the largest eigenvalue: a mode without growth outside of the band grows less


class NoProof(RigError):
    """Rigs that cannot be examined, for the reason in words."""


class Region(NamedTuple):
    """Where eigenvalues must not be: `limit` [1/s] within `band` [rad/s], `outer` outside of it, up to `top` [rad/s].

    `period` [s]: of a sampled loop, else 0.
    """

    limit: float
    outer: float
    band: tuple[float, float]
    top: float
    period: float

    @classmethod
    def of(cls, rig: Matrix, limit: float, band: tuple[float, float]) -> Region:
        """Return the region for rigs like this one: none may grow by more than `limit` in a `band` [Hz]."""
        period = rig.period
        size = 1.0 / period if period else float(np.abs(rig.values).max(initial=0.0))
        outer = max(limit, 0.0) + _NEUTRAL * size
        within = outer if limit >= 0.0 else limit  # one line then, which a mode without growth does not touch
        top = min(2.0 * math.pi * rig.up_to, math.pi / period if period else math.inf)
        return cls(within, outer, (2.0 * math.pi * band[0], 2.0 * math.pi * band[1]), top, period)

    def holds(self, values: Complex) -> bool:
        """Whether one of the eigenvalues is in it."""
        rates = self.rates(values)
        tone = np.abs(rates.imag)
        inside = (tone >= self.band[0]) & (tone <= self.band[1])
        return bool(np.any((rates.real > np.where(inside, self.limit, self.outer)) & (tone <= self.top)))

    def rates(self, values: Complex) -> Complex:
        """The rates [1/s] of eigenvalues; those that vanish within a period have a large decay."""
        if not self.period:
            return values
        lasting = np.where(np.abs(values) > VANISHED, values, VANISHED)
        return np.asarray(np.log(lasting.astype(np.complex128)) / self.period)

    def points(self, rates: Complex) -> Complex:
        """The places of rates [1/s] among the eigenvalues."""
        return np.exp(rates * self.period) if self.period else rates

    def edge(self, far: float) -> list[tuple[complex, complex]]:
        """Its edge in the upper half plane as straight pieces, in rates, up to `far` [rad/s]."""
        end = min(far, self.top)
        low, high = (min(edge, end) for edge in self.band)
        outer, limit = self.outer, self.limit
        corners = [complex(outer, 0.0), complex(outer, low), complex(limit, low)]
        corners += [complex(limit, high), complex(outer, high), complex(outer, end)]
        if end < far and not self.period:
            corners.append(complex(far, end))
        return [(begin, end) for begin, end in itertools.pairwise(corners) if begin != end]


class Polynomial:
    """The matrix [n, n] of rigs u [k, count] as a polynomial, scaled so that rows and columns are alike in size.

    `error`: the largest one in an entry, at rigs that the fit does not know, over the largest entry `size`. Raises
    NoProof for matrices that are too large, and for those that are no polynomial.
    """

    def __init__(self, matrix: Callable[[Array], Array], count: int) -> None:
        from scipy.linalg import matrix_balance

        middle = matrix(np.full(count, 0.5))
        self.n = len(middle)
        _, (scales, _) = matrix_balance(middle, permute=False, separate=True)
        self._matrix = matrix
        self._scale = scales[None, :] / scales[:, None]
        chance = np.random.default_rng(1)
        powers = _powers([self._sizes(i, count) for i in range(count)])
        if _POINTS * len(powers) * self.n**2 > _MOST:
            raise NoProof(
                f"its matrix has {self.n} rows, each frame of a delay one, and {len(powers)} terms: too many; state a "
                "shorter delay or fewer uncertain values"
            )
        # most points near the ends of each value: there a polynomial through points that are evenly spread fails
        points = 0.5 - 0.5 * np.cos(math.pi * chance.random((_POINTS * len(powers), count)))
        held = self._true(points)
        self.size = max(float(np.abs(held).max(initial=0.0)), 1e-300)
        coefficients = np.linalg.lstsq(products(2.0 * points - 1.0, powers), held, rcond=None)[0]
        large = powers[np.abs(coefficients).max(axis=1) > _LITTLE * self.size]
        kept = np.array([bool((power <= large).all(axis=1).any()) for power in powers])
        self.powers = powers[kept]
        """Powers [term, count]: with a term, all of lower powers."""
        self.coefficients = coefficients[kept]
        checked = chance.random((_CHECKS, count))
        missed = np.array([self(u).ravel() for u in checked]) - self._true(checked)
        self.error = float(np.abs(missed).max()) / self.size
        if self.error > _SMOOTH:
            error = f"error of the polynomial: {self.error:.1e}"
            raise NoProof(f"the matrix of a rig is no smooth function of the uncertain values ({error})")

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

    @property
    def bound(self) -> float:
        """A bound of the sizes of all eigenvalues of all rigs."""
        largest = np.abs(self.coefficients).sum(axis=0).reshape(self.n, self.n) + self.error * self.size
        return float(np.abs(np.linalg.eigvals(largest)).max(initial=0.0))

    def __call__(self, u: Array) -> Array:
        """Return the matrix [n, n] of a rig u [count]."""
        rows = products(2.0 * u[None] - 1.0, self.powers) @ self.coefficients
        return np.asarray(rows, dtype=np.float64).reshape(self.n, self.n)

    def within(self, low: Array, high: Array) -> Array:
        """The coefficients [term, n, n] over a part of the box, whose ends are -1 and 1."""
        nodes = np.cos(math.pi * (np.arange(self.degree + 1) + 0.5) / (self.degree + 1))
        change = np.ones((len(self.powers), len(self.powers)))
        for i, powers in enumerate(self.powers.T):
            along = low[i] + high[i] - 1.0 + (high[i] - low[i]) * nodes
            old = np.polynomial.chebyshev.chebvander(along, self.degree)
            new = np.linalg.solve(np.polynomial.chebyshev.chebvander(nodes, self.degree), old)  # [new, old power]
            change *= new[powers[:, None], powers[None, :]]
        return np.asarray(change @ self.coefficients, dtype=np.float64).reshape(-1, self.n, self.n)


def _powers(sizes: list[Array]) -> NDArray[np.int64]:
    """The powers [term, value] of a polynomial: a term of several values is as small as the product of theirs."""
    terms: list[tuple[tuple[int, ...], float]] = [((), 1.0)]
    for falling in sizes:
        own = np.maximum(falling, _FALLS ** np.arange(len(falling)))
        own[0] = 1.0
        terms = [((*p, k), size * own[k]) for p, size in terms for k in range(len(own)) if size * own[k] > _LITTLE]
        terms = sorted(terms, key=lambda term: -term[1])[:_TERMS]
    return np.array([p for p, _ in terms], dtype=np.int64).reshape(len(terms), len(sizes))


def products(points: Array, powers: NDArray[np.int64]) -> Array:
    """Return products [point, term] of Chebyshev polynomials at points [point, value] between -1 and 1."""
    each = np.polynomial.chebyshev.chebvander(points, int(powers.max(initial=0)))  # [point, value, power]
    terms = np.ones((len(points), len(powers)))
    for value in range(points.shape[1]):
        terms *= each[:, value, powers[:, value]]
    return terms


class _Part(NamedTuple):
    """A part of the box in the coordinates of the eigenvectors of its A0.

    `poles` [n]: eigenvalues of A0; `left` [n, change], `right` [change, n]; `of` [change + 1, count]: which uncertain
    values a change, and at last E, belong to; `rest`: the size of E.
    """

    poles: Complex
    left: Complex
    right: Complex
    of: Array
    rest: float


class Examination:
    """A box of rigs whose parts are examined: no rig may grow by more than `limit` [1/s] in a `band` [Hz], or at all
    outside of it.

    `rigs`: the matrix of a rig u [count] in the unit cube. Raises NoProof.
    """

    def __init__(
        self,
        rigs: Callable[[Array], Matrix],
        count: int,
        limit: float = 0.0,
        band: tuple[float, float] = (0.0, math.inf),
    ) -> None:
        self._rigs = rigs
        self._polynomial = Polynomial(self._matrix, count)
        middle = np.full(count, 0.5)
        like = rigs(middle)._replace(A=self._polynomial(middle))
        self._region = Region.of(like, limit, band)
        self._edge = self._region.edge(math.inf if like.period else _BEYOND * self._polynomial.bound)

    def _matrix(self, u: Array) -> Array:
        rig = self._rigs(u)
        if rig.why:
            raise NoProof(f"a rig of the box has no growth: {rig.why}")
        return rig.A

    def examined(self, low: Array, high: Array) -> Arrays:
        """Examine the part of the box between two corners [count].

        Returns the `degree` of the polynomial and its `error`, the number of `cells`; the `rig` [0 or 1, count] in its
        middle, if that refutes it; the `halves` [0 or 2, 2, count] of a part that is not proved; and `rest`, the
        largest E of one that is, over the distance of an eigenvalue from the edge.
        """
        ends = np.array([low, high])
        middle = ends.mean(axis=0)
        grows = self._region.holds(Matrix(self._polynomial(middle)).values)
        grows = grows and self._region.holds(self._rigs(middle).values)
        cells, weights, rest = (0, None, 0.0) if grows else self._along_edge(low, high)
        halves = np.repeat(ends[None], 0 if weights is None else 2, axis=0)
        if weights is not None:
            i = int(np.argmax(weights))
            halves[0, 1, i] = halves[1, 0, i] = middle[i]
            rest = 0.0
        polynomial = self._polynomial
        numbers = {"cells": cells, "rest": rest, "degree": polynomial.degree, "error": polynomial.error}
        found = {name: np.array(number) for name, number in numbers.items()}
        return {"rig": middle[None][: int(grows)], "halves": halves, **found}

    def _part(self, low: Array, high: Array) -> _Part:
        of_rigs = self._polynomial
        own = of_rigs.within(low, high)
        order = of_rigs.powers.sum(axis=1)
        owners = np.array(of_rigs.powers > 0, dtype=np.float64)
        error = of_rigs.error * of_rigs.size
        small = (order == 1) | (order == 2)
        L, R, kept, of = _factors(own[small], owners[small], error * of_rigs.n)
        middle = own[order == 0][0]
        poles, V, back = _diagonalised(middle)
        others = np.abs(own[order > 2])
        missed = others.sum(axis=0) + np.abs(own[small] - kept).sum(axis=0) + error
        rest = float(np.linalg.norm(np.abs(back) @ missed @ np.abs(V)))
        rest += float(np.linalg.norm(back @ (middle @ V - V * poles)))
        of_rest = others.max(axis=(1, 2), initial=0.0) @ owners[order > 2]
        of_rest /= max(float(of_rest.max(initial=0.0)), 1e-300)
        return _Part(poles.astype(np.complex128), back @ L, R @ V, np.vstack([of, of_rest]), rest)

    def _along_edge(self, low: Array, high: Array) -> tuple[int, Array | None, float]:
        """Examine the edge of a part: number of cells; None if it is proved, else how much each value contributes; the
        largest size of E over the distance of an eigenvalue.
        """
        part = self._part(low, high)
        if self._region.holds(part.poles):
            return 0, part.of.sum(axis=0), 0.0
        pairs = (part.right[:, None, :] * part.left.T[None, :, :]).reshape(-1, len(part.poles)).T
        taken = 0
        largest = 0.0
        for piece in self._edge:
            cells = _first(piece, self._region.rates(part.poles))
            halved = 0
            while len(cells):
                taken += len(cells)
                B, at_middle, share = _bounds(part, self._region, cells, pairs)
                below, above = perron_bounds(B)
                fails = np.where(perron_bounds(at_middle)[0] >= 1.0, below, 0.0) if below.max() >= 1.0 else below
                if fails.max() >= 1.0:
                    return taken, _contributions(part, at_middle[np.argmax(fails)]), largest
                open_ = ~(above < 1.0)
                largest = max(largest, float(share[~open_].max(initial=0.0)))
                halved += 1
                if open_.any() and (taken > _CELLS or halved == _HALVED):
                    return taken, _contributions(part, B[np.argmax(above)]), largest
                begin, end = cells[open_].T
                middle = 0.5 * (begin + end)
                cells = np.vstack([np.column_stack([begin, middle]), np.column_stack([middle, end])])
        return taken, None, largest


def _diagonalised(A: Array) -> tuple[Complex, Complex, Complex]:
    """Eigenvalues, eigenvectors V and V^-1 of A, or of a matrix close to it, if A has too few eigenvectors.

    What this changes goes into E.
    """
    poles, V = np.linalg.eig(A)
    if np.linalg.cond(V) > _DEFECTIVE:
        moved = np.random.default_rng(len(A)).random(A.shape) - 0.5
        poles, V = np.linalg.eig(A + _MOVED * float(np.abs(A).max()) * moved)
    return poles, V, np.linalg.inv(V)


def _factors(changes: Array, owners: Array, smallest: float) -> tuple[Array, Array, Array, Array]:
    """Changes [k, n, n] as products of columns [n, rank] and rows [rank, n]; the changes that these are, without what
    is smaller than `smallest`; and the values [rank, count] that each belongs to, of those of `changes`.
    """
    n = changes.shape[1]
    U, sizes, V = np.linalg.svd(changes)
    least = max(_RANK * float(np.abs(changes).max(initial=0.0)), smallest)
    taken = sizes > np.maximum(least, _RANK * sizes.max(axis=1, initial=0.0, keepdims=True))
    roots = np.sqrt(np.where(taken, sizes, 0.0))
    columns = U * roots[:, None, :]
    rows = V * roots[:, :, None]
    of = np.repeat(owners, taken.sum(axis=1), axis=0)
    return np.swapaxes(columns, 1, 2)[taken].T.reshape(n, -1), rows[taken].reshape(-1, n), columns @ rows, of


def _first(piece: tuple[complex, complex], rates: Complex) -> Complex:
    """The first cells [k, 2] of a piece: ends at distances from each eigenvalue that grow with its own distance."""
    begin, end = piece
    length = abs(end - begin)
    offset = (rates - begin) * np.conj((end - begin) / length)
    widths = np.abs(offset.imag) + 1e-9 * length
    inner = np.concatenate([offset.real + factor * widths for factor in (*_AROUND, *(-each for each in _AROUND))])
    ends = np.unique(np.concatenate([[0.0, length], inner[(inner > 0.0) & (inner < length)]]))
    points = begin + (end - begin) * (ends / length)
    return np.column_stack([points[:-1], points[1:]])


def _bounds(part: _Part, region: Region, cells: Complex, pairs: Complex) -> tuple[Array, Array, Array]:
    """For each cell the matrix B [cell, change + 1, change + 1], that of its middle, and E over the distance."""
    middles = region.points(cells.mean(axis=1))[:, None]
    radius = np.abs(region.points(cells) - middles).max(axis=1)[:, None]
    apart = middles - part.poles
    apart = np.where(np.abs(apart) > _TOUCHES, apart, _TOUCHES)
    distance = np.abs(apart)
    resolvent = 1.0 / apart
    closest = 1.0 / np.maximum(distance - radius, _TOUCHES)
    exact = np.abs(resolvent @ pairs)
    total = exact + np.minimum(radius / distance, 1.0) ** _TAYLOR * closest @ np.abs(pairs)
    term = resolvent
    for power in range(1, _TAYLOR):
        term = term * resolvent
        total = total + radius**power * np.abs(term @ pairs)
    at_middle = _bordered(part, exact, 1.0 / distance)
    return _bordered(part, total, closest), at_middle, part.rest * closest.max(axis=1)


def _bordered(part: _Part, changes: Array, closest: Array) -> Array:
    """B of |R G L| [cell, change * change] and of bounds [cell, n] of |1 / (s - lambda)|."""
    k = len(part.right)
    B = np.empty((len(changes), k + 1, k + 1))
    B[:, :k, :k] = changes.reshape(len(changes), k, k)
    B[:, :k, k] = np.sqrt(closest**2 @ (np.abs(part.right) ** 2).T)
    B[:, k, :k] = part.rest * np.sqrt(closest**2 @ np.abs(part.left) ** 2)
    B[:, k, k] = part.rest * closest.max(axis=1)
    return B


def perron_bounds(B: Array) -> tuple[Array, Array]:
    """Bounds of the Perron root of each matrix [cell, k, k], from below and above (Collatz and Wielandt).

    Every positive vector gives such bounds; those of powers of 1 + B, each the fourth of the one before, come close.
    """
    B = B + 1e-12 * B.max(axis=(1, 2), initial=0.0)[:, None, None] + 1e-300
    x = np.ones(B.shape[:2])
    power = np.eye(B.shape[1]) + B / B.sum(axis=2).max(axis=1)[:, None, None]
    for _ in range(_POWERS):
        ratio = np.matmul(B, x[:, :, None])[:, :, 0] / x
        below = ratio.min(axis=1)
        above = ratio.max(axis=1)
        if np.all((above < 1.0) | (below >= 1.0)):
            break
        x = power.sum(axis=2)
        x = np.maximum(x / x.max(axis=1)[:, None], 1e-200)
        power = np.linalg.matrix_power(power, 4)
        power /= power.max(axis=(1, 2))[:, None, None]
    return below, above


def _contributions(part: _Part, B: Array) -> Array:
    """How much each uncertain value contributes to the Perron root of B [change + 1, change + 1]."""
    from scipy.linalg import eig

    values, left, right = eig(np.minimum(B, 1e100), left=True)
    i = int(np.argmax(values.real))
    return np.asarray(np.abs(left[:, i] * right[:, i]) @ part.of)
