"""Eigenvalues of a structure: modes of M and K, and complex eigenvalues of M l^2 + D l + K, full and dense.

Full matrices: inverse iteration about shifts with a sparse factorisation (SuperLU, ARPACK), with a fixed start vector.
Both kinds are complete within a stated range. Modes are counted: the signs of the pivots of K - w^2 M are the number of
modes below w. Complex eigenvalues are computed within circles that overlap; what lies in two circles must be found in
both.
"""

from __future__ import annotations

from collections.abc import Callable
from contextlib import suppress
from dataclasses import dataclass
from typing import Any, Literal

import numpy as np
import scipy.sparse as sp
from numpy.typing import NDArray
from scipy.linalg import eigh
from scipy.sparse.linalg import ArpackError, LinearOperator, SuperLU, eigs, eigsh, splu

from rig.errors import RigError
from rig.printable import counted
from rig.structure.full import Array, Matrix

Complex = NDArray[np.complex128]

RESIDUAL = 1e-9
"""Largest residual of a complex eigenpair, over the sum of the norms of its three terms [chosen]."""
GAP = 1e-3
"""Least relative distance between the last mode of a basis and the next one: pairs are never cut [chosen]."""
DAMPED = 0.5
"""Complex eigenvalues are computed up to this decay over frequency (damping ratio 0.45) [chosen]."""
LEAST = 1e-6
"""Frequencies below this share of the range count as zero: real eigenvalues [chosen]."""
_RIGID = 1e-12  # w^2 of a rigid mode over the largest of the mesh: what rounding leaves of zero
_SAME = 1e-6  # relative distance of one eigenvalue found from two shifts
_NUMBER = 16  # eigenvalues asked for at the first shift
_MOST = 120  # and at most
_MODES = 600  # up to a frequency, at most: eight tries with growing numbers find 639 at the most
_TRIES = 6  # circles in a row that may be incomplete before the search ends [chosen]


class Incomplete(RigError):
    """Eigenvalues that could not be computed completely within the range."""


@dataclass(frozen=True)
class Modes:
    """Modes in ascending order: `square` w^2 [mode], `shapes` [row, mode] of mass one; `rigid`: how many are w = 0."""

    square: Array
    shapes: Array
    rigid: int


@dataclass(frozen=True)
class Eigenpairs:
    """Complex eigenvalues [pair] in rad/s by frequency, vectors [row, pair] of length one, and residuals [pair].

    `left` [row, pair] fulfil left^H P(l) = 0; empty where they were not asked for.
    """

    values: Complex
    right: Complex
    left: Complex
    residual: Array


class _Gathered:
    """Eigenpairs of circles that overlap, each once."""

    def __init__(self) -> None:
        self.values: list[complex] = []
        self.right: list[Complex] = []
        self.left: list[Complex] = []
        self._circles: list[tuple[complex, float]] = []

    def add(self, values: Complex, right: Complex, left: Complex, shift: complex, radius: float) -> bool:
        """Add the pairs of a circle; whether it and the former ones agree about what lies in both."""
        old = [j for j, value in enumerate(self.values) if abs(value - shift) < radius]
        new = []
        for j, value in enumerate(values.tolist()):
            same = [i for i in old if abs(self.values[i] - value) < _SAME * abs(value)]
            if same:
                old.remove(min(same, key=lambda i: abs(self.values[i] - value)))
            else:
                new.append(j)
        deep_inside = (1 - _SAME) * radius
        if any(abs(self.values[i] - shift) < deep_inside for i in old):
            return False
        for value in values[new]:
            if any(abs(value - at) < (1 - _SAME) * size for at, size in self._circles):
                return False
        self._circles.append((shift, radius))
        for j in new:
            self.values.append(complex(values[j]))
            self.right.append(right[:, j])
            if left.size:
                self.left.append(left[:, j])
        return True


