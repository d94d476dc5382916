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
from numpy.typing import NDArray
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
    kept = (values.imag > LEAST * up_to) & (values.imag <= up_to) & (np.abs(values.real) <= DAMPED * values.imag)
    chosen = np.flatnonzero(kept)
    return chosen[np.argsort(values[chosen].imag, kind="stable")]


class Estimator:
    """Estimates for one structure and any basis, at any point, with factorisations made at the point `at`.

    They are kept for the next point, except those of large structures, which take gigabytes. Points with a contact that
    is much stiffer need others.
    """

    def __init__(self, full: Full, up_to: float, at: Mapping[str, float]) -> None:
        """`up_to` [rad/s]: the highest frequency; `at`: the numbers of the scene at which to factorise."""
        self._full = full
        self._at, self._pencil = at, full.pencil(at)
        self._shifts = 1j * up_to * (np.arange(SHIFTS) + 0.5) / SHIFTS
        self._kept: dict[int, SuperLU] = {}

    def at(self, reduced: Reduced, values: Mapping[str, float], damping: Array | None = None) -> Estimates:
        """Estimates for the eigenvalues of `reduced` up to its `up_to`, for these `values` by key.

        `damping` [n, n] as in `Reduced.eigenvalues`.
        """
        basis = reduced.basis.astype(float)
        rates, rights, lefts = reduced.eigenvalues(values, damping, left=True)
        kept = in_range(rates, reduced.up_to)
        rates, rights, lefts = rates[kept], rights[:, kept], lefts[:, kept]
        mass, own, stiffness = pencil = self._full.pencil(values)
        if any(values[c.stiffness_key] > _STIFFER * self._at[c.stiffness_key] for c in self._full.contacts):
            self._at, self._pencil, self._kept = values, pencil, {}
        modal = None if damping is None else mass @ basis  # modal damping of the full structure: M V C V^T M

        def damped(vectors: Complex, matrix: Any, added: Array | None) -> Complex:
            total = matrix @ vectors
            if modal is not None and added is not None:
                total = total + modal @ (added @ (modal.T @ vectors))
            return np.asarray(total)

        right, left = basis @ rights, basis @ lefts
        moved, reached = mass @ right, damped(right, own, damping)
        residual = rates**2 * moved + rates * reached + stiffness @ right
        for inverse, chosen in self._by_shift(rates):
            value, vectors = rates[chosen].conj(), left[:, chosen]
            for _ in range(_CORRECTED):
                adjoint = value * damped(vectors, own.T, None if damping is None else damping.T)
                adjoint += value**2 * (mass.T @ vectors) + stiffness.T @ vectors
                vectors = vectors - inverse.solve(adjoint, trans="H")
            left[:, chosen] = vectors
        slope = np.einsum("ij,ij->j", left.conj(), 2 * rates * moved + reached)
        return Estimates(rates, -np.einsum("ij,ij->j", left.conj(), residual) / slope, rights)

    def solved(self, vectors: Complex, values: Complex, trans: str) -> Complex:
        """P(s)^-H (or, with `trans` "N", P(s)^-1) times each column, with the shift s nearest to its eigenvalue."""
        solved = np.empty_like(vectors)
        for inverse, chosen in self._by_shift(values):
            solved[:, chosen] = inverse.solve(np.ascontiguousarray(vectors[:, chosen]), trans=trans)
        return solved

    def _by_shift(self, values: Complex) -> Iterator[tuple[SuperLU, NDArray[np.int64]]]:
        """Each factorisation that is needed, and the eigenvalues that are nearest to its shift."""
        mass, damping, stiffness = self._pencil
        nearest = np.argmin(np.abs(values[:, None] - self._shifts[None, :]), axis=1)
        for number, shift in enumerate(self._shifts.tolist()):
            chosen = np.flatnonzero(nearest == number)
            if not chosen.size:
                continue
            inverse = self._kept.get(number) or eigenvalues.factor(shift**2 * mass + shift * damping + stiffness)
            if self._full.rows <= _LARGE:
                self._kept[number] = inverse
            yield inverse, chosen


def weaker_modes(reduced: Reduced, values: Mapping[str, float], damping: Array | None = None) -> list[str]:
    """What more contact points would change, as sentences; empty if nothing, or if `reduced` has no finer contacts.

    Eigenvalues with the finer contacts on the same basis are compared with those of the contacts.
    """
    if not reduced.model.finer:
        return []
    finer = replace(reduced, model=replace(reduced.model, contacts=reduced.model.finer))
    count, more = (sum(points.area.size for points in each.model.contacts) for each in (reduced, finer))
    near, exact = (each.eigenvalues(values, damping)[0] for each in (reduced, finer))
    near, exact = near[in_range(near, reduced.up_to)], exact[in_range(exact, reduced.up_to)]
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
        elif abs(same.imag / value.imag - 1) > ALIKE[0] or abs(same.real / value.real - 1) > ALIKE[1]:
            sentences.append(
                f"{count} contact points are few for the mode at {same.imag / (2 * np.pi):.4g} Hz, growth "
                f"{same.real:.3g} 1/s: with {more} points {hertz:.4g} Hz, {value.real:.3g} 1/s"
            )
    sentences += [
        f"{count} contact points make the mode at {value.imag / (2 * np.pi):.4g} Hz grow at {value.real:.3g} 1/s; "
        f"with {more} points it does not grow"
        for value in left
        if value.real > 0
    ]
    return [f"{sentence}; set more contacts.NAME.points" for sentence in sentences]


def growing_without_friction(reduced: Reduced, values: Mapping[str, float], damping: Array | None = None) -> list[str]:
    """Eigenvalues that grow without friction, as sentences: the damping is negative."""
    calm = reduced.model.frictionless(values)
    rates = reduced.eigenvalues(calm, damping)[0]
    rates = rates[(rates.imag >= 0) & (rates.real > _CALM * np.abs(rates))]
    return [
        f"without friction the mode at {value.imag / (2 * np.pi):.4g} Hz grows at {value.real:.3g} 1/s: "
        f"the damping is negative; check the sign and the unit of each damping part"
        for value in rates[np.argsort(rates.imag)].tolist()
    ]
