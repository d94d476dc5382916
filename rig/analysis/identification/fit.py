"""Least squares over responses, and the covariance of the parameters from independent cycles.

    minimise |r(z)|^2 + (z - z0)' P (z - z0)      z: coordinates of the free parameters, then offsets
    C = A (sum_j g_j g_j') A n / (n - p),  A = (J'J + P)^-1,  g_j = sum over cycle j of J_i r_i

P is that of a standard deviation of half the range of each parameter: it holds what the data do not tell. Intervals
never follow from the number of samples. Levenberg and Marquardt's method; the Jacobian has differences of whole cycles,
which are exact to rounding because events are. Keys that are nearly one leave a narrow bent valley, in which damped
steps creep: a step follows the bend by its second derivative (geodesic acceleration), offsets are fitted anew at
each of its ends, and a fit has ended where the step without damping is small beside the deviations, not the last step.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field

import numpy as np

from rig.analysis.identification.responses import Evaluator, Response
from rig.analysis.identification.runs import FREE, NONE, Free, Measured
from rig.record.run import Reals

STEP = 1e-3
"""Difference of a coordinate for the Jacobian."""
ROUNDS = 40
_DAMPING = (1e-3, 10.0, 1e6)  # first, factor, and where no step helps
_SETTLED, _CONVERGED = 0.05, 0.2  # of a standard deviation, step without damping: where a fit ends; that converged
_BENT = (0.1, 0.75)  # share of a step for its second derivative; largest bend beside the step
NORMAL = 1.6448536269514722
"""Half of an interval of 90 %, in standard deviations."""

Blocks = Callable[[int, Response, Reals], Reals]
"""Residuals [cluster, value] of a run for its response and the offsets of its columns."""


@dataclass(frozen=True)
class Offsets:
    """Which offset each column of each run has: `place` [run][column], -1 for none; `names`; `sizes`, their unit."""

    place: tuple[tuple[int, ...], ...]
    names: tuple[str, ...]
    sizes: tuple[float, ...]

    @classmethod
    def of(cls, runs: Sequence[Measured], sizes: Sequence[Sequence[float]]) -> Offsets:
        """The offsets of runs; `sizes` [run][column]: what is fitted is in this unit."""
        names: dict[str, float] = {}
        place = []
        for run, own in zip(runs, sizes):
            row = []
            for column, size in zip(run.columns, own):
                name = f"offset of {column.name}" + (f" in {run.name}" if column.offset != FREE else "")
                row.append(-1 if column.offset == NONE else [*names].index(name) if name in names else len(names))
                if column.offset != NONE:
                    names.setdefault(name, float(size))
            place.append(tuple(row))
        return cls(tuple(place), tuple(names), tuple(names.values()))

    def values(self, run: int, z: Reals) -> Reals:
        """The offsets of the columns of a run in SI, of the fitted ones `z`."""
        return np.array([z[i] * self.sizes[i] if i >= 0 else 0.0 for i in self.place[run]])


@dataclass
class Solution:
    """The end of a fit: `z`, cost |r|^2, residuals [cluster, value] of each run, and their derivatives by z."""

    z: Reals
    cost: float
    left: list[Reals]
    jacobian: list[Reals]
    """[cluster, value, z] of each run."""
    prior: Reals
    responses: list[Response]
    converged: bool = False
    covariance: Reals = field(default_factory=lambda: np.zeros((0, 0)))


def sandwich(
    left: Sequence[Reals], jacobian: Sequence[Reals], prior: Reals, known: Sequence[bool] = (), on_the_way: bool = False
) -> Reals:
    """The covariance of z clustered by cycle. `known`: runs whose residuals have the error one.

    `on_the_way`: before a fit has ended. What all cycles of a run miss then counts for nothing, if it is most of the
    residual: it would make deviations so wide that every step seems small.
    """
    H, B, free, n = np.diag(prior), np.diag(prior), np.zeros((len(prior),) * 2), 0
    for i, (r, J) in enumerate(zip(left, jacobian)):
        information = np.einsum("jik,jil->kl", J, J)
        H = H + information
        far = on_the_way and len(r) * float((r.mean(axis=0) ** 2).sum()) > 0.5 * float((r**2).sum())
        if (known and known[i]) or (far and len(r) == 1):
            B = B + information
            n += r.size
            continue
        g = np.einsum("jik,ji->jk", J, r)
        g = g - g.mean(axis=0) if far else g
        free = free + g.T @ g
        n += len(g)
    A = inverse(H)
    return np.asarray(A @ (B + free * (n / max(n - len(prior), 1))) @ A)


def inverse(matrix: Reals) -> Reals:
    """The inverse of a symmetric matrix whose rows may differ in size."""
    scale = 1.0 / np.sqrt(np.maximum(np.diag(matrix), 1e-300))
    values, vectors = np.linalg.eigh(matrix * np.outer(scale, scale))
    values = np.maximum(values, 1e-15 * values[-1])
    return np.asarray((vectors / values) @ vectors.T * np.outer(scale, scale))


class Fit:
    """One least squares problem: the free parameters, runs by number, their offsets and residuals."""

    def __init__(
        self,
        free: Sequence[Free],
        evaluator: Evaluator,
        runs: Sequence[int],
        offsets: Offsets,
        blocks: Blocks,
        known: Sequence[bool] = (),
    ) -> None:
        self.free, self.evaluator, self.runs, self.offsets, self.blocks = free, evaluator, runs, offsets, blocks
        self.known = known
        ends = np.array([parameter.ends for parameter in free])
        self.low, self.high = ends.T
        spread = 0.5 * (self.high - self.low)
        self.prior = np.concatenate([spread**-2.0, np.full(len(offsets.names), 1e-12)])

    def values(self, z: Reals) -> list[float]:
        """The free parameters in SI."""
        return [parameter.value(c) for parameter, c in zip(self.free, z.tolist())]

    def left(self, z: Reals, responses: Sequence[Response]) -> list[Reals]:
        """The residuals of each run."""
        p = len(self.free)
        return [self.blocks(i, response, self.offsets.values(i, z[p:])) for i, response in enumerate(responses)]

    def cost(self, left: Sequence[Reals], z: Reals, z0: Reals) -> float:
        """The sum of squares."""
        return float(sum((r**2).sum() for r in left) + self.prior @ (z - z0) ** 2)

    def responses(self, points: Sequence[Reals]) -> list[list[Response] | str]:
        """The responses [point] of all runs, or why a run has none."""
        rows = self.evaluator.responses([self.values(z) for z in points], self.runs)
        return [whole(row) for row in rows]

    def jacobian(
        self, z: Reals, left: Sequence[Reals], responses: Sequence[Response], central: bool = False
    ) -> list[Reals]:
        """Derivatives of the residuals [cluster, value, z] of each run; a parameter without neighbours has zeros.

        `central`: differences to both sides. A covariance needs them: two parameters of which only the difference acts
        are one to first order in the step only.
        """
        p = len(self.free)
        steps = np.where(z[:p] + STEP > self.high, -STEP, STEP)
        points = [np.concatenate([z[:p] + steps[k] * (np.arange(p) == k), z[p:]]) for k in range(p)]
        rows = self.responses(points)
        columns = []
        for k, row in enumerate(rows):
            if isinstance(row, str):  # as mu_static, which must not be below mu_kinetic: from the other side
                steps[k] = -steps[k]
                points[k][k] = z[k] + steps[k]
                [row] = self.responses([points[k]])
            if isinstance(row, str):
                columns.append([np.zeros_like(r) for r in left])
                continue
            here = self.left(points[k], row)
            if central:
                other = z - (points[k] - z)
                if np.all((other[:p] >= self.low) & (other[:p] <= self.high)):
                    [back] = self.responses([other])
                    if not isinstance(back, str):
                        columns.append([0.5 * (a - b) / steps[k] for a, b in zip(here, self.left(other, back))])
                        continue
            columns.append([(a - b) / steps[k] for a, b in zip(here, left)])
        for k in range(p, len(z)):
            moved = z.copy()
            moved[k] += STEP
            columns.append([(a - b) / STEP for a, b in zip(self.left(moved, responses), left)])
        return [np.stack([column[i] for column in columns], axis=-1) for i in range(len(left))]

    def run(self, z0: Reals, rounds: int = ROUNDS, gain: float = 0.0, screening: bool = False) -> Solution | str:
        """Fit from `z0`, also until a round gains less than the share `gain`; the reason why it cannot begin.

        `screening`: the solution needs no covariance, which takes two responses for each parameter.
        """
        [first] = self.responses([z0])
        if isinstance(first, str):
            return first
        z, p = z0.copy(), len(self.free)
        responses: list[Response] = first
        left = self.left(z, responses)
        cost, damping, flat, apart = self.cost(left, z, z0), _DAMPING[0], False, np.inf
        for _ in range(rounds):
            J = self.jacobian(z, left, responses)
            H = np.diag(self.prior) + sum(np.einsum("jik,jil->kl", j, j) for j in J)
            g = self._slope(J, left) + self.prior * (z - z0)
            held = np.zeros(len(z), bool)
            held[:p] = ((z[:p] >= self.high) & (g[:p] < 0.0)) | ((z[:p] <= self.low) & (g[:p] > 0.0))
            sd = np.sqrt(np.maximum(np.diag(sandwich(left, J, self.prior, self.known, True)), 1e-300))
            apart = float(np.max(np.abs(self._step(H, g, 0.0, held)) / sd))
            if apart < _SETTLED:
                break
            moved = False
            while damping < _DAMPING[2]:
                step = self._step(H, g, damping, held)
                if apart > 1.0:
                    step = self._bent(z, step, J, left, H, damping, held)
                to = z + step
                to[:p] = np.clip(to[:p], self.low, self.high)
                reached = self.responses([to])[0]
                if not isinstance(reached, str):
                    to = self.levelled(to, reached)
                    after, there = self.left(to, reached), reached
                    new = self.cost(after, to, z0)
                    if new < cost:
                        moved = True
                        break
                damping *= _DAMPING[1]
            if not moved:
                break
            flat = cost - new < gain * cost
            z, left, responses, cost = to, after, there, new
            damping = max(damping / _DAMPING[1] ** 2, 1e-9)
            if flat:
                break
        done = flat or apart < _CONVERGED
        if screening:
            return Solution(z, cost, left, [], self.prior, responses, done)
        J = self.jacobian(z, left, responses, central=True)
        return Solution(z, cost, left, J, self.prior, responses, done, sandwich(left, J, self.prior, self.known))

    @staticmethod
    def _slope(J: Sequence[Reals], left: Sequence[Reals]) -> Reals:
        """J' r over all runs."""
        return np.asarray(sum(np.einsum("jik,ji->k", j, r) for j, r in zip(J, left)))

    def _bent(
        self, z: Reals, step: Reals, J: Sequence[Reals], left: Sequence[Reals], H: Reals, damping: float, held: Reals
    ) -> Reals:
        """A step that follows the bend of the valley: its second derivative, by one response on the way."""
        share, most = _BENT
        [way] = self.responses([z + share * step])
        if isinstance(way, str):
            return step
        there = self.left(z + share * step, way)
        bend = [2.0 / share * ((a - b) / share - j @ step) for a, b, j in zip(there, left, J)]
        more = self._step(H, self._slope(J, bend), damping, held)
        size = np.sqrt(np.diag(H))
        small = np.linalg.norm(size * more) < most * np.linalg.norm(size * step)
        return step + 0.5 * more if small else step

    def levelled(self, z: Reals, responses: Sequence[Response]) -> Reals:
        """The point with the best offsets: no response changes with them, and the rest is nearly linear in them."""
        p = len(self.free)
        if len(z) == p:
            return z
        left = np.concatenate([r.ravel() for r in self.left(z, responses)])
        columns = []
        for k in range(p, len(z)):
            moved = z + STEP * (np.arange(len(z)) == k)
            columns.append((np.concatenate([r.ravel() for r in self.left(moved, responses)]) - left) / STEP)
        made = z.copy()
        made[p:] -= np.linalg.lstsq(np.stack(columns, axis=1), left, rcond=None)[0]
        return made

    def _step(self, H: Reals, g: Reals, damping: float, held: Reals) -> Reals:
        """The step of the method; parameters that are `held` at an end of their range stay."""
        moving = np.logical_not(held)
        step = np.zeros(len(g))
        M = H[np.ix_(moving, moving)]
        M = M + damping * np.diag(np.diag(M))
        step[moving] = -inverse(M) @ g[moving]
        p = len(self.free)
        largest = float(np.abs(step[:p]).max(initial=0.0))
        return step * min(1.0, 0.7 / largest) if largest > 0.7 else step


def whole(row: Sequence[Response | str]) -> list[Response] | str:
    """The responses of all runs, or the first reason why one has none."""
    made = [response for response in row if not isinstance(response, str)]
    return made if len(made) == len(row) else next(why for why in row if isinstance(why, str))
