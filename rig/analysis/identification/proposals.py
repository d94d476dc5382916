"""From where draws of parameters come: coordinates without narrow valleys, and mixtures of t distributions in them.

Two keys of which only the difference acts are drawn as difference and level. Draws are quasi random: the first points
of a Sobol sequence that lie within the ranges.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from itertools import permutations
from typing import Any

import numpy as np
from scipy import stats

from rig.analysis.identification.fit import Fit, Solution
from rig.record.run import Reals

_POINTS = 4096  # of the sequence, of which the first that lie in the ranges are draws
_SMALLEST = 0.01  # difference over the low end of its key
_ALIKE = 0.9  # correlation of two keys that are drawn as difference and level
_TAILS = 5  # degrees of freedom of a proposal: few, so that its tails reach beyond those of what it samples


@dataclass(frozen=True)
class Space:
    """Coordinates in which draws are made: those of the fit, but of `pairs` (larger, smaller) that are nearly one the
    logarithms of difference and smaller key. Any level then leaves the difference as it is.
    """

    low: Reals
    high: Reals
    """Of the coordinates of the fit."""
    pairs: tuple[tuple[int, int], ...]
    logs: np.ndarray[Any, np.dtype[np.bool_]]

    @classmethod
    def of(cls, fit: Fit, solution: Solution, alike: Sequence[int] | None = None) -> Space:
        """The coordinates for a solution. `alike`: keys among which pairs are looked for, by default all."""
        C = solution.covariance
        z = solution.z
        free = fit.free
        pairs: list[tuple[int, int]] = []
        taken: set[int] = set()
        for i, k in permutations(range(len(free)) if alike is None else alike, 2):
            near = C[i, k] > _ALIKE * math.sqrt(C[i, i] * C[k, k])
            comparable = free[i].log and free[k].log and free[i].unit == free[k].unit
            if near and comparable and z[i] > z[k] and not {i, k} & taken:
                pairs.append((i, k))
                taken |= {i, k}
        return cls(fit.low, fit.high, tuple(pairs), fit.logs[: len(free)])

    @property
    def p(self) -> int:
        """Number of parameters."""
        return len(self.low)

    @property
    def box(self) -> tuple[Reals, Reals]:
        """The ranges of the coordinates."""
        low = self.low.copy()
        high = self.high.copy()
        for i, k in self.pairs:
            high[i] = math.log(math.exp(self.high[i]) - math.exp(self.low[k]))
            low[i] = self.low[i] + math.log(_SMALLEST)
        return low, high

    def bent(self, u: Reals) -> Reals:
        """The coordinates of the fit [point, coordinate]."""
        z = u.copy()
        for i, k in self.pairs:
            z[:, i] = np.logaddexp(u[:, i], u[:, k])
        return z

    def straight(self, z: Reals) -> Reals:
        """The coordinates of draws at those of the fit [point, coordinate]."""
        u = z.copy()
        for i, k in self.pairs:
            u[:, i] = z[:, k] + np.log(np.expm1(z[:, i] - z[:, k]))
        return u

    def slope(self, z: Reals) -> Reals:
        """Derivatives of the coordinates of draws by those of the fit."""
        slope = np.eye(self.p)
        for i, k in self.pairs:
            slope[i, i] = 1.0 / -np.expm1(z[k] - z[i])
            slope[i, k] = -1.0 / np.expm1(z[i] - z[k])
        return slope

    def covariance(self, solution: Solution) -> Reals:
        """The covariance of a solution in the coordinates of draws."""
        turn = self.slope(solution.z)
        return np.asarray(turn @ solution.covariance[: self.p, : self.p] @ turn.T)

    def inside(self, u: Reals) -> Any:
        """Which points lie in the ranges."""
        low, high = self.box
        z = self.bent(u)
        allowed = (z >= self.low) & (z <= self.high)
        drawable = (u >= low) & (u <= high)
        return (allowed & drawable).all(axis=1)

    @staticmethod
    def with_offsets(u: Reals, offsets: Reals) -> Reals:
        """Points with the same offsets."""
        return np.hstack([u, np.tile(offsets, (len(u), 1))])


@dataclass(frozen=True)
class Proposal:
    """A mixture of t distributions of one `shape` about `centres` with `weights`, within the ranges; coordinates that
    are `anywhere` are uniform there, since the region that fits may be a plateau of which the solution sees one end.
    """

    space: Space
    centres: Reals
    weights: Reals
    shape: Reals
    anywhere: Any
    seed: int

    @cached_property
    def _root(self) -> Reals:
        """The Cholesky factor of the shape of the coordinates that are not anywhere: no sign is left to rounding."""
        rest = np.logical_not(self.anywhere)
        shape = self.shape[np.ix_(rest, rest)]
        return np.asarray(np.linalg.cholesky(shape + 1e-12 * np.diag(np.diag(shape))))

    @cached_property
    def _kept(self) -> tuple[Reals, float]:
        """Points of a Sobol sequence within the ranges, and their share of all."""
        from scipy.stats import qmc

        p = self.space.p
        rest = np.flatnonzero(np.logical_not(self.anywhere))
        sequence = qmc.Sobol(p + 2, rng=np.random.default_rng(self.seed))
        shares = np.clip(sequence.random(_POINTS), 1e-9, 1.0 - 1e-9)
        low, high = self.space.box
        u = low + (high - low) * shares[:, :p]
        which = np.searchsorted(np.cumsum(self.weights)[:-1], shares[:, p])
        wide = np.sqrt(_TAILS / stats.chi2.ppf(shares[:, p + 1], _TAILS))[:, None]
        u[:, rest] = self.centres[which][:, rest] + wide * stats.norm.ppf(shares[:, rest]) @ self._root.T
        kept = u[self.space.inside(u)]
        return kept, len(kept) / _POINTS

    def draws(self, count: int) -> Reals:
        """At most `count` draws [draw, coordinate]."""
        return self._kept[0][:count]

    def density(self, u: Reals) -> Reals:
        """The density at points [point, coordinate] within the ranges."""
        from scipy.linalg import solve_triangular

        rest = np.flatnonzero(np.logical_not(self.anywhere))
        low, high = self.space.box
        log_volume = np.log(high - low)[self.anywhere].sum()
        uniform = np.full(len(u), np.exp(-log_volume) / max(self._kept[1], 1.0 / _POINTS))
        d = rest.size
        if not d:
            return uniform
        away = (u[:, None, rest] - self.centres[None, :, rest]).reshape(-1, d)
        scaled = solve_triangular(self._root, away.T, lower=True)
        square = (scaled**2).sum(axis=0).reshape(len(u), -1)
        size = math.lgamma(0.5 * (_TAILS + d)) - math.lgamma(0.5 * _TAILS) - 0.5 * d * math.log(_TAILS * math.pi)
        size -= float(np.log(np.diag(self._root)).sum())
        kernels = np.exp(size - 0.5 * (_TAILS + d) * np.log1p(square / _TAILS))
        return np.asarray(uniform * (kernels @ self.weights))
