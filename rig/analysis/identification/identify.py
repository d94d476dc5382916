"""The way from recordings to parameters: start and screen by measures of cycles, then fit cycle by cycle.

Where cycles repeat, they are fitted sample by sample with a free shift (`cycles`), and the covariance is clustered by
cycle. Where they do not (periods scatter by more than 5 %), their measures are fitted: with a bootstrap over blocks of
cycles, an offset for each record, and a deviation between runs, so that their chi-squared is as large as expected.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
from scipy import stats

from rig.analysis.identification import cycles
from rig.analysis.identification.answer import MISFIT, Identified, LawFit, RunFit
from rig.analysis.identification.cycles import (
    EXACT,
    LASTING,
    SCREEN,
    CycleRun,
    combined,
    measure_blocks,
    measure_weights,
)
from rig.analysis.identification.features import WINDOWS, FeatureRun, respond
from rig.analysis.identification.fit import ROUNDS, Fit, Offsets, Solution, inverse, whole
from rig.analysis.identification.influence import candidates, influence
from rig.analysis.identification.posterior import START, Posterior
from rig.analysis.identification.responses import Evaluator, Responder, Response
from rig.analysis.identification.runs import RUN, TRANSIENT, Law, Task
from rig.analysis.identification.slips import MEASURES
from rig.analysis.identification.twins import SEED, expecting, mean_left
from rig.analysis.pool import Arrays
from rig.errors import UsageError
from rig.record.run import Reals

_SCREENED = 0.01  # of a measure: what the screening may miss, since a fit of the cycles follows
_NEAR = 2.0  # factor about the values of the scene in which other starts lie
_WIDELY = 24  # starts after a misfit
_VALLEYS = 3  # of them that are fitted
_SAME = 0.1  # coordinates up to which two starts are in one valley
_ROUGH = 1e-3  # of the sum of squares: a smaller gain of a round ends a fit that only looks for a valley
_FEW = 10  # rounds of such a fit
_CLEARLY = 1e-12  # probability of a misfit that no better fit and no noise of the twins takes away
_OUTLIER = 5.0  # times the median of the rms of the cycles
_ROUNDS = 6  # of a fit of measures, from which cycles are fitted or draws are made
_NOISY = 2  # fits with what noise adds at the end of the one before
_MOVED = 0.5  # standard deviations by which such a fit moves and needs another
_USUAL = 16  # rounds of all fits of a law
_FLAT = 3e-3  # of the sum of squares of measures: a smaller gain ends a fit
Progress = Callable[[int], object]


def identify(
    task: Task, folder: Path | None = None, workers: int | None = None, progress: Progress = lambda done: None
) -> Identified:
    """Fit every law of a task to its runs. Raises UsageError for runs that cannot be used, WorkerError."""
    fits = []
    done = 0
    for law in task.laws:
        fits.append(_law(task, law, folder, workers, lambda count, done=done: progress(done + count)))  # type: ignore[misc]
        done += fits[-1].evaluations
    return Identified.of(task, fits)


def usual(task: Task) -> int:
    """How many evaluations the fits of a task usually take; a law that does not fit takes more."""
    runs = sum(run.fitted for run in task.runs)
    rounds = 0
    for law in task.laws:
        rounds += task.starts + _USUAL * (2 * len(law.free) + 2) + len(candidates(law, task.runs))
    return runs * rounds


def _law(task: Task, law: Law, folder: Path | None, workers: int | None, progress: Progress) -> LawFit:
    responder = Responder(law, task.runs, respond, task.seed, candidates(law, task.runs), mean_left)
    with Evaluator(responder, folder, workers) as evaluator:
        evaluator.progress = progress
        return _Attempt(task, law, evaluator).run()


@dataclass
class _Attempt:
    """The fit of one law."""

    task: Task
    law: Law
    evaluator: Evaluator

    def run(self) -> LawFit:
        """Start, screen, fit, judge."""
        notes: list[str] = []
        fitted = [i for i, run in enumerate(self.task.runs) if run.fitted]
        starts, first = self._starts(fitted, notes, self.task.starts)
        measured = [self.task.runs[i] for i in fitted]
        evidence: list[Any] = [
            CycleRun.of(run, response) if run.kind == "cycles" else FeatureRun.of(run, self.law.scene)
            for run, response in zip(measured, first)
        ]
        notes += [line for each in evidence if isinstance(each, CycleRun) for line in each.words()]
        repeats = all(each.scatter < cycles.REPEATS for each in evidence)
        if not repeats:
            evidence = [_with_offsets(each) if isinstance(each, CycleRun) else each for each in evidence]
            worst = max(evidence, key=lambda each: each.scatter)
            notes.append(
                f"the cycles do not repeat (the period scatters by {100.0 * worst.scatter:.2g} % in {worst.run.name}): "
                "their measures are fitted, with an offset of each record and a deviation between runs"
            )
        runs = [each.run for each in evidence]
        offsets = Offsets.of(runs, [_sizes(each) for each in evidence])
        [z] = self._screen(starts, evidence, offsets, fitted, 1)
        density = 0.0
        posterior: Posterior | None = None
        if not repeats:
            fit, solution, posterior = self._measures(z, evidence, offsets, fitted)
        else:
            cycles_alone = all(isinstance(each, CycleRun) for each in evidence)
            rough = _ROUGH if cycles_alone else 0.0
            fit, solution = self._valley(z, evidence, offsets, fitted, rough)
            gain = rough if _p(evidence, solution, repeats) < _CLEARLY else 0.0
            if rough:
                fit, solution = self._cycles(solution.z, evidence, offsets, fitted, gain)
            kept = _without_outliers(evidence, solution)
            if kept is not None:
                evidence = kept
                fit, solution = self._cycles(solution.z, evidence, offsets, fitted, gain)
            for share in dict.fromkeys((gain, 0.0)):  # the second where what noise adds to the cycles was the misfit
                if cycles_alone:
                    found = self._expecting(evidence, fit, solution, offsets, fitted, notes, share)
                    evidence, fit, solution, density = found
                if _p(evidence, solution, repeats) < _CLEARLY:
                    break
        p = _p(evidence, solution, repeats)
        too_few = "" if posterior is None else posterior.words()
        if too_few:
            notes.append(too_few)
        if not solution.converged:
            notes.append("the fit has not converged: its intervals are not to be trusted; state values nearer to it")
        of_runs = zip(evidence, solution.left, solution.responses)
        reports = [self._report(each, left, response, repeats) for each, left, response in of_runs]
        effects = influence(fit, solution, self.evaluator, repeats)
        predicted = self._predicted(fit, solution, posterior)
        deviation = np.zeros(len(MEASURES)) if posterior is None else posterior.deviation
        return LawFit(
            self.law,
            solution.z,
            solution.covariance,
            offsets,
            repeats,
            solution.converged,
            p,
            solution.cost,
            reports,
            predicted,
            deviation,
            effects,
            tuple(notes),
            self.evaluator.count,
            solution.jacobian,
            density,
            solution.flat,
        )

    def _valley(
        self, z: Reals, evidence: list[Any], offsets: Offsets, fitted: Sequence[int], rough: float
    ) -> tuple[Fit, Solution]:
        """A rough fit cycle by cycle; after a misfit the best of others, too, from starts that lie farther away."""
        rounds = _FEW if rough else ROUNDS
        fit, solution = self._cycles(z, evidence, offsets, fitted, rough, rounds)
        drifts = any(isinstance(each, CycleRun) and each.drift for each in evidence)
        if drifts or _p(evidence, solution, True) >= MISFIT:  # no start helps against cycles that change
            return fit, solution
        starts, _ = self._starts(fitted, [], _WIDELY)  # a wrong law, or a valley far from the answer
        for other_z in self._screen(starts, evidence, offsets, fitted, _VALLEYS):
            if np.all(np.abs(other_z - solution.z)[: len(self.law.free)] < _SAME):
                continue
            other_fit, other = self._cycles(other_z, evidence, offsets, fitted, rough, rounds)
            if other.cost < solution.cost:
                fit = other_fit
                solution = other
            if _p(evidence, solution, True) >= MISFIT:
                break
        return fit, solution

    def _starts(self, fitted: Sequence[int], notes: list[str], count: int) -> tuple[list[Reals], list[Response]]:
        """Coordinates of the free parameters at which all runs have a cycle, the values of the scene first if they do,
        then of `count` others, and the responses at the first. Raises UsageError, which says why there are none.
        """
        from scipy.stats import qmc

        free = self.law.free
        ends = np.array([f.ends for f in free])
        at = np.array([f.coordinate(f.stated) for f in free])
        hypercube = qmc.LatinHypercube(len(free), rng=np.random.default_rng(self.task.seed))
        shares = hypercube.random(count)
        reach = np.array([np.log(_NEAR) if f.log else 0.5 for f in free])
        near = np.clip(at + reach * (2.0 * shares - 1.0), ends[:, 0], ends[:, 1])
        points = [at, *near]
        rows = self.evaluator.responses([self._si(z) for z in points], fitted)
        good: list[tuple[Reals, list[Response]]] = []
        for z, row in zip(points, rows):
            responses = whole(row)
            if not isinstance(responses, str):
                good.append((z, responses))
        why = whole(rows[0])
        if isinstance(why, str):
            without = next(i for i, response in zip(fitted, rows[0]) if isinstance(response, str))
            run = self.task.runs[without]
            text = f"{run.name}: no limit cycle at the values of the scene ({why})"
            if not good:
                raise UsageError(
                    f"{text}, and none at {len(near)} values near them; state values at which the rig vibrates as it "
                    "was measured, and check what is set for this run"
                )
            told = ", ".join(f"{f.key} = {f.value(c):.4g}" for f, c in zip(free, good[0][0]))
            notes.append(f"{text}; the fit begins where it exists: {told}")
        return [z for z, _ in good], good[0][1]

    def _si(self, z: Reals) -> list[float]:
        return [f.value(c) for f, c in zip(self.law.free, z.tolist())]

    def _screen(
        self, starts: list[Reals], evidence: list[Any], offsets: Offsets, fitted: Sequence[int], most: int
    ) -> list[Reals]:
        """The best `most` starts after a fit of the measures, with offsets, the best first."""
        screened = [replace(each, share=WINDOWS[0]) if isinstance(each, FeatureRun) else each for each in evidence]
        weights = [_weights(each, each.covariance(self.task.seed), SCREEN, _SCREENED) for each in evidence]
        rows = self.evaluator.responses([self._si(z) for z in starts], fitted)
        begun: list[tuple[float, int, Reals, Fit]] = []
        for z, row in zip(starts, rows):
            responses = whole(row)
            if isinstance(responses, str):
                continue
            biases = [each.bias(response) for each, response in zip(evidence, responses)]
            blocks = partial(measure_blocks, screened, weights, biases, SCREEN)
            fit = Fit(self.law.free, self.evaluator, fitted, offsets, blocks)
            z_all = np.concatenate([z, _first_offsets(evidence, responses, offsets)])
            cost = fit.cost(fit.left(z_all, responses), z_all)
            begun.append((cost, len(begun), z_all, fit))
        begun.sort(key=lambda row: row[:2])
        ranked = []
        for cost, number, z_all, fit in begun[:most]:
            solution = fit.run(z_all, _ROUNDS, _FLAT, screening=True)
            ranked.append((cost, number, z_all) if isinstance(solution, str) else (solution.cost, number, solution.z))
        ranked.sort(key=lambda row: row[:2])
        return [z for _, _, z in ranked]

    def _cycles(
        self,
        z: Reals,
        evidence: list[Any],
        offsets: Offsets,
        fitted: Sequence[int],
        gain: float,
        rounds: int = ROUNDS,
    ) -> tuple[Fit, Solution]:
        """The fit cycle by cycle, to its end or until a round gains less than a share of the sum of squares."""
        known = [isinstance(each, FeatureRun) and each.known for each in evidence]
        transient = any(each.run.kind == TRANSIENT for each in evidence)
        for share in WINDOWS if transient else WINDOWS[-1:]:
            now = [replace(each, share=share) if isinstance(each, FeatureRun) else each for each in evidence]
            fit = Fit(self.law.free, self.evaluator, fitted, offsets, partial(_left_of, now), known)
            ended = fit.run(z, rounds, gain)
            if isinstance(ended, str):
                raise UsageError(f"{self.law.scene.name}: {ended}")
            solution = ended
            z = ended.z
        if all(known):
            free = max(sum(r.size for r in solution.left) - len(solution.z), 1)
            solution.covariance = solution.covariance * max(1.0, solution.cost / free)
        return fit, solution

    def _expecting(
        self,
        evidence: list[CycleRun],
        fit: Fit,
        solution: Solution,
        offsets: Offsets,
        fitted: Sequence[int],
        notes: list[str],
        gain: float,
    ) -> tuple[list[CycleRun], Fit, Solution, float]:
        """The fit with what process noise adds to the mean of each cycle, and the density of the noise."""
        density = 0.0
        for seed in range(_NOISY):
            values = self._si(solution.z[: len(self.law.free)])
            twins = partial(self._twins, evidence, values, fitted, seed)
            expected = expecting(evidence, solution.left, twins, density)
            if isinstance(expected, str):
                notes.append(f"what process noise adds to the mean cycle is not taken into account: {expected}")
                break
            evidence, density = expected
            if not density:
                break
            before = solution.z
            fit, solution = self._cycles(before, evidence, offsets, fitted, gain)
            solution.covariance = solution.covariance * (1.0 + max(each.share for each in evidence))
            deviation = np.sqrt(np.diag(solution.covariance))
            if np.all(np.abs(solution.z - before) < _MOVED * deviation):
                break
        return evidence, fit, solution, density

    def _twins(
        self,
        evidence: Sequence[CycleRun],
        values: Sequence[float],
        fitted: Sequence[int],
        seed: int,
        density: float,
        seconds: Sequence[float],
    ) -> list[Arrays | str]:
        """The twins of the runs; see `mean_left`."""
        given: list[tuple[float, ...]] = []
        for i, (duration, each) in enumerate(zip(seconds, evidence)):
            given.append((density, duration, SEED + 100 * seed + i, *each.sigma))
        return self.evaluator.twins(fitted, values, given)

    def _measures(
        self, z: Reals, evidence: list[Any], offsets: Offsets, fitted: Sequence[int]
    ) -> tuple[Fit, Solution, Posterior]:
        """The fit of measures, and what draws about it tell: mean, covariance, and deviation between runs."""
        errors = [each.covariance(self.task.seed) for each in evidence]
        weights = [_weights(each, C + np.diag(START**2), LASTING, EXACT) for each, C in zip(evidence, errors)]
        [row] = self.evaluator.responses([self._si(z[: len(self.law.free)])], fitted)
        responses = whole(row)
        if isinstance(responses, str):
            raise UsageError(f"{self.law.scene.name}: {responses}")
        biases = [each.bias(response) for each, response in zip(evidence, responses)]
        blocks = partial(measure_blocks, evidence, weights, biases, LASTING)
        fit = Fit(self.law.free, self.evaluator, fitted, offsets, blocks)
        ended = fit.run(z, _ROUNDS, _FLAT)  # a region from which draws are made, wherever it ends
        if isinstance(ended, str):
            raise UsageError(f"{self.law.scene.name}: {ended}")
        J = np.concatenate([j.reshape(-1, j.shape[-1]) for j in ended.jacobian])
        ended.covariance = inverse(J.T @ J + np.diag(ended.prior))
        others = [i for i in range(len(self.task.runs)) if i not in fitted]
        posterior = Posterior.of(fit, ended, evidence, biases, errors, others, self.task.seed)
        mean = posterior.mean
        [middle] = fit.responses([mean])
        if not isinstance(middle, str):
            between = np.diag(posterior.deviation**2)
            weights = [_weights(each, C + between, LASTING, EXACT) for each, C in zip(evidence, errors)]
            fit.blocks = partial(measure_blocks, evidence, weights, biases, LASTING)
            mean = fit.levelled(mean, middle)
            left = fit.left(mean, middle)
            J_mean = fit.jacobian(mean, left, middle, central=True)
            ended = Solution(mean, fit.cost(left, mean), left, J_mean, ended.prior, middle)
        ended.covariance = posterior.covariance
        ended.converged = True
        return fit, ended, posterior

    def _report(self, each: CycleRun, left: Reals, response: Response, repeats: bool) -> RunFit:
        """What a run says of the fit."""
        rms = float(np.sqrt((left**2).mean())) if repeats else float("nan")
        p = each.misfit(left) if repeats else float("nan")
        plain = each.model_measures(response)
        model = np.full(len(MEASURES), np.nan) if plain is None else plain + each.bias(response)
        return RunFit(each.run.name, len(each.begins), each.dropped, rms, p, each, response, each.medians, model, left)

    def _predicted(self, fit: Fit, solution: Solution, posterior: Posterior | None) -> list[RunFit]:
        """The runs that are not fitted beside the bands in which 95 % of them are expected."""
        others = [i for i, run in enumerate(self.task.runs) if not run.fitted]
        if posterior is None and others:
            posterior = Posterior.about(fit, solution, others, self.task.seed)
        reports = []
        for i in others:
            assert posterior is not None
            run = self.task.runs[i]
            about = posterior.responses[i]
            [[base]] = self.evaluator.responses([self._si(solution.z[: len(self.law.free)])], [i])
            if isinstance(base, str) or run.kind != "cycles":
                why = base if isinstance(base, str) else "only runs of cycles are predicted"
                reports.append(RunFit.without(run.name, why))
                continue
            each = CycleRun.of(run, base)
            predicted = posterior.predicted(about, each)
            if predicted is None:
                reports.append(RunFit.without(each.run.name, "the detector reads no slips in the model"))
                continue
            middle, square = predicted
            error = np.diag(each.covariance(self.task.seed))
            band = 1.96 * np.sqrt(square + posterior.deviation**2 + error)
            report = RunFit(
                each.run.name,
                len(each.begins),
                each.dropped,
                float("nan"),
                float("nan"),
                each,
                base,
                each.medians,
                middle + each.bias(base),
                np.zeros((0, 0)),
                band,
            )
            reports.append(report)
        return reports


def _with_offsets(each: CycleRun) -> CycleRun:
    """A run whose columns have an offset of their own."""
    columns = tuple(replace(column, offset=RUN) for column in each.run.columns)
    return replace(each, run=replace(each.run, columns=columns))


def _sizes(each: Any) -> list[float]:
    """The unit of the offset of each column: a hundredth of the range of its mean cycle."""
    means = [samples.mean(axis=0) for samples in each.samples]
    return [0.01 * float(np.ptp(mean[np.isfinite(mean)])) for mean in means]


def _first_offsets(evidence: Sequence[Any], responses: Sequence[Response], offsets: Offsets) -> Reals:
    """Offsets from the means of the cycles."""
    sums = np.zeros((2, len(offsets.names)))
    for i, (each, response) in enumerate(zip(evidence, responses)):
        for column, place in enumerate(offsets.place[i]):
            if place >= 0:
                fitted, _ = each.fitted(column, response, 0.0)
                sums[0, place] += float(np.nanmean(each.samples[column] - fitted))
                sums[1, place] += 1.0
    return np.asarray(sums[0] / np.maximum(sums[1], 1.0) / np.array(offsets.sizes))


def _p(evidence: Sequence[Any], solution: Solution, repeats: bool) -> float:
    """The probability of the misfit, if the law is right."""
    if repeats:
        return combined([each.misfit(left) for each, left in zip(evidence, solution.left)])
    count = sum(r.size for r in solution.left)
    told = np.diag(solution.covariance) < 0.2 / np.maximum(solution.prior, 1e-300)
    free = max(count - int(np.sum(told)), 1)
    squares = sum((r**2).sum() for r in solution.left)
    return float(stats.chi2.sf(squares, free))


def _left_of(evidence: Sequence[Any], i: int, response: Response, offsets: Reals) -> Reals:
    """What a response leaves of a run."""
    return np.asarray(evidence[i].left(response, offsets))


def _weights(each: Any, covariance: Reals, chosen: Sequence[int], floor: float) -> Reals:
    """As `measure_weights`; nothing for a run without cycles."""
    return measure_weights(each, covariance, chosen, floor) if isinstance(each, CycleRun) else np.zeros((0, 0))


def _without_outliers(evidence: Sequence[Any], solution: Solution) -> list[Any] | None:
    """The evidence without cycles that the model misses far more than others; None if there are none."""
    rest: list[Any] = []
    outliers = False
    for each, left in zip(evidence, solution.left):
        if not isinstance(each, CycleRun):
            return None
        rms = np.sqrt((left**2).mean(axis=1))
        kept = rms < _OUTLIER * float(np.median(rms))
        outliers |= not kept.all()
        rest.append(_of_cycles(each, kept))
    enough = all(len(each.begins) >= cycles.LEAST for each in rest)
    return rest if outliers and enough else None


def _of_cycles(each: CycleRun, kept: Any) -> CycleRun:
    """A run with some of its cycles."""
    return replace(
        each,
        begins=each.begins[kept],
        measures=each.measures[kept],
        dropped=each.dropped + int((~kept).sum()),
        samples=tuple(s[kept] for s in each.samples),
        times=tuple(t[kept] for t in each.times),
    )
