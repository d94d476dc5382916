"""The error of the eigenvalues of a reduced structure, estimated with its full matrices.

    dl = - y''^H P(l) x / (y''^H P'(l) x),      y' = y - P(s)^-H P(l)^H y, and y'' so from y'     P(l) = M l^2 + D l + K

x and y: right and left eigenvector of the reduced structure on its nodes; s: the nearest of a few shifts, whose
factorisations serve many eigenvalues and points. Without the corrections of y the estimate is zero: the residual is
orthogonal to the basis (Galerkin). The norm of the residual says little: it is 10 to 100,000 times too large.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import scipy.sparse as sp
from numpy.typing import NDArray
from scipy.linalg import eig
from scipy.sparse.linalg import SuperLU

from rig.structure import eigenvalues
from rig.structure.eigenvalues import DAMPED, LEAST, Complex
from rig.structure.full import Array, Full
from rig.structure.reduced import Reduced

SHIFTS = 4
"""Factorisations over the frequency range [chosen]."""
ALIKE = (0.02, 0.07)
"""Relative change of frequency and of growth that more contact points may make, without a warning [chosen]."""
_STIFFER = 10.0  # contacts a hundred times as stiff as those that were factorised: 0.35 times the true error
_LARGE = 30_000  # rows: a factorisation of more is not kept
_ROUNDING = 1e-12  # of the largest entry
_CALM = 1e-5  # growth over size of an eigenvalue that may be rounding of the data
_CORRECTED = 2  # once: 0.25 to 2.0 times the true error; twice: 0.7 to 1.2 times


@dataclass(frozen=True)
class Estimates:
    """Eigenvalues of a reduced structure within its range [pair] by frequency, and their estimated errors.

    `values` and `errors` in rad/s, complex: `values` + `errors` is nearer to the full matrices. `relative` [pair]: the
    size of the error over that of the eigenvalue. `shapes` [coordinate, pair].
    """

    values: Complex
    errors: Complex
    shapes: Complex

    @property
    def relative(self) -> Array:
        """Size of the errors over that of the eigenvalues [pair]."""
        return np.asarray(np.abs(self.errors) / np.abs(self.values))


def in_range(values: Complex, up_to: float) -> NDArray[np.int64]:
    """Indices by frequency of the eigenvalues that `complex_eigenvalues` would give up to `up_to` [rad/s]."""
    within = (values.imag > LEAST * up_to) & (values.imag <= up_to)
    chosen = np.flatnonzero(within & (np.abs(values.real) <= DAMPED * values.imag))
    return chosen[np.argsort(values[chosen].imag, kind="stable")]


class _Operator:
    """P(l) of the full structure with what a rig adds to its matrices, over its rows and the states of a network.

        [ P(l) + a^T (c_q + l c_v) b + W (r_q + l r_v) W^T     -F    ]
        [ -(G_q + l G_v)                                      l - E  ]

    a, b: `Full.forces`. `jacobian` [state, state] of the reduced rig: displacements, velocities, network; what it adds
    there decides all of these. W = M V carries modal damping [n, n] and what no force of a and b explains.
    """

    def __init__(
        self,
        full: Full,
        reduced: Reduced,
        values: Mapping[str, float],
        jacobian: Array | None,
        damping: Array | None,
    ) -> None:
        n = reduced.coordinates
        mass, own, stiffness = reduced.pencil(values)
        self.mass, self.own, self.stiffness = self.pencil = full.pencil(values)
        self._rests = [np.zeros((n, n)), np.zeros((n, n)) if damping is None else damping]
        network = np.zeros((0, 0)) if jacobian is None else jacobian[2 * n :, 2 * n :]
        self.network = network
        self._force = np.zeros((full.rows, len(network)))
        self._from = [np.zeros((len(network), full.rows))] * 2
        if jacobian is not None:
            a, b = reduced.model.forces
            on_a, on_b = full.forces
            rows = -mass @ jacobian[n : 2 * n]
            overlap = (a @ a.T) * (b @ b.T)
            size = np.sqrt(overlap.diagonal()) + np.finfo(float).tiny
            scaled = overlap / np.outer(size, size)
            inverse = np.linalg.pinv(scaled, rcond=_ROUNDING, hermitian=True)
            for k, known in enumerate((stiffness, own + self._rests[1])):
                added = rows[:, k * n : (k + 1) * n] - known
                added[np.abs(added) <= _ROUNDING * np.abs(known).max()] = 0.0
                along_forces = ((a @ added) * b).sum(axis=1)
                c = inverse @ (along_forces / size) / size
                self._rests[k] = self._rests[k] + added - (a.T * c) @ b
                if c.any():
                    lifted = on_a.T @ sp.diags_array(c) @ on_b
                    self.own = self.own + k * lifted
                    self.stiffness = self.stiffness + (1 - k) * lifted
            if len(network):
                self._force = on_b.T @ np.linalg.lstsq(b.T, -rows[:, 2 * n :])[0]
                parts = jacobian[2 * n :, :n], jacobian[2 * n :, n : 2 * n]
                self._from = [(on_b.T @ np.linalg.lstsq(b.T, part.T)[0]).T for part in parts]
        self._weighed = None
        if any(rest.any() for rest in self._rests):
            self._weighed = self.mass @ reduced.basis.astype(float)

    def _rest(self, which: int, vectors: Complex, adjoint: bool) -> Complex | float:
        if self._weighed is None:
            return 0.0
        rest = self._rests[which].T if adjoint else self._rests[which]
        return np.asarray(self._weighed @ (rest @ (self._weighed.T @ vectors)))

    def times(self, rates: Complex, right: Complex, states: Complex, slope: bool = False) -> tuple[Complex, Complex]:
        """P(l), or its derivative, times columns over the rows and over the network."""
        damped = self.own @ right + self._rest(1, right, False)
        if slope:
            return 2 * rates * (self.mass @ right) + damped, states - self._from[1] @ right
        moved: Any = rates**2 * (self.mass @ right) + rates * damped + self.stiffness @ right
        moved = moved + self._rest(0, right, False) - self._force @ states
        currents = rates * states - self.network @ states - self._from[0] @ right - rates * (self._from[1] @ right)
        return moved, currents

    def adjoint(self, rates: Complex, left: Complex, states: Complex) -> tuple[Complex, Complex]:
        """P(l)^H times columns."""
        conj = rates.conj()
        moved = conj * (self.own.T @ left + self._rest(1, left, True)) + conj**2 * (self.mass.T @ left)
        moved += self.stiffness.T @ left + self._rest(0, left, True) - self._from[0].T @ states
        moved -= conj * (self._from[1].T @ states)
        return moved, conj * states - self.network.T @ states - self._force.T @ left

    def solved(self, inverse: SuperLU, shift: complex, left: Complex, states: Complex) -> tuple[Complex, Complex]:
        """P(s)^-H times columns; `inverse`: of its first block."""
        direct: Any = inverse.solve(left, trans="H")
        if not len(self.network):
            return direct, states
        to_network = (self._from[0] + shift * self._from[1]).conj().T
        through = inverse.solve(to_network.astype(complex), trans="H")
        of_network = (shift * np.eye(len(self.network)) - self.network).conj().T
        small = of_network - self._force.T @ through
        current: Any = np.linalg.solve(small, states + self._force.T @ direct)
        return direct + through @ current, current


class Estimator:
    """Estimates for one structure and any basis, at any point, with factorisations made at the point `at`.

    They are kept for the next point, except those of large structures, which take gigabytes. Points at which a contact
    or what a rig adds is much stiffer need others.
    """

    def __init__(self, full: Full, up_to: float, at: Mapping[str, float]) -> None:
        """`up_to` [rad/s]: the highest frequency; `at`: the numbers of the scene at which to factorise."""
        self._full = full
        self._pencil = full.pencil(at)
        self._shifts = 1j * up_to * (np.arange(SHIFTS) + 0.5) / SHIFTS
        self._kept: dict[int, SuperLU] = {}

    def at(
        self,
        reduced: Reduced,
        values: Mapping[str, float],
        damping: Array | None = None,
        jacobian: Array | None = None,
    ) -> Estimates:
        """Estimates for the eigenvalues of `reduced` up to its `up_to`, for these `values` by key.

        `damping` [n, n] as in `Reduced.eigenvalues`. `jacobian` [state, state]: eigenvalues of a rig that has more than
        these matrices: friction that depends on speed, a stack with its network; displacements and velocities first.
        """
        n = reduced.coordinates
        basis = reduced.basis.astype(float)
        if jacobian is None:
            rates, rights, lefts = reduced.eigenvalues(values, damping, "both")
            states = left_states = np.zeros((0, rates.size), dtype=complex)
        else:
            if not jacobian[n : 2 * n, 2 * n :].any():
                jacobian = jacobian[: 2 * n, : 2 * n]  # a network that does not act on the structure
            rates, lefts, rights = eig(jacobian, left=True, right=True)
            states = rights[2 * n :]
            left_states = lefts[2 * n :]
            rights = rights[:n]
            lefts = np.linalg.solve(reduced.pencil(values)[0].T, lefts[n : 2 * n])
        kept = in_range(rates, reduced.up_to)
        rates = rates[kept]
        rights = rights[:, kept]
        lefts = lefts[:, kept]
        states = states[:, kept]
        left_states = left_states[:, kept]
        operator = _Operator(self._full, reduced, values, jacobian, damping)
        stiffer = operator.stiffness.diagonal() > _STIFFER * abs(self._pencil[2].diagonal())
        if stiffer.any():
            self._pencil = (operator.mass, operator.own, operator.stiffness)
            self._kept = {}
        right = basis @ rights
        left = basis @ lefts
        for shift, inverse, chosen in self._by_shift(rates):
            vectors = left[:, chosen]
            currents = left_states[:, chosen]
            for _ in range(_CORRECTED):
                adjoint = operator.solved(inverse, shift, *operator.adjoint(rates[chosen], vectors, currents))
                vectors = vectors - adjoint[0]
                currents = currents - adjoint[1]
            left[:, chosen] = vectors
            left_states[:, chosen] = currents

        def weighed(columns: tuple[Complex, Complex]) -> Complex:
            of_structure = np.einsum("ij,ij->j", left.conj(), columns[0])
            of_network = np.einsum("ij,ij->j", left_states.conj(), columns[1])
            return np.asarray(of_structure + of_network)

        slope = weighed(operator.times(rates, right, states, slope=True))
        residual = weighed(operator.times(rates, right, states))
        return Estimates(rates, -residual / slope, rights)

    def solved(self, vectors: Complex, values: Complex, trans: str) -> Complex:
        """P(s)^-H (or, with `trans` "N", P(s)^-1) times each column, with the shift s nearest to its eigenvalue."""
        solved = np.empty_like(vectors)
        for _, inverse, chosen in self._by_shift(values):
            solved[:, chosen] = inverse.solve(np.ascontiguousarray(vectors[:, chosen]), trans=trans)
        return solved

    def _by_shift(self, values: Complex) -> Iterator[tuple[complex, SuperLU, NDArray[np.int64]]]:
        """Each shift that is needed, its factorisation, and the eigenvalues that are nearest to it."""
        mass, damping, stiffness = self._pencil
        distances = np.abs(values[:, None] - self._shifts[None, :])
        nearest = np.argmin(distances, axis=1)
        for number, shift in enumerate(self._shifts.tolist()):
            chosen = np.flatnonzero(nearest == number)
            if not chosen.size:
                continue
            inverse = self._kept.get(number) or eigenvalues.factor(shift**2 * mass + shift * damping + stiffness)
            if self._full.rows <= _LARGE:
                self._kept[number] = inverse
            yield shift, inverse, chosen


def weaker_modes(reduced: Reduced, values: Mapping[str, float], jacobian: Array) -> list[str]:
    """What more contact points would change, as sentences; empty if nothing, or if `reduced` has no finer contacts.

    Eigenvalues with the finer contacts on the same basis are compared with those of the contacts. `jacobian` as in
    `Estimator.at`.
    """
    if not reduced.model.finer:
        return []
    finer = replace(reduced, model=replace(reduced.model, contacts=reduced.model.finer))
    count = sum(points.area.size for points in reduced.model.contacts)
    more = sum(points.area.size for points in finer.model.contacts)
    mass, *few = reduced.pencil(values)
    _, *many = finer.pencil(values)
    n = reduced.coordinates
    changed = jacobian.copy()
    for columns, a, b in zip((slice(n, 2 * n), slice(n)), few, many):
        changed[n : 2 * n, columns] -= np.linalg.solve(mass, b - a)
    near = np.linalg.eigvals(jacobian).astype(complex)
    near = near[in_range(near, reduced.up_to)]
    exact = np.linalg.eigvals(changed).astype(complex)
    exact = exact[in_range(exact, reduced.up_to)]
    left = near.tolist()
    sentences = []
    for value in exact[np.argsort(-exact.real)].tolist():
        if value.real <= 0 or not left:
            break
        same = min(left, key=lambda other: abs(other - value))
        left.remove(same)
        hertz = value.imag / (2 * np.pi)
        if same.real <= 0:
            sentences.append(
                f"{count} contact points may miss a weaker unstable mode: with {more} points the mode at "
                f"{hertz:.4g} Hz grows at {value.real:.3g} 1/s"
            )
            continue
        of_frequency = abs(same.imag / value.imag - 1)
        of_growth = abs(same.real / value.real - 1)
        if of_frequency > ALIKE[0] or of_growth > ALIKE[1]:
            sentences.append(
                f"{count} contact points are few for the mode at {same.imag / (2 * np.pi):.4g} Hz, growth "
                f"{same.real:.3g} 1/s: with {more} points {hertz:.4g} Hz, {value.real:.3g} 1/s"
            )
    for value in left:
        if value.real > 0:
            sentences.append(
                f"{count} contact points make the mode at {value.imag / (2 * np.pi):.4g} Hz grow at "
                f"{value.real:.3g} 1/s; with {more} points it does not grow"
            )
    return [f"{sentence}; set more contacts.NAME.points" for sentence in sentences]


def growing_without_friction(reduced: Reduced, values: Mapping[str, float], damping: Array | None = None) -> list[str]:
    """Eigenvalues that grow without friction, as sentences: the damping is negative."""
    calm = reduced.model.frictionless(values)
    rates = reduced.eigenvalues(calm, damping, "none")[0]
    rates = rates[(rates.imag >= 0) & (rates.real > _CALM * np.abs(rates))]
    sentences = []
    for value in rates[np.argsort(rates.imag)].tolist():
        sentences.append(
            f"without friction the mode at {value.imag / (2 * np.pi):.4g} Hz grows at {value.real:.3g} 1/s: "
            f"the damping is negative; check the sign and the unit of each damping part"
        )
    return sentences
