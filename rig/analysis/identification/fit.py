"""Least squares over responses, and the covariance of the parameters from independent cycles.

    minimise |r(z)|^2 + (z - z0)' P (z - z0)      z: coordinates of the free parameters, then offsets; z0: as stated
    C = A (sum_j g_j g_j') A n / (n - p),  A = (J'J + P)^-1,  g_j = sum over cycle j of J_i r_i

P is that of a standard deviation of half the range of each parameter: what the data do not tell stays at the value of
the scene, wherever the fit began. Intervals never follow from the number of samples. Levenberg and Marquardt's method;
the Jacobian has central differences of whole cycles, which are exact to rounding because events are. Differences to
one side lean along a flat direction: the fit would end where they are zero, and not where the sum of squares is least.

Keys that are nearly one leave a narrow valley. Most are sums, as of an offset and a level of friction: their valley is
straight in the values and bent in the logarithms, so that a step is straight in the values. It follows what bend is
left by its second derivative (geodesic acceleration), offsets are fitted anew at each of its ends, and a fit has ended
where the step without damping is small beside the deviations, not the last step.

Along a direction of which the data tell nothing, the derivatives are those of the errors of responses: small, but of
many samples, so that they seem to tell a value. There the sum of squares is computed at a distance. If it does not rise
as the derivatives say, they count for nothing, and only the ranges limit the parameters along it.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from rig.analysis.identification.responses import Evaluator, Response
from rig.analysis.identification.runs import FREE, NONE, Free, Measured
from rig.record.run import Reals

STEP = 5e-3
"""Difference of a coordinate for the Jacobian: about the cube root of the relative error of responses, 1e-7.

