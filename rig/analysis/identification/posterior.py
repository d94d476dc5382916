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
from typing import Any

import numpy as np

from rig.analysis.identification.cycles import EXACT, CycleRun, shifted
from rig.analysis.identification.fit import Fit, Solution, inverse
from rig.analysis.identification.proposals import Proposal, Space
from rig.analysis.identification.responses import Response
from rig.analysis.identification.slips import MEASURES
from rig.record.run import Reals

ENOUGH = 100.0
"""Equal weights that those of the draws count as."""
_FIRST = 128  # draws about the fit
_NEXT = 64  # draws about those with weight, each time
_MOST = 640  # draws, all in all
_KERNELS = 24.0  # equal weights that those of kernels count as at least
START = np.array([0.1, 0.1, 0.1, 0.1, 0.0, 0.1])
"""Deviation between runs of each measure where a fit begins; an offset of each record takes up its level."""
_WIDE = 1.5  # times the deviation of the fit: the first draws must reach beyond it
_UNKNOWN = 0.18  # deviation above which the interval of a key would be wide if all others were known
_ROUNDS = 60  # of expectation and maximisation
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
        chance = np.random.default_rng(seed)
        covariance = solution.covariance[:p, :p]
        points = chance.multivariate_normal(solution.z[:p], covariance, 100 * _NEXT, method="cholesky")
        inside = points[space.inside(points)]
        u = space.with_offsets(inside[:_NEXT], solution.z[p:])
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
        none_anywhere = np.zeros(p, bool)
        signs = [_sign(each, response) for each, response in zip(evidence, solution.responses)]
        cycles = [i for i, each in enumerate(evidence) if isinstance(each, CycleRun)]
        u = np.zeros((0, len(solution.z)))
        apart = np.zeros((0, len(evidence), len(MEASURES)))
        cost = np.zeros(0)
        proposals: list[tuple[int, Proposal]] = []
        weights = deviation = np.zeros(0)
        while not len(u) or (len(u) < _MOST and _worth(weights) < ENOUGH):
            if not len(u):
                covariance = space.covariance(solution)
                unknown = np.diag(inverse(covariance)) * _UNKNOWN**2 < 1.0
                middle = space.straight(solution.z[None])[:, :p]
                shape = _WIDE**2 * covariance
                about = Proposal(space, middle, np.ones(1), shape, none_anywhere, seed)
                beyond = Proposal(space, middle, np.ones(1), shape, unknown, seed + 1)
                new = [(_FIRST // 2, about), (_FIRST // 2, beyond)]
            else:
                width = (4.0 / ((p + 2) * ENOUGH)) ** (1.0 / (p + 4))  # of kernels about so many points
                flat = _flattened(weights)
                away = u[:, :p] - flat @ u[:, :p]
                shape = width**2 * (flat * away.T) @ away
                kernels = Proposal(space, u[:, :p], flat, shape, none_anywhere, seed + len(proposals))
                new = [(_NEXT, kernels)]
            for count, proposal in new:
                drawn = space.with_offsets(proposal.draws(count), solution.z[p:])
                proposals.append((len(drawn), proposal))
                more, left, missed = _left(fit, space, drawn, evidence, biases, signs)
                u = np.concatenate([u, more])
                apart = np.concatenate([apart, left])
                cost = np.concatenate([cost, missed])
            density = sum(count * proposal.density(u[:, :p]) for count, proposal in proposals)
            usable = np.isfinite(apart[:, cycles]).all(axis=(1, 2))
            usable_cost = np.where(usable, cost, math.inf)
            errors = [own[i] for i in cycles]
            weights, deviation = _weighted(apart[:, cycles], errors, usable_cost, np.log(density))
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
        z = self.space.bent(self.u)
        values = np.where(self.space.logs, np.exp(z[:, :p]), self.u[:, :p])
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
        worth = _worth(self.weights)
        if worth >= ENOUGH:
            return ""
        return (
            f"the weights of {len(self.weights)} draws count as {worth:.0f} equal ones only: by chance, values may be "
            f"off by {1.0 / math.sqrt(worth):.2f} standard deviations; state narrower ranges, or free fewer parameters"
        )

    def predicted(self, about: Sequence[Response | str], each: CycleRun) -> tuple[Reals, Reals] | None:
        """Mean and variance over the draws of the measures of a run; None if the detector reads no slips."""
        read = [None if isinstance(response, str) else each.model_measures(response) for response in about]
        index = [n for n, measures in enumerate(read) if measures is not None and self.weights[n] > 0.0]
        if not index:
            return None
        values = np.array([read[n] for n in index], dtype=float)
        share = self.weights[index] / self.weights[index].sum()
        mean = share @ values
        return mean, share @ (values - mean) ** 2


def _sign(each: Any, response: Response) -> float:
    """The change of the level of a run for one of its offset."""
    none = np.zeros(len(each.run.columns))
    before = shifted(each, response, none)[4]
    after = shifted(each, response, none + 1.0)[4]
    return math.copysign(1.0, after - before)


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
    if not rows:
        return {run: [] for run in runs}
    return {run: list(of_points) for run, of_points in zip(runs, zip(*rows, strict=True))}


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
    points = space.bent(u)
    for n, (z, row) in enumerate(zip(points, fit.responses(list(points)))):
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
                left = each.left(response, fit.offsets.values(i, z[p:]))
                cost[n] += float((left**2).sum())
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
        of_runs = expected.mean(axis=0)
        square = np.zeros(len(MEASURES))
        square[_TIMES] = 0.5 * (of_runs + of_runs.mean())  # few runs: else one measure fits itself
    apart = np.where(good[:, None, None], apart, 0.0)
    for k in (1, 5):  # measures that are not fitted
        error = np.mean([C[k, k] for C in own])
        square[k] = max(float((weights @ apart[:, :, k] ** 2).mean() - error), square[0])
    return weights, np.sqrt(square)