def factor(matrix: sp.csr_array) -> SuperLU:
    """The factorisation of a sparse matrix of symmetric pattern. Raises Incomplete for a singular matrix."""
    try:
        return splu(
            sp.csc_array(matrix), permc_spec="MMD_AT_PLUS_A", diag_pivot_thresh=0.0, options={"SymmetricMode": True}
        )
    except RuntimeError:
        raise Incomplete(
            "the matrices of the structure are singular at every frequency: a row has neither stiffness nor mass, or "
            "a body is held by nothing; look for such rows, or leave them out"
        ) from None


def signed(vectors: Array) -> Array:
    """Columns with the sign that makes the first of their largest components positive."""
    size = np.abs(vectors)
    first = np.argmax(size > (1 - 1e-6) * size.max(axis=0), axis=0)
    return np.asarray(vectors * np.where(np.take_along_axis(vectors, first[None], axis=0) < 0, -1.0, 1.0))


def largest_square(stiffness: sp.csr_array, mass: sp.csr_array) -> float:
    """The scale of the largest w^2 of the mesh."""
    diagonal = mass.diagonal()
    return float(np.max(np.abs(stiffness.diagonal())[diagonal > 0] / diagonal[diagonal > 0]))


def modes(stiffness: sp.csr_array, mass: sp.csr_array, count: int = 0, up_to: float = 0.0) -> Modes:
    """The lowest `count` modes, or all up to `up_to` [rad/s], and more until none of a group of equal ones is cut.

    Raises Incomplete where the count by pivots differs, for negative stiffness, and for a structure with too few rows.
    """
    rows = mass.shape[0]
    largest = largest_square(stiffness, mass)
    shift = max(1e-9 * largest, 1e-4 * up_to**2)
    inverse = factor(stiffness + shift * mass)
    operator = LinearOperator((rows, rows), matvec=inverse.solve, dtype=float)
    start = np.random.default_rng(0).standard_normal(rows)
    asked = (count or 2 * _NUMBER) + 6
    for attempt in range(8):
        asked = min(asked, rows - 1)
        if attempt == 1 and not count and rows > _MODES:
            _refuse_many(below_count(stiffness, mass, up_to**2), up_to)
        try:
            square, shapes = eigsh(stiffness, k=asked, M=mass, sigma=-shift, OPinv=operator, v0=start, tol=0)
        except ArpackError:
            break
        order = np.argsort(square)
        square = square[order]
        shapes = shapes[:, order]
        wanted = count or int(np.sum(square <= up_to**2))
        omega = np.sqrt(np.abs(square))
        gaps = np.flatnonzero(np.diff(omega) > GAP * omega[1:]) + 1
        at = gaps[gaps >= max(wanted, 1)]
        if square[0] < -shift:
            break
        if at.size and (count or square[-1] > up_to**2):
            kept = int(at[0])
            below = below_count(stiffness, mass, 0.5 * (square[kept - 1] + square[kept]))
            if below == kept:
                rigid = int(np.sum(square[:kept] <= _RIGID * largest))
                return Modes(square[:kept], signed(shapes[:, :kept]), rigid)
        elif asked == rows - 1:  # every mode is wanted
            with suppress(np.linalg.LinAlgError):  # rows without mass
                square, shapes = eigh(stiffness.toarray(), mass.toarray())
                return Modes(square, signed(shapes), int(np.sum(square <= _RIGID * largest)))
            break
        asked += max(asked // 2, 8)
    if negative := below_count(stiffness, mass, -shift):
        raise Incomplete(f"the stiffness is negative for {counted(negative, 'motion')}: check its sign and its units")
    raise Incomplete(
        f"the modes up to {count or f'{up_to / (2 * np.pi):g} Hz'} of {rows} rows could not be computed completely: "
        f"ask for fewer, or use reduction.kind = 'whole' below 300 rows"
    )


def _refuse_many(number: int, up_to: float) -> None:
    """Raise Incomplete if more modes than are computed lie below `up_to` [rad/s]."""
    if number > _MODES:
        raise Incomplete(
            f"{number} modes lie below {up_to / (2 * np.pi):g} Hz; at most {_MODES} are computed: lower "
            "reduction.modes_up_to, or state their number, reduction.modes"
        )


def below_count(stiffness: sp.csr_array, mass: sp.csr_array, square: float) -> int:
    """How many modes have w^2 below `square`: the number of negative pivots (Sylvester's law of inertia)."""
    return int(np.sum(factor(stiffness - square * mass).U.diagonal() < 0))


def complex_eigenvalues(
    mass: sp.csr_array,
    damping: sp.csr_array,
    stiffness: sp.csr_array,
    up_to: float,
    low: float = 0.0,
    left: bool = False,
    told: Callable[[float], object] = lambda share: None,
) -> Eigenpairs:
    """All l with M l^2 + D l + K singular, `low` < Im l <= `up_to` and abs(Re l) <= `DAMPED` Im l.

    `told` is called with the share of the range that is done. Raises Incomplete.
    """
    pencil = (mass, damping, stiffness)
    gathered = _Gathered()
    done = max(low, LEAST * up_to)
    step = 0.4 * (up_to - low)
    aside = 0.01 * up_to
    number = _NUMBER
    tries = 0
    while done < up_to:
        centre = min(done + 0.8 * step, 0.5 * (done + up_to))
        values, right, lefts, radius = _circle(pencil, complex(aside, centre), number, left)
        within = max(radius - aside, 0.0)  # of the circle about the imaginary axis that lies in it
        root = 5 * within**2 - centre**2  # where it cuts abs(Re) = Im / 2
        low_end, high_end = ((2 * centre + side * np.sqrt(max(root, 0.0))) / 2.5 for side in (-1, 1))
        covered = root > 0 and low_end <= done < high_end
        if covered and gathered.add(values, right, lefts, complex(aside, centre), radius):
            done = high_end
            step = high_end - centre
            tries = 0
            told(min(done / up_to, 1.0))
            continue
        tries += 1
        number = min(int(1.5 * number), _MOST)
        step *= 0.7
        if tries > _TRIES:
            raise Incomplete(
                f"complex eigenvalues near {centre / (2 * np.pi):.6g} Hz could not be computed completely: "
                f"{number} lie within {radius / (2 * np.pi):.3g} Hz; ask for a narrower range"
            )
    order = np.argsort([value.imag for value in gathered.values])
    values = np.array(gathered.values, dtype=complex)[order]
    kept = (values.imag > max(low, LEAST * up_to)) & (values.imag <= up_to)
    kept &= np.abs(values.real) <= DAMPED * values.imag
    order = order[kept]
    values = values[kept]
    right = _columns(gathered.right, order, mass.shape[0])
    lefts = _columns(gathered.left, order if left else order[:0], mass.shape[0])
    residual = residuals(pencil, values, right)
    if residual.size and residual.max() > RESIDUAL:
        raise Incomplete(
            f"the residual of a complex eigenvalue is {residual.max():.1e}, at most {RESIDUAL:g} is allowed: "
            f"the matrices differ too much in size; check their units"
        )
    return Eigenpairs(values, right, lefts, residual)


def residuals(pencil: tuple[Matrix, Matrix, Matrix], values: Complex, vectors: Complex) -> Array:
    """The norm of P(l) x over the sum of the norms of its terms [pair]."""
    terms = [matrix @ vectors for matrix in pencil]
    terms = [terms[0] * values**2, terms[1] * values, terms[2]]
    scale = sum(np.linalg.norm(term, axis=0) for term in terms)
    return np.asarray(np.linalg.norm(sum(terms), axis=0) / scale)


def _columns(vectors: list[Complex], order: NDArray[np.int64], rows: int) -> Complex:
    """The vectors of these numbers as columns [row, number]."""
    return np.array([vectors[j] for j in order.tolist()], dtype=complex).reshape(-1, rows).T


def _circle(
    pencil: tuple[sp.csr_array, sp.csr_array, sp.csr_array], shift: complex, number: int, left: bool
) -> tuple[Complex, Complex, Complex, float]:
    """The eigenpairs nearest to `shift`, and the radius of the circle about it that contains no others."""
    mass, damping, stiffness = pencil
    inverse = factor(shift * shift * mass + shift * damping + stiffness)
    values, right = _nearest(mass, damping, inverse.solve, shift, number)
    lefts = np.zeros((0, 0), dtype=complex)
    radius = float(np.max(np.abs(values - shift))) if 2 * mass.shape[0] > number + 2 else np.inf
    if left:
        others, vectors = _nearest(mass.T, damping.T, lambda b: inverse.solve(b, trans="T"), shift, number)
        radius = min(radius, float(np.max(np.abs(others - shift))))
        pairs = _paired(values, others)
        lefts = vectors[:, pairs].conj()
    inside = np.abs(values - shift) < (1 - _SAME) * radius
    return values[inside], right[:, inside], lefts[:, inside] if left else lefts, (1 - _SAME) * radius


def _paired(values: Complex, others: Complex) -> list[int]:
    """For each of `values` the nearest of `others`, each once."""
    left = list(range(others.size))
    pairs = []
    for value in values.tolist():
        pairs.append(min(left, key=lambda j: abs(others[j] - value)))
        left.remove(pairs[-1])
    return pairs


def _nearest(
    mass: sp.csr_array, damping: sp.csr_array, solve: Callable[[Any], Any], shift: complex, number: int
) -> tuple[Complex, Complex]:
    """Eigenvalues nearest to `shift` and right vectors, by ARPACK on the companion form."""
    rows = mass.shape[0]
    scale = abs(shift)  # of velocities

    def apply(state: Complex) -> Complex:
        position = state[:rows]
        velocity = scale * state[rows:]
        moved = solve(-(mass @ (velocity + shift * position)) - damping @ position)
        return np.concatenate([moved, (position + shift * moved) / scale])

    operator = LinearOperator((2 * rows, 2 * rows), matvec=apply, dtype=complex)
    start = np.random.default_rng(0).standard_normal(2 * rows).astype(complex)
    number = min(number, 2 * rows - 2)
    try:
        inverses, states = eigs(operator, k=number, v0=start, tol=1e-12, maxiter=300)
    except ArpackError as fault:
        raise Incomplete(
            f"complex eigenvalues near {shift.imag / (2 * np.pi):.6g} Hz did not converge ({fault}); "
            f"check the units and the size of the damping"
        ) from None
    values = shift + 1.0 / inverses
    vectors = states[:rows] / np.linalg.norm(states[:rows], axis=0)
    return values, vectors


def dense(
    mass: Array, damping: Array, stiffness: Array, vectors: Literal["none", "right", "both"] = "right"
) -> tuple[Complex, Complex, Complex]:
    """All eigenvalues l of dense M l^2 + D l + K [2 n], right and left vectors [n, 2 n]; empty those not wanted.

    The companion form counts time in periods of a frequency of the matrices, so that its halves are of one size, and
    has the coordinates in reverse: the QR iteration takes 1 to 8 % less time where high frequencies come first.
    """
    rows = mass.shape[0]
    if not np.array_equal(mass, np.eye(rows)):
        damping, stiffness = np.hsplit(np.linalg.solve(mass, np.hstack([damping, stiffness])), 2)
    scale = float(np.sqrt(np.linalg.norm(stiffness)) or 1.0)
    companion = np.zeros((2 * rows, 2 * rows))
    companion[:rows, rows:] = np.eye(rows)
    companion[rows:, :rows] = stiffness[::-1, ::-1] / -(scale**2)
    companion[rows:, rows:] = damping[::-1, ::-1] / -scale
    none = np.zeros((rows, 0), dtype=complex)
    if vectors == "none":
        return (scale * np.linalg.eigvals(companion)).astype(complex), none, none
    if vectors == "right":
        values, states = np.linalg.eig(companion)
        return (scale * values).astype(complex), states[rows - 1 :: -1].astype(complex), none
    import scipy.linalg  # only for reports

    values, lefts, states = scipy.linalg.eig(companion, left=True, right=True)
    lefts = lefts[: rows - 1 : -1]  # of M^-1 P: the second half; of P itself after M^-T
    if not np.array_equal(mass, np.eye(rows)):
        lefts = np.linalg.solve(mass.T, lefts)
    return scale * values, states[rows - 1 :: -1], lefts