A shorter one makes their errors a slope along flat directions, which then seem to be told.
"""
ROUNDS = 40
"""Of a fit, at most."""
_DAMPING = 1e-3  # at the begin
_DAMPED = 10.0  # factor of the damping after a step that does not help
_OVERDAMPED = 1e6  # where no step helps
_SETTLED = 0.05  # of a standard deviation: step without damping at which a fit ends
_CONVERGED = 0.2  # of a standard deviation: step without damping of a fit that has converged
_WEAKEST = 1e-4  # of the information of a direction over that of the best one: responses may have errors as large
_PROBED = 1000.0  # times the smallest gain that responses can tell: their own errors make a twentieth of it
_RISES = 0.25  # of the rise that derivatives predict: of less, an interval is half as wide as it should be
_CORRECTED = 3  # steps that lead back to the valley, beside which it is probed
_NEAR = 2.0  # of a standard deviation: step without damping that gains nothing, of a fit that has converged
_SAME = 1e-6  # of the sum of squares: responses cannot tell a smaller gain, and steps along it lead nowhere
WIDE = 0.3
"""Of a value: an interval of 90 % that reaches farther to one side is wide."""
_LONGEST = 0.7  # of a coordinate that a step changes at most: a factor of two
_LEAST = -0.8  # of a value that a step takes away at most
_BENT = 0.1  # share of a step for its second derivative
_MOST_BENT = 0.75  # largest bend beside the step
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
        for run, of_run in zip(runs, sizes):
            row = []
            for column, size in zip(run.columns, of_run):
                if column.offset == NONE:
                    row.append(-1)
                    continue
                name = f"offset of {column.name}"
                if column.offset != FREE:
                    name = f"{name} in {run.name}"
                names.setdefault(name, float(size))
                row.append([*names].index(name))
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
    flat: tuple[bool, ...] = ()
    """Of each parameter: whether the sum of squares does not change along it, and the start decides its value."""
    covariance: Reals = field(default_factory=lambda: np.zeros((0, 0)))


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
        self.free = free
        self.evaluator = evaluator
        self.runs = runs
        self.offsets = offsets
        self.blocks = blocks
        self.known = known
        ends = np.array([parameter.ends for parameter in free])
        self.low, self.high = ends.T
        spread = 0.5 * (self.high - self.low)
        self.prior = np.concatenate([spread**-2.0, np.full(len(offsets.names), 1e-12)])
        self.stated = np.zeros(len(self.prior))
        self.stated[: len(free)] = [parameter.coordinate(parameter.stated) for parameter in free]
        self.logs = np.zeros(len(self.prior), bool)
        self.logs[: len(free)] = [parameter.log for parameter in free]

    def values(self, z: Reals) -> list[float]:
        """The free parameters in SI."""
        return [parameter.value(c) for parameter, c in zip(self.free, z.tolist())]

    def left(self, z: Reals, responses: Sequence[Response]) -> list[Reals]:
        """The residuals of each run."""
        p = len(self.free)
        return [self.blocks(i, response, self.offsets.values(i, z[p:])) for i, response in enumerate(responses)]

    def cost(self, left: Sequence[Reals], z: Reals) -> float:
        """The sum of squares."""
        return float(sum((r**2).sum() for r in left) + self.prior @ (z - self.stated) ** 2)

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
            ahead = self.left(points[k], row)
            back = self._back(z, points[k]) if central else None
            if back is not None:
                columns.append([0.5 * (a - b) / steps[k] for a, b in zip(ahead, back)])
            else:
                columns.append([(a - b) / steps[k] for a, b in zip(ahead, left)])
        for k in range(p, len(z)):
            moved = z.copy()
            moved[k] += STEP
            columns.append([(a - b) / STEP for a, b in zip(self.left(moved, responses), left)])
        return [np.stack(of_run, axis=-1) for of_run in zip(*columns, strict=True)]

    def _back(self, z: Reals, point: Reals) -> list[Reals] | None:
        """The residuals at the other side of `z` than `point`; None outside of the ranges, or without a response."""
        p = len(self.free)
        other = z - (point - z)
        if not np.all((other[:p] >= self.low) & (other[:p] <= self.high)):
            return None
        [responses] = self.responses([other])
        return None if isinstance(responses, str) else self.left(other, responses)

    def run(self, z0: Reals, rounds: int = ROUNDS, gain: float = 0.0, screening: bool = False) -> Solution | str:
        """Fit from `z0`, also until a round gains less than the share `gain`; the reason why it cannot begin.

        `screening`: differences to one side will do, and the solution needs no covariance.
        """
        [first] = self.responses([z0])
        if isinstance(first, str):
            return first
        z = z0.copy()
        p = len(self.free)
        responses: list[Response] = first
        left = self.left(z, responses)
        cost = self.cost(left, z)
        damping = _DAMPING
        done = False
        flat = np.zeros(p, bool)
        missing = np.zeros(len(z0))
        J = self.jacobian(z, left, responses, not screening)
        stalled = False
        for _ in range(rounds):
            H, g, held = self._equations(z, left, J)
            C = sandwich(left, J, self.prior, self.known, True)
            sd = np.sqrt(np.maximum(np.diag(C), 1e-300))
            missing = np.abs(self._step(H, g, 0.0, held)) / sd
            apart = float(missing.max())
            flat = missing[:p] >= _CONVERGED
            reach = NORMAL * sd[:p] * np.sqrt(1.0 + missing[:p] ** 2)
            done = not flat.any() or (stalled and bool(np.all(reach[flat] > np.log1p(WIDE))))
            if apart < _SETTLED or stalled:
                break
            moved = False
            while damping < _OVERDAMPED:
                step = self._step(H, g, damping, held)
                if apart > 1.0:
                    step = self._bent(z, step, J, left, H, damping, held)
                to = self.moved(z, step)
                reached = self.responses([to])[0]
                if not isinstance(reached, str):
                    to = self.levelled(to, reached)
                    after = self.left(to, reached)
                    responses_after = reached
                    new = self.cost(after, to)
                    if new < cost:
                        moved = True
                        break
                damping *= _DAMPED
            if not moved:
                stalled = True
                continue
            small = cost - new < gain * cost
            stalled = cost - new < _SAME * cost
            z = to
            left = after
            responses = responses_after
            cost = new
            damping = max(damping / _DAMPED**2, 1e-9)
            done |= small
            if small and screening:
                break
            J = self.jacobian(z, left, responses, not screening)
            if small:
                break
        if screening:
            return Solution(z, cost, left, J, self.prior, responses, done, tuple(flat.tolist()))
        J, untold = self._told(z, left, J)
        if untold.any():
            H, g, held = self._equations(z, left, J)
            sd = np.sqrt(np.diag(sandwich(left, J, self.prior, self.known, True)))
            missing = np.abs(self._step(H, g, 0.0, held)) / sd
            done = bool(np.all((missing[:p] < _CONVERGED) | untold))
        elif stalled:  # the sum of squares rises on both sides: the least one is no farther away than the step
            done = done or apart < _NEAR
        C = sandwich(left, J, self.prior, self.known)
        if stalled and done and not untold.any():  # least squares may lie as far away as the step that gained nothing
            wider = np.sqrt(1.0 + np.where(missing >= _CONVERGED, missing, 0.0) ** 2)
            C = C * np.outer(wider, wider)
        return Solution(z, cost, left, J, self.prior, responses, done, tuple(untold.tolist()), C)

    def _told(self, z: Reals, left: Sequence[Reals], J: Sequence[Reals]) -> tuple[list[Reals], Any]:
        """Derivatives without those along directions of which the data tell nothing, and which parameters these move
        by more than a wide interval within the ranges.
        """
        p = len(self.free)
        H = np.asarray(sum(np.einsum("jik,jil->kl", j, j) for j in J))
        size = np.sqrt(np.maximum(np.diag(H), 1e-300))
        shares, directions = np.linalg.eigh(H / np.outer(size, size))
        kept = list(J)
        untold = np.zeros(p, bool)
        for share, direction in zip(shares, directions.T):
            if share > _WEAKEST * shares[-1]:
                break
            along = direction / size
            if self._rises(z, along, size * direction, left, J, H):
                continue
            kept = [j - (j @ along)[..., None] * (size * direction) for j in kept]
            range_alone = 1.0 / np.sqrt(float(self.prior @ along**2))
            untold |= NORMAL * range_alone * np.abs(along[:p]) > np.log1p(WIDE)
        return kept, untold

    def _rises(
        self, z: Reals, along: Reals, across: Reals, left: Sequence[Reals], J: Sequence[Reals], H: Reals
    ) -> bool:
        """Whether the sum of squares rises to both sides along a direction as its derivatives say.

        `across`: the row that is one along it, and zero along the other directions.
        """
        p = len(self.free)
        here = sum(float((r**2).sum()) for r in left)
        bend = float(along @ H @ along)
        farthest = np.log1p(WIDE) / max(float(np.abs(along[:p]).max()), 1e-300)
        distance = min(farthest, float(np.sqrt(_PROBED * _SAME * here / max(bend, 1e-300))))
        predicted = bend * distance**2
        if predicted < _SAME * here:
            return False
        back = inverse(H + np.diag(self.prior))
        for side in (-distance, distance):
            to = self.moved(z, side * along)
            there = self._sum(to)
            for _ in range(_CORRECTED if there is not None else 0):
                assert there is not None
                squares, at, residuals = there
                if squares - here < _RISES * predicted:
                    return False
                step = -back @ self._slope(J, residuals)
                corrected = self._sum(self.moved(at, step - along * float(across @ step)))
                if corrected is None or corrected[0] >= squares:
                    break
                there = corrected
            if there is not None and there[0] - here < _RISES * predicted:
                return False
        return True

    def _sum(self, z: Reals) -> tuple[float, Reals, list[Reals]] | None:
        """The sum of squares of the residuals with the best offsets, the point with these, and the residuals; None
        without a response.
        """
        [responses] = self.responses([z])
        if isinstance(responses, str):
            return None
        z = self.levelled(z, responses)
        left = self.left(z, responses)
        return sum(float((r**2).sum()) for r in left), z, left

    def _equations(self, z: Reals, left: Sequence[Reals], J: Sequence[Reals]) -> tuple[Reals, Reals, Reals]:
        """Matrix and slope of the normal equations, and which parameters the ends of their ranges hold."""
        p = len(self.free)
        H = np.diag(self.prior) + sum(np.einsum("jik,jil->kl", j, j) for j in J)
        g = self._slope(J, left) + self.prior * (z - self.stated)
        held = np.zeros(len(z), bool)
        at_high = (z[:p] >= self.high) & (g[:p] < 0.0)
        at_low = (z[:p] <= self.low) & (g[:p] > 0.0)
        held[:p] = at_high | at_low
        return H, g, held

    def moved(self, z: Reals, step: Reals) -> Reals:
        """The point after a step from `z` that is straight in the values, within the ranges."""
        to = np.where(self.logs, z + np.log1p(np.maximum(step, _LEAST)), z + step)
        p = len(self.free)
        to[:p] = np.clip(to[:p], self.low, self.high)
        return to

    @staticmethod
    def _slope(J: Sequence[Reals], left: Sequence[Reals]) -> Reals:
        """J' r over all runs."""
        return np.asarray(sum(np.einsum("jik,ji->k", j, r) for j, r in zip(J, left)))

    def _bent(
        self, z: Reals, step: Reals, J: Sequence[Reals], left: Sequence[Reals], H: Reals, damping: float, held: Reals
    ) -> Reals:
        """A step that follows the bend of the valley: its second derivative, by one response on the way."""
        to = self.moved(z, _BENT * step)
        [way] = self.responses([to])
        if isinstance(way, str):
            return step
        on_the_way = self.left(to, way)
        bend = [2.0 / _BENT * ((a - b) / _BENT - j @ step) for a, b, j in zip(on_the_way, left, J)]
        more = self._step(H, self._slope(J, bend), damping, held)
        size = np.sqrt(np.diag(H))
        small = np.linalg.norm(size * more) < _MOST_BENT * np.linalg.norm(size * step)
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
            left_there = np.concatenate([r.ravel() for r in self.left(moved, responses)])
            columns.append((left_there - left) / STEP)
        levelled = z.copy()
        levelled[p:] -= np.linalg.lstsq(np.stack(columns, axis=1), left, rcond=None)[0]
        return levelled

    def _step(self, H: Reals, g: Reals, damping: float, held: Reals) -> Reals:
        """The step of the method; parameters that are `held` at an end of their range stay."""
        moving = np.logical_not(held)
        step = np.zeros(len(g))
        M = H[np.ix_(moving, moving)]
        M = M + damping * np.diag(np.diag(M))
        step[moving] = -inverse(M) @ g[moving]
        p = len(self.free)
        largest = float(np.abs(step[:p]).max(initial=0.0))
        return step * min(1.0, _LONGEST / largest) if largest > _LONGEST else step


def sandwich(
    left: Sequence[Reals], jacobian: Sequence[Reals], prior: Reals, known: Sequence[bool] = (), on_the_way: bool = False
) -> Reals:
    """The covariance of z clustered by cycle. `known`: runs whose residuals have the error one.

    `on_the_way`: before a fit has ended. What all cycles of a run miss then counts for nothing, if it is most of the
    residual: it would make deviations so wide that every step seems small.
    """
    H = np.diag(prior)
    B = np.diag(prior)
    free = np.zeros((len(prior),) * 2)
    n = 0
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


def whole(row: Sequence[Response | str]) -> list[Response] | str:
    """The responses of all runs, or the first reason why one has none."""
    for why in row:
        if isinstance(why, str):
            return why
    return [response for response in row if not isinstance(response, str)]
