"""What recordings tell whose cycles do not repeat: draws of the parameters, weighted by how well they fit the measures.

Keys that the data hardly tell leave a wide region of values that fit, which no covariance at one point describes. Draws
are weighted by their likelihood over the density from which they come; their mean, covariance and predictions follow.
The first come from a wide distribution about the fit, the next from kernels about those that have weight, until the
weights count as much as `ENOUGH` equal ones: the mean then has an error by chance of a tenth of its deviation, wherever
the fit has ended. At `_MOST` draws they end in any case, and the answer says so. Two keys of which only the difference
acts are drawn as difference and level.

Runs deviate from every model by more than their errors: the deviation of each measure is a random effect, estimated
over all draws (expectation and maximisation), so that what the parameters take up is not lost.

Method: adaptive multiple importance sampling, Cornuet, Marin, Mira, Robert, Scandinavian Journal of Statistics 39
(2012) 798.
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

from rig.analysis.identification.cycles import EXACT, MEASURES, CycleRun, shifted
from rig.analysis.identification.fit import Fit, Solution, inverse
from rig.analysis.identification.responses import Response
from rig.record.run import Reals

ENOUGH = 100.0
"""Equal weights that those of the draws count as."""
_FIRST, _NEXT, _MOST = 128, 64, 640  # draws: about the fit, about those with weight each time, all
_POINTS = 4096  # of the sequence, of which the first that lie in the ranges are draws
_KERNELS = 24.0  # equal weights that those of kernels count as at least
_SMALLEST = 0.01  # difference over the low end of its key
_ALIKE = 0.9  # correlation of two keys that are drawn as difference and level
START = np.array([0.1, 0.1, 0.1, 0.1, 0.0, 0.1])
"""Deviation between runs of each measure where a fit begins; an offset of each record takes up its level."""
_WIDE, _TAILS = 1.5, 5  # of a deviation; degrees of freedom
_UNKNOWN = 0.18  # deviation above which the interval of a key would be wide if all others were known
_ROUNDS = 60
_TIMES = [0, 2, 3]  # measures whose deviations are estimated: those that are fitted, without the level


@dataclass(frozen=True)
class Posterior:
    """Draws `u` [draw, coordinate] with `weights` [draw], the `deviation` of each measure between runs, and the
    `responses` [run][draw] of the runs that are not fitted. `space`: what the coordinates are.
    """

    space: Space
    u: Reals
    weights: Reals
    deviation: Reals
    responses: dict[int, list[Response | str]]

    @classmethod
    def about(cls, fit: Fit, solution: Solution, others: Sequence[int], seed: int) -> Posterior:
        """Draw from the covariance of a solution, which is the answer already."""
        space = Space.of(fit, solution, ())
        p = len(fit.free)
        points = np.random.default_rng(seed).multivariate_normal(
            solution.z[:p], solution.covariance[:p, :p], 100 * _NEXT, method="cholesky"
        )
        u = space.with_offsets(points[space.inside(points)][:_NEXT], solution.z[p:])
        held = _responses(fit, u, others)
        return cls(space, u, np.full(len(u), 1.0 / len(u)), np.zeros(len(MEASURES)), held)

    @classmethod
    def of(
        cls,
        fit: Fit,
        solution: Solution,
        evidence: Sequence[Any],
        biases: Sequence[Reals],
        own: Sequence[Reals],
        others: Sequence[int],
        seed: int,
    ) -> Posterior:
        """Draw until the weights count as `ENOUGH` equal ones."""
        space = Space.of(fit, solution)
        p = len(fit.free)
        signs = [_sign(each, response) for each, response in zip(evidence, solution.responses)]
        cycles = [i for i, each in enumerate(evidence) if isinstance(each, CycleRun)]
        u = np.zeros((0, len(solution.z)))
        apart = np.zeros((0, len(evidence), len(MEASURES)))
        cost = np.zeros(0)
        proposals: list[tuple[int, Proposal]] = []
        weights = deviation = np.zeros(0)
        while not len(u) or (len(u) < _MOST and _worth(weights) < ENOUGH):
            if not len(u):
                shape = space.covariance(solution)
                unknown = np.diag(inverse(shape)) * _UNKNOWN**2 < 1.0
                middle = space.straight(solution.z[None])[:, :p]
                one = np.ones(1)
                new = [
                    (_FIRST // 2, Proposal(space, middle, one, _WIDE**2 * shape, np.zeros(p, bool), seed)),
                    (_FIRST // 2, Proposal(space, middle, one, _WIDE**2 * shape, unknown, seed + 1)),
                ]
            else:
                width = (4.0 / ((p + 2) * ENOUGH)) ** (1.0 / (p + 4))  # of kernels about so many points
                flat = _flattened(weights)
                away = u[:, :p] - flat @ u[:, :p]
                shape = width**2 * (flat * away.T) @ away
                new = [(_NEXT, Proposal(space, u[:, :p], flat, shape, np.zeros(p, bool), seed + len(proposals)))]
            for count, proposal in new:
                drawn = space.with_offsets(proposal.draws(count), solution.z[p:])
                proposals.append((len(drawn), proposal))
                more, left, missed = _left(fit, space, drawn, evidence, biases, signs)
                u = np.concatenate([u, more])
                apart = np.concatenate([apart, left])
                cost = np.concatenate([cost, missed])
            density = sum(count * proposal.density(u[:, :p]) for count, proposal in proposals)
            usable = np.isfinite(apart[:, cycles]).all(axis=(1, 2))
            weights, deviation = _weighted(
                apart[:, cycles], [own[i] for i in cycles], np.where(usable, cost, math.inf), np.log(density)
            )
        return cls(space, u, weights, deviation, _responses(fit, space.bent(u), others))

    @property
    def mean(self) -> Reals:
        """The coordinates of the fit at the mean of those of the draws."""
        return np.asarray(self.space.bent((self.weights @ self.u)[None])[0])

    @property
    def covariance(self) -> Reals:
        """The covariance of the coordinates of the fit, of keys that are drawn as difference and level to first order
        about the mean. An offset follows values rather than their logarithms: its correlations are those with values.
        """
        p = self.space.p
        away = self.u - self.weights @ self.u
        C = (self.weights * away.T) @ away
        values = np.where(self.space.logs, np.exp(self.space.bent(self.u)[:, :p]), self.u[:, :p])
        values -= self.weights @ values
        C[:p, p:] = (self.weights * values.T) @ away[:, p:]
        turn = np.linalg.inv(self.space.slope(self.mean))
        C[:p, :p] = turn @ C[:p, :p] @ turn.T
        size = np.sqrt(np.diag(C)[:p] / np.maximum(self.weights @ values**2, 1e-300))
        C[:p, p:] *= size[:, None]
        C[p:, :p] = C[:p, p:].T
        return np.asarray(C + 1e-12 * np.eye(len(C)))

    def words(self) -> str:
        """What is to be said where `_MOST` draws are not enough; else ""."""
        if (worth := _worth(self.weights)) >= ENOUGH:
            return ""
        return (
            f"the weights of {len(self.weights)} draws count as {worth:.0f} equal ones only: by chance, values may be "
            f"off by {1.0 / math.sqrt(worth):.2f} standard deviations; state narrower ranges, or free fewer parameters"
        )

    def predicted(self, about: Sequence[Response | str], each: CycleRun) -> tuple[Reals, Reals] | None:
        """Mean and variance over the draws of the measures of a run; None if the detector reads no slips."""
        read = [None if isinstance(response, str) else each.model_measures(response) for response in about]
        index = [n for n, made in enumerate(read) if made is not None and self.weights[n] > 0.0]
        if not index:
            return None
        values = np.array([read[n] for n in index], dtype=float)
        share = self.weights[index] / self.weights[index].sum()
        mean = share @ values
        return mean, share @ (values - mean) ** 2


def _sign(each: Any, response: Response) -> float:
    """The change of the level of a run for one of its offset."""
    levels = [shifted(each, response, np.full(len(each.run.columns), offset))[4] for offset in (0.0, 1.0)]
    return math.copysign(1.0, levels[1] - levels[0])


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
        for i, k in permutations(range(len(free)) if alike is None else alike, 2):
            near = C[i, k] > _ALIKE * math.sqrt(C[i, i] * C[k, k])
            taken = {place for pair in pairs for place in pair}
            if near and free[i].log and free[k].log and free[i].unit == free[k].unit and z[i] > z[k]:
                pairs += [(i, k)] if not {i, k} & taken else []
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
        made = np.eye(self.p)
        for i, k in self.pairs:
            made[i, i] = 1.0 / -np.expm1(z[k] - z[i])
            made[i, k] = -1.0 / np.expm1(z[i] - z[k])
        return made

    def covariance(self, solution: Solution) -> Reals:
        """The covariance of a solution in the coordinates of draws."""
        turn = self.slope(solution.z)
        return np.asarray(turn @ solution.covariance[: self.p, : self.p] @ turn.T)

    def inside(self, u: Reals) -> Any:
        """Which points lie in the ranges."""
        low, high = self.box
        z = self.bent(u)
        return ((z >= self.low) & (z <= self.high) & (u >= low) & (u <= high)).all(axis=1)

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
        shares = qmc.Sobol(p + 2, rng=np.random.default_rng(self.seed)).random(_POINTS)
        shares = np.clip(shares, 1e-9, 1.0 - 1e-9)
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
        made = np.full(len(u), np.exp(-np.log(high - low)[self.anywhere].sum()) / max(self._kept[1], 1.0 / _POINTS))
        if not rest.size:
            return made
        away = (u[:, None, rest] - self.centres[None, :, rest]).reshape(-1, rest.size)
        square = (solve_triangular(self._root, away.T, lower=True) ** 2).sum(axis=0).reshape(len(u), -1)
        d = rest.size
        size = math.lgamma(0.5 * (_TAILS + d)) - math.lgamma(0.5 * _TAILS) - 0.5 * d * math.log(_TAILS * math.pi)
        size -= float(np.log(np.diag(self._root)).sum())
        return np.asarray(made * (np.exp(size - 0.5 * (_TAILS + d) * np.log1p(square / _TAILS)) @ self.weights))


def _worth(weights: Reals) -> float:
    """The number of equal weights that weights count as."""
    return 1.0 / float((weights**2).sum())


def _flattened(weights: Reals) -> Reals:
    """Weights to a power at which they count as `_KERNELS`: kernels about two or three draws would shrink to them."""
    power = 1.0
    while _worth(weights) < _KERNELS and power > 1e-3:
        power *= 0.7
        weights = weights**0.7
        weights = weights / weights.sum()
    return weights


def _responses(fit: Fit, z: Reals, runs: Sequence[int]) -> dict[int, list[Response | str]]:
    """The responses [run][point] of runs at points."""
    rows = fit.evaluator.responses([fit.values(point) for point in z], runs) if runs else []
    return {run: [row[k] for row in rows] for k, run in enumerate(runs)}


def _left(
    fit: Fit, space: Space, u: Reals, evidence: Sequence[Any], biases: Sequence[Reals], signs: Sequence[float]
) -> tuple[Reals, Reals, Reals]:
    """Draws with their best offsets, what they leave of the measures [draw, run, measure], and the cost of other runs.

    Not finite where a run has no response.
    """
    u = u.copy()
    p = len(fit.free)
    apart = np.full((len(u), len(evidence), len(MEASURES)), np.nan)
    cost = np.zeros(len(u))
    for n, (z, row) in enumerate(zip(space.bent(u), fit.responses(list(space.bent(u))))):
        if isinstance(row, str):
            cost[n] = math.inf
            continue
        for i, (each, response) in enumerate(zip(evidence, row)):
            if isinstance(each, CycleRun):
                none = np.zeros(len(each.run.columns))
                apart[n, i] = each.medians - biases[i] - shifted(each, response, none)
                place = fit.offsets.place[i][0]
                u[n, p + place] = signs[i] * apart[n, i, 4] / fit.offsets.sizes[place]
            else:
                cost[n] += float((each.left(response, fit.offsets.values(i, z[p:])) ** 2).sum())
    return u, apart, cost


def _weighted(apart: Reals, own: Sequence[Reals], cost: Reals, log: Reals) -> tuple[Reals, Reals]:
    """Weights of draws with residuals `apart` [draw, run, measure], and the deviation of each measure between runs."""
    square = START**2
    index = np.ix_(_TIMES, _TIMES)
    good = np.isfinite(cost)
    r = np.where(good[:, None, None], apart, 0.0)[:, :, _TIMES]
    weights = np.zeros(len(cost))
    errors = np.array([np.diag(C) for C in own])[:, _TIMES]
    for _ in range(_ROUNDS):
        fits = np.where(good, -0.5 * cost - log, -math.inf)
        for k, C in enumerate(own):
            S = C[index] + np.diag(square[_TIMES]) + EXACT**2 * np.eye(len(_TIMES))
            fits -= 0.5 * np.einsum("ni,ij,nj->n", r[:, k], np.linalg.inv(S), r[:, k])
        weights = np.exp(fits - fits.max())
        weights /= weights.sum()
        kept = square[_TIMES] / (square[_TIMES] + errors)  # of a residual: the share that is deviation
        expected = kept**2 * np.einsum("n,nki->ki", weights, r**2) + kept * errors
        made = expected.mean(axis=0)
        square = np.zeros(len(MEASURES))
        square[_TIMES] = 0.5 * (made + made.mean())  # few runs: else one measure fits itself
    apart = np.where(good[:, None, None], apart, 0.0)
    for k in (1, 5):  # measures that are not fitted
        square[k] = max(float((weights @ apart[:, :, k] ** 2).mean() - np.mean([C[k, k] for C in own])), square[0])
    return weights, np.sqrt(square)
