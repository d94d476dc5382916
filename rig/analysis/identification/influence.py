"""What the data cannot tell apart: parameters that act like others, and fixed values that would help if they were free.

A fixed value is varied too. Where its effect is that of the free parameters together, it cannot be told beside them.
Otherwise its score tells how much of the misfit it would take away if it were free.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from rig.analysis.identification.fit import STEP, Fit, Solution, inverse, whole
from rig.analysis.identification.responses import Evaluator
from rig.analysis.identification.runs import Law, Measured
from rig.record.run import Reals
from rig.scenes.axis import sweepable

_TABLES = ("start", "noise")  # of a scene, which no fit varies
_MOST = 12  # candidates: each costs a response of every run
_ALIKE = 0.005  # of the square of an effect: what is left of one that others have too
_ALIKE_ON_MEASURES = 0.1  # the same of an effect on measures, which are few
_TAKES = 0.05  # share of a coordinate


@dataclass(frozen=True)
class Influence:
    """A fixed value: `left`, the share of its effect that no free parameter has; `others`, those that act as it does,
    with the change of each for one of it (logarithms).

    `gain`: share of the sum of squares that it would take away if it were free; `change`: by which factor it would
    change; `score`: that gain over what chance alone gives, in standard deviations.
    """

    key: str
    left: float
    others: tuple[tuple[str, float], ...]
    gain: float
    change: float
    score: float
    told: bool
    """Whether the data could tell it beside the free parameters."""


def candidates(law: Law, runs: Sequence[Measured]) -> tuple[str, ...]:
    """The fixed numbers of the rig that may be varied: not zero, not free, of no start and no noise."""
    values = law.scene.values()
    free = {f.key for f in law.free}
    kept = []
    for key, _ in sweepable(law.scene.parameters):
        value = runs[0].settings.get(key, values.get(key, (None, ""))[0])
        if key in free or key.partition(".")[0] in _TABLES or not isinstance(value, float) or value == 0.0:
            continue
        kept.append(key)
    first = ("body.", "load.", "drive.", "friction.")
    return tuple(sorted(kept, key=lambda key: not key.startswith(first))[:_MOST])


def influence(fit: Fit, solution: Solution, evaluator: Evaluator, repeats: bool) -> tuple[Influence, ...]:
    """The influence of each candidate on a solution."""
    keys = evaluator.responder.candidates
    values = fit.values(solution.z)
    count = len(keys)
    points = [[*values, *(1.0 + STEP * (np.arange(count) == k))] for k in range(count)]
    rows = evaluator.responses(points, fit.runs)
    r = np.concatenate([left.ravel() for left in solution.left])
    J = np.concatenate([j.reshape(-1, j.shape[-1]) for j in solution.jacobian])
    clusters = np.concatenate([np.full(left.size, 1) for left in solution.left])
    H = inverse(J.T @ J + np.diag(solution.prior))
    names = [f.key for f in fit.free] + list(fit.offsets.names)
    influences = []
    for key, row in zip(keys, rows):
        responses = whole(row)
        if isinstance(responses, str):
            continue
        moved = np.concatenate([left.ravel() for left in fit.left(solution.z, responses)])
        effect = (moved - r) / STEP
        square = float(effect @ effect)
        if square < 1e-6 * float(clusters.sum()):
            continue  # of no influence at all
        by = H @ (J.T @ effect)
        rest = effect - J @ by
        left = float(rest @ rest) / square
        most = _ALIKE if repeats else _ALIKE_ON_MEASURES
        if left <= most and not repeats:  # measures are few: many changes explain an effect
            by = _simplest(J, effect, min(1.2 * left, most) * square, len(fit.free))
        alike = tuple((name, float(-c)) for name, c in zip(names, by) if abs(c) > _TAKES and "offset" not in name)
        across = float(rest @ r)
        gain = across**2 / max(float(rest @ rest) * float(r @ r), 1e-300)
        change = -across / max(float(rest @ rest), 1e-300)
        spread = np.sqrt(max(_spread(rest, r, solution.left), 1e-300))
        influences.append(Influence(key, left, alike, gain, change, abs(across) / spread, left > most))
    return tuple(influences)


def _simplest(J: Reals, effect: Reals, most: float, free: int) -> Reals:
    """The smallest changes of the `free` parameters that leave at most the square `most` of an effect."""
    information = J.T @ J
    by = np.zeros(J.shape[1])
    held = np.diag((np.arange(len(information)) < free).astype(float))
    for size in float(np.trace(information[:free, :free])) * 10.0 ** np.arange(0.0, -12.0, -0.5):
        damped = information + size * held + 1e-12 * np.eye(len(information))
        by = inverse(damped) @ (J.T @ effect)
        if float(((effect - J @ by) ** 2).sum()) <= most:
            break
    return np.asarray(by)


def _spread(rest: Reals, r: Reals, left: Sequence[Reals]) -> float:
    """The variance of a score, from its sums over cycles."""
    total = 0.0
    begin = 0
    for block in left:
        end = begin + block.size
        sums = (rest[begin:end] * r[begin:end]).reshape(block.shape).sum(axis=1)
        total += float(((sums - sums.mean()) ** 2).sum()) if len(sums) > 1 else float((sums**2).sum())
        begin = end
    return total
