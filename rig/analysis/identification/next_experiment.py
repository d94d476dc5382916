"""The experiment that would shrink the intervals most, among settings that the rig can have.

Each candidate is simulated at the parameters that were found, with the process noise of the runs, and enters the same
covariance as a further run: intervals are predicted for the method that fits. The best has the smallest determinant of
the covariance of the parameters. To shrink only the widest interval leaves others wide.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, replace
from functools import partial
from itertools import product
from typing import Any

import numpy as np

from rig.analysis.identification.answer import Identified, LawFit
from rig.analysis.identification.cycles import (
    EXACT,
    LASTING,
    LEAST,
    CycleRun,
    measure_blocks,
    measure_weights,
)
from rig.analysis.identification.fit import Fit, Offsets, inverse
from rig.analysis.identification.responses import Evaluator, Responder, Response, cycle_response
from rig.analysis.identification.slips import MEASURES
from rig.analysis.identification.twins import SEED, on_cycle, simulated
from rig.analysis.pool import Arrays, Work, carry_out, temporary
from rig.analysis.studies.factors import Factor, factors
from rig.errors import NumericsError, RigError, UsageError
from rig.record.run import Reals
from rig.results import Column, Result, Table
from rig.scenes.belief import varied
from rig.scenes.scene import Scene

_LONGER = 4.0
"""Duration of the simulation of a candidate, over that of the runs: its scores are means over more cycles."""
_SHOWN = 5  # proposals, the best ones


@dataclass(frozen=True)
class Proposal(Result):
    """Settings of a run, predicted intervals (half widths relative to the values), and the log determinant."""

    settings: dict[str, tuple[float, str]]
    widths: dict[str, float]
    now: dict[str, float]
    determinant: float
    seconds: float

    def shown(self) -> Iterator[str | Table]:
        """Yield the settings and the intervals."""
        settings = []
        for key, (value, unit) in self.settings.items():
            text = f"{key} = {value:.4g}"
            settings.append(text if unit == "1" else f"{text} {unit}")
        yield f"next: {', '.join(settings)}, {self.seconds:.3g} s; half of the interval of 90 %:"
        numbers = (Column(name, "1", ".3g", "%", 0.01) for name in ("now", "predicted"))
        rows = [(key, self.now[key], width) for key, width in self.widths.items()]
        yield Table("intervals", (Column("parameter"), *numbers), rows)

    def facts(self) -> dict[str, Any]:
        """Return settings and intervals."""
        settings = {key: value for key, (value, _) in self.settings.items()}
        return {"settings": settings, "widths": self.widths, "now": self.now, "seconds": self.seconds}


@dataclass(frozen=True)
class Prediction:
    """The covariance with a further run at settings, by the method that fits."""

    fit: LawFit

    @property
    def seconds(self) -> float:
        """Duration of the further run [s]."""
        return float(np.mean([run.evidence.run.seconds for run in self.fit.runs]))

    def compute(self, settings: Mapping[str, float]) -> Arrays:
        """The covariance with a run at `settings`, or why there is none."""
        fit = self.fit
        like: CycleRun = fit.runs[0].evidence
        whole = like.run.settings | dict(settings)
        values = [f.value(c) for f, c in zip(fit.law.free, fit.z.tolist())]
        free = {f.key: value for f, value in zip(fit.law.free, values)}
        try:
            scene = varied(fit.law.scene, whole | free)
            run = replace(like.run, settings=whole)
            twin = simulated(on_cycle(scene), run, like.sigma, fit.density, _LONGER * self.seconds, SEED)
            responder = Responder(fit.law, (twin,), cycle_response)
            with Evaluator(responder, None, 1) as evaluator:
                [[response]] = evaluator.responses([values], [0])
                if isinstance(response, str):
                    return {"why": np.array(response)}
                covariance = self._with(CycleRun.of(twin, response), response, evaluator)
                return {"why": np.array(""), "covariance": covariance}
        except (RigError, NumericsError) as fault:
            return {"why": np.array(str(fault)[:300])}

    def _with(self, evidence: CycleRun, response: Response, evaluator: Evaluator) -> Reals:
        """The covariance with a further run."""
        fit = self.fit
        p = len(fit.law.free)
        offsets = Offsets.of([evidence.run], [fit.offsets.sizes[:1] or (1.0,)])
        names = list(fit.offsets.names)
        z = np.concatenate([fit.z[:p], np.zeros(len(offsets.names))])  # a twin has none
        if fit.repeats:
            problem = Fit(fit.law.free, evaluator, [0], offsets, lambda i, w, o: evidence.left(w, o))
        else:
            problem = self._measures(evidence, response, evaluator, offsets)
        left = problem.left(z, [response])
        [J] = problem.jacobian(z, left, [response], central=True)
        left = [r - r.mean(axis=0) for r in left] if fit.repeats else left  # a fit expects their mean
        total = len(fit.z) + sum(name not in names for name in offsets.names)
        place = [*range(p)]
        for name in offsets.names:
            place.append(p + names.index(name) if name in names else len(fit.z))
        wide = np.zeros((*J.shape[:2], total))
        wide[..., place] = J
        prior = np.concatenate([problem.prior[:p], np.full(total - p, 1e-12)])
        share = self.seconds / evidence.run.seconds if fit.repeats else 1.0
        H = np.diag(prior)
        B = np.diag(prior)
        clusters = 0.0
        padded = [np.pad(each, ((0, 0), (0, 0), (0, total - each.shape[-1]))) for each in fit.jacobian]
        runs = [(run.left, each, 1.0) for run, each in zip(fit.runs, padded)]
        runs.append((left[0], wide, share))
        for run_left, run_J, weight in runs:
            H = H + weight * np.einsum("jik,jil->kl", run_J, run_J)
            g = np.einsum("jik,ji->jk", run_J, run_left)
            B = B + weight * g.T @ g
            clusters += weight * len(g)
        A = inverse(H)
        if not fit.repeats:
            return A
        return np.asarray(A @ B @ A * (clusters / max(clusters - total, 1.0)))

    def _measures(self, evidence: CycleRun, response: Response, evaluator: Evaluator, offsets: Offsets) -> Fit:
        """The fit of measures, with the deviation between runs and the mean error of the fitted runs."""
        errors = np.mean([run.evidence.covariance(SEED) for run in self.fit.runs], axis=0)
        C = errors + np.diag(self.fit.deviation**2)
        read = evidence.model_measures(response)
        evidence = evidence if read is None else replace(evidence, measures=np.tile(read, (LEAST, 1)))
        weights = [measure_weights(evidence, C, LASTING, EXACT)]
        blocks = partial(measure_blocks, [evidence], weights, [np.zeros(len(MEASURES))], LASTING)
        return Fit(self.fit.law.free, evaluator, [0], offsets, blocks)


def asked(text: str) -> dict[str, str]:
    """The settings of "drive.speed=0.05 m/s:0.3 m/s:5, load.force=8 N, 16 N": key -> values. Raises UsageError."""
    settings = {}
    for part in re.split(r",\s*(?=[A-Za-z_][\w.]*\s*=)", text):
        key, equals, values = (piece.strip() for piece in part.partition("="))
        if not equals or not values:
            raise UsageError(f'--next {part}: expected KEY=VALUES, such as "drive.speed=0.05 m/s:0.3 m/s:5"')
        settings[key] = values
    return settings


def settings_of(scene: Scene, over: Mapping[str, Any]) -> tuple[Factor, ...]:
    """Return the settings that `over` names, which are read before a fit. Raises SceneError, UsageError."""
    axes = factors(scene, over)
    for factor in axes:
        if factor.distribution is not None:
            raise UsageError(f"--next {factor.key}: expected values or FROM:TO:COUNT, no distribution")
        if idle := factor.axis.idle(scene):
            raise UsageError(f"--next {idle}")
    return axes


def propose(
    identified: Identified,
    over: Mapping[str, Any],
    workers: int | None = None,
    progress: Callable[[int, int], object] = lambda done, total: None,
) -> Identified:
    """The result with proposals, the best first. Raises UsageError for settings that are none, or without a fit."""
    best = identified.best
    if not best.fits:
        raise UsageError("no next experiment is proposed: no law fits, so that no interval can be predicted")
    if not best.converged:
        raise UsageError("no next experiment is proposed: the fit has not converged, so that it has no interval")
    if not all(isinstance(run.evidence, CycleRun) for run in best.runs):
        raise UsageError("no next experiment is proposed: this is done for runs of cycles only")
    axes = settings_of(best.law.scene, over)
    keys = [factor.key for factor in axes]
    grid = product(*(factor.axis.values for factor in axes))
    settings = [dict(zip(keys, values)) for values in grid]
    units = {factor.key: factor.axis.unit for factor in axes}
    prediction = Prediction(best)
    work = Work(prediction.compute, settings, best.law.scene.name)
    with temporary(work) as store:
        rows = carry_out(work, store, workers, progress)
    proposals = []
    p = len(best.law.free)
    now = widths(best, best.covariance)
    for i, point in enumerate(settings):
        row = rows[i]
        if "covariance" in row:
            C = row["covariance"]
            determinant = float(np.linalg.slogdet(C[:p, :p])[1])
            with_units = {key: (value, units[key]) for key, value in point.items()}
            proposals.append(Proposal(with_units, widths(best, C), now, determinant, prediction.seconds))
    if not proposals:
        raise UsageError(f"--next: the rig has no limit cycle at any of these settings: {rows[0]['why']}")
    proposals.sort(key=lambda proposal: proposal.determinant)
    return replace(identified, proposals=tuple(proposals[:_SHOWN]))


def widths(fit: LawFit, covariance: Reals) -> dict[str, float]:
    """Half of the interval of each parameter over its value."""
    return {free.key: fit.half(i, covariance) for i, free in enumerate(fit.law.free)}
