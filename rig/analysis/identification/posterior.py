"""What recordings tell whose cycles do not repeat: draws of the parameters, weighted by how well they fit the measures.

Keys that the data hardly tell leave a wide and bent region of values that fit, which no covariance at one point
describes. Draws of a wide distribution about the fit are weighted by their likelihood; their mean, covariance and
predictions follow. Runs deviate from every model by more than their errors: the deviation of each measure is a random
effect, estimated over all draws (expectation and maximisation), so that what the parameters take up is not lost.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from scipy import stats

from rig.analysis.identification.cycles import EXACT, MEASURES, CycleRun, shifted
from rig.analysis.identification.fit import Fit, Solution, inverse, whole
from rig.analysis.identification.responses import Response
from rig.record.run import Reals

DRAWS = 320
START = np.array([0.1, 0.1, 0.1, 0.1, 0.0, 0.1])
"""Deviation between runs of each measure where a fit begins; an offset of each record takes up its level."""
_WIDE, _TAILS = 1.5, 5  # of a deviation; degrees of freedom
_UNKNOWN = 0.18  # deviation above which the interval of a key would be wide if all others were known
_ROUNDS = 60
_TIMES = [0, 2, 3]  # measures whose deviations are estimated: those that are fitted, without the level


@dataclass(frozen=True)
class Posterior:
    """Draws `z` [draw, coordinate] with `weights` [draw], the `deviation` of each measure between runs, and the
    `responses` [run][draw] of the runs that are not fitted.
    """

    z: Reals
    weights: Reals
    deviation: Reals
    responses: dict[int, list[Response | str]]

    @classmethod
    def of(
        cls, fit: Fit, solution: Solution, evidence: Sequence[Any], biases: Sequence[Reals], own: Sequence[Reals],
        others: Sequence[int], seed: int,
    ) -> Posterior:  # fmt: skip
        """Draw about a solution. Without `evidence`: from its covariance, which then is the answer already."""
        z, log = _draws(fit, solution, seed, DRAWS if evidence else DRAWS // 4, bool(evidence))
        fitted = [*fit.runs] if evidence else []
        rows = fit.evaluator.responses([fit.values(point) for point in z], [*fitted, *others])
        held = {run: [row[len(fitted) + k] for row in rows] for k, run in enumerate(others)}
        if not evidence:
            return cls(z, np.full(len(z), 1.0 / len(z)), np.zeros(len(MEASURES)), held)
        p, apart, cost = len(fit.free), np.full((len(z), len(evidence), len(MEASURES)), np.nan), np.zeros(len(z))
        signs = [_sign(each, response) for each, response in zip(evidence, solution.responses)]
        for n, row in enumerate(rows):
            responses = whole(row[: len(fitted)])
            if isinstance(responses, str):
                cost[n] = math.inf
                continue
            for i, (each, response) in enumerate(zip(evidence, responses)):
                if isinstance(each, CycleRun):
                    none = np.zeros(len(each.run.columns))
                    apart[n, i] = each.medians - biases[i] - shifted(each, response, none)
                    place = fit.offsets.place[i][0]
                    z[n, p + place] = signs[i] * apart[n, i, 4] / fit.offsets.sizes[place]
                else:
                    cost[n] += float((each.left(response, fit.offsets.values(i, z[n, p:])) ** 2).sum())
        cycles = [i for i, each in enumerate(evidence) if isinstance(each, CycleRun)]
        cost[~np.isfinite(apart[:, cycles]).all(axis=(1, 2))] = math.inf
        weights, deviation = _weighted(apart[:, cycles], [own[i] for i in cycles], cost, log)
        return cls(z, weights, deviation, held)

    @property
    def mean(self) -> Reals:
        """The mean of the coordinates."""
        return np.asarray(self.weights @ self.z)

    @property
    def covariance(self) -> Reals:
        """The covariance of the coordinates."""
        apart = self.z - self.mean
        return np.asarray(np.einsum("n,ni,nj->ij", self.weights, apart, apart)) + 1e-12 * np.eye(self.z.shape[1])

    def predicted(self, about: Sequence[Response | str], each: CycleRun) -> tuple[Reals, Reals] | None:
        """Mean and variance over the draws of the measures of a run; None if the detector reads no slips."""
        read = [None if isinstance(response, str) else each.model_measures(response) for response in about]
        index = [n for n, made in enumerate(read) if made is not None and self.weights[n] > 0.0]
        if not index:
            return None
        values, share = np.array([read[n] for n in index], dtype=float), self.weights[index] / self.weights[index].sum()
        mean = share @ values
        return mean, share @ (values - mean) ** 2


def _sign(each: Any, response: Response) -> float:
    """The change of the level of a run for one of its offset."""
    levels = [shifted(each, response, np.full(len(each.run.columns), offset))[4] for offset in (0.0, 1.0)]
    return math.copysign(1.0, levels[1] - levels[0])


def _draws(fit: Fit, solution: Solution, seed: int, count: int, wide: bool) -> tuple[Reals, Reals]:
    """Draws within the ranges from the normal distribution of a solution, and the logarithms of their densities.

    `wide`: half from a wider t distribution; half with the keys that are unknown even beside known others anywhere in
    their ranges, since the region that fits may be a plateau of which the solution sees one end.
    """
    p, chance = len(fit.free), np.random.default_rng(seed)
    middle, C = solution.z[:p], solution.covariance[:p, :p]
    if not wide:
        points = _inside(fit, chance.multivariate_normal(middle, C, 100 * count))[:count]
        return np.hstack([points, np.tile(solution.z[p:], (len(points), 1))]), np.zeros(len(points))
    shape = _WIDE**2 * C + 1e-12 * np.diag(np.diag(C))
    unknown = np.diag(inverse(C)) * _UNKNOWN**2 < 1.0
    rest = np.flatnonzero(np.logical_not(unknown))
    everywhere = np.exp(-np.log(fit.high - fit.low)[unknown].sum())
    drawn = [stats.multivariate_t(middle, shape, _TAILS, seed=chance).rvs(100 * count).reshape(-1, p)]
    drawn.append(drawn[0].copy())
    drawn[1][:, unknown] = chance.uniform(fit.low[unknown], fit.high[unknown], (100 * count, int(unknown.sum())))
    kept = [_inside(fit, points) for points in drawn]
    z = np.concatenate([points[: count // 2] for points in kept])
    density = np.exp(stats.multivariate_t(middle, shape, _TAILS).logpdf(z)) / len(kept[0])
    others = (
        stats.multivariate_t(middle[rest], shape[np.ix_(rest, rest)], _TAILS).logpdf(z[:, rest]) if rest.size else 0.0
    )
    density = density + everywhere * np.exp(others) / len(kept[1])
    return np.hstack([z, np.tile(solution.z[p:], (len(z), 1))]), np.log(density)


def _inside(fit: Fit, points: Reals) -> Reals:
    return np.asarray(points[((points >= fit.low) & (points <= fit.high)).all(axis=1)])


def _weighted(apart: Reals, own: Sequence[Reals], cost: Reals, log: Reals) -> tuple[Reals, Reals]:
    """Weights of draws with residuals `apart` [draw, run, measure], and the deviation of each measure between runs."""
    square, index = START**2, np.ix_(_TIMES, _TIMES)
    good = np.isfinite(cost)
    r, weights = np.where(good[:, None, None], apart, 0.0)[:, :, _TIMES], np.zeros(len(cost))
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
