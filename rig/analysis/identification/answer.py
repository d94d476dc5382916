"""The answer: value, interval and verdict of each parameter, what the data cannot tell, and how each run was fitted.

identified        the interval of 90 % reaches at most 30 % to each side
weak              it is wider
not identifiable  its ends differ by more than a factor of 10, only the range limits it, it is wide and an offset has
                  the same effect, no law fits, or the fit has not converged
at bound          the fit ends at an end of the range

An interval is not printed where the law does not fit: it would be narrow and wrong.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from itertools import combinations
from typing import Any, ClassVar

import numpy as np

from rig.analysis.identification.cycles import CycleRun
from rig.analysis.identification.fit import NORMAL, WIDE, Offsets
from rig.analysis.identification.influence import Influence
from rig.analysis.identification.responses import Response
from rig.analysis.identification.runs import Free, Law, Task
from rig.analysis.identification.slips import MEASURES
from rig.printable import counted
from rig.record.run import Reals
from rig.results import Column, Result, Table
from rig.scenes.left_out import left_out
from rig.scenes.scene import Scene

IDENTIFIED = "identified"
WEAK = "weak"
UNKNOWN = "not identifiable"
BOUND = "at bound"
MISFIT = 0.01
"""Probability below which a law does not fit."""
_FACTOR = 10.0  # between the ends of an interval that tells nothing
_ALIKE = 0.9  # correlation that is named
_ONE = 0.99  # correlation of a wide interval with an offset: both are one number. chosen
_AT_END = 1e-6  # of a coordinate: the fit clips to the ends of the range
_HELD = 0.4  # of the deviation that the range alone gives: a wide interval is that of the range
_LESS = math.sqrt(0.5)  # the same of a narrow one: range and data tell as much
_TOGETHER = 0.6  # half of the interval of a logarithm up to which two tell something together: a factor of 1.8
_CONTRADICTS = 1.96  # standard deviations: 95 %


@dataclass(frozen=True)
class Parameter:
    """A parameter: `value`, ends of its interval of 90 %, value of the scene (SI); `verdict`."""

    key: str
    unit: str
    value: float
    low: float
    high: float
    stated: float
    verdict: str


@dataclass(frozen=True)
class RunFit:
    """A run beside the fit: cycles found and left out, rms over the noise, probability of the misfit, measures.

    `measures`, `model`: medians as in rig.analysis.identification.cycles; `band`: half of the interval in which 95 %
    of the measures of a run that was not fitted are expected. `why`: why there is no model.
    """

    name: str
    cycles: int
    dropped: int
    rms: float
    p: float
    evidence: Any
    response: Response | None
    measures: Reals
    model: Reals
    left: Reals
    band: Reals = field(default_factory=lambda: np.full(len(MEASURES), np.nan))
    why: str = ""

    @classmethod
    def without(cls, name: str, why: str) -> RunFit:
        """A run that has no model."""
        none = np.full(len(MEASURES), np.nan)
        return cls(name, 0, 0, math.nan, math.nan, None, None, none, none, np.zeros((0, 0)), none, why)

    @property
    def inside(self) -> dict[str, bool]:
        """Whether each predicted measure lies in its band."""
        within = np.abs(self.measures - self.model) <= self.band
        return {name: bool(within[i]) for i, name in enumerate(MEASURES) if name not in ("level", "peak")}


@dataclass(frozen=True)
class LawFit:
    """The fit of one law; see `Identified` for what it says."""

    law: Law
    z: Reals
    covariance: Reals
    offsets: Offsets
    repeats: bool
    converged: bool
    p: float
    cost: float
    runs: list[RunFit]
    predicted: list[RunFit]
    deviation: Reals
    influence: tuple[Influence, ...]
    notes: tuple[str, ...]
    evaluations: int
    jacobian: list[Reals]
    density: float = 0.0
    """Of a random force with which simulated cycles scatter as the measured ones do [N/Hz^0.5]."""
    flat: tuple[bool, ...] = ()
    """Of each parameter: whether the fit ended where its value did not matter."""

    @property
    def fits(self) -> bool:
        """Whether the misfit may be chance."""
        return not self.p < MISFIT

    @property
    def told(self) -> bool:
        """Whether the law fits and the fit has converged: else no interval is stated, and nothing is identified."""
        return self.fits and self.converged

    @cached_property
    def reach(self) -> float:
        """Half of an interval of 90 % over its standard deviation: Student's, for as many cycles as there are."""
        from scipy import stats

        spare = sum(len(run.left) for run in self.runs) - len(self.z)
        return float(stats.t.ppf(0.95, spare)) if self.repeats and spare > 0 else NORMAL

    @property
    def size(self) -> float:
        """What laws are compared by: rms over the noise, or the mean deviation between runs."""
        if self.repeats:
            return math.sqrt(self.cost / max(sum(run.left.size for run in self.runs), 1))
        return float(np.mean(self.deviation[[0, 2, 3]]))

    @property
    def parameters(self) -> tuple[Parameter, ...]:
        """The free parameters of the law."""
        return tuple(self._parameter(i, free) for i, free in enumerate(self.law.free))

    def _parameter(self, i: int, free: Free) -> Parameter:
        z = float(self.z[i])
        sd = math.sqrt(max(float(self.covariance[i, i]), 0.0))
        first, last = free.ends
        value = free.value(z)
        low = free.value(float(np.clip(z - self.reach * sd, first, last)))
        high = free.value(float(np.clip(z + self.reach * sd, first, last)))
        if min(z - first, last - z) < _AT_END:
            verdict = BOUND
        elif not self.told or high > _FACTOR * max(low, 0.0) or self._flat(i):
            verdict = UNKNOWN
        elif max(high - value, value - low) > WIDE * abs(value):
            verdict = UNKNOWN if self._aliased(i) > _ONE else WEAK
        else:
            verdict = IDENTIFIED
        if not self.told:
            low = high = math.nan
        return Parameter(free.key, free.unit, value, low, high, free.stated, verdict)

    def half(self, i: int, covariance: Reals) -> float:
        """Half of the interval of a parameter over its value, to first order, with a covariance of z."""
        free = self.law.free[i]
        size = 1.0 if free.log else free.size / max(abs(free.value(float(self.z[i]))), 1e-300)
        return self.reach * math.sqrt(max(float(covariance[i, i]), 0.0)) * size

    def _flat(self, i: int) -> bool:
        """Whether only the range limits a parameter; of a narrow interval: whether data tell less than the range."""
        if any(self.flat[i : i + 1]):
            return True
        low, high = self.law.free[i].ends
        most = _HELD if self.half(i, self.covariance) > WIDE else _LESS
        return math.sqrt(max(float(self.covariance[i, i]), 0.0)) > most * 0.5 * (high - low)

    def _aliased(self, i: int) -> float:
        """The largest correlation of a parameter with an offset, which may take up its effect."""
        offsets = range(len(self.law.free), len(self.z))
        return max((abs(self.correlation(i, k)) for k in offsets), default=0.0)

    def correlation(self, i: int, k: int) -> float:
        """The correlation of two entries of z."""
        C = self.covariance
        return float(C[i, k] / math.sqrt(max(C[i, i] * C[k, k], 1e-300)))

    def together(self) -> Iterator[tuple[str, float, float, float]]:
        """What pairs of parameters tell together where alone they do not: text, value, ends of the interval."""
        verdicts = [parameter.verdict for parameter in self.parameters]
        if not self.told:
            return
        for (i, a), (k, b) in combinations(enumerate(self.law.free), 2):
            both = {verdicts[i], verdicts[k]}
            if not (a.log and b.log) or both == {IDENTIFIED} or BOUND in both:
                continue
            if abs(self.correlation(i, k)) < _ALIKE:
                continue
            va = a.value(float(self.z[i]))
            vb = b.value(float(self.z[k]))
            C = self.covariance[np.ix_((i, k), (i, k))]
            # text, value, and its derivative by both coordinates
            ratio = (f"{a.key} / {b.key}", va / vb, np.array([1.0, -1.0]))
            product = (f"{a.key} * {b.key}", va * vb, np.ones(2))
            ways = [ratio, product]
            if a.unit == b.unit and va != vb:  # a ratio of two that are nearly equal tells little
                ways = [(f"{a.key} - {b.key}", va - vb, np.array([va, -vb]) / (va - vb))]
            deviations = [math.sqrt(max(float(g @ C @ g), 0.0)) for _, _, g in ways]
            best = int(np.argmin(deviations))
            text, value, _ = ways[best]
            sd = self.reach * deviations[best]
            if sd < _TOGETHER:
                ends = (value * math.exp(-sd), value * math.exp(sd))
                yield text, value, min(ends), max(ends)

    def words(self) -> Iterator[str]:
        """What the data cannot tell, and what would help, a line each."""
        yield from self.notes
        if not self.fits:
            yield (
                f"law {self.law.name} does not fit (p = {self.p:.1e}): its parameters have no interval; try another "
                "law, or free a fixed value"
            )
        flat = [free.key for i, free in enumerate(self.law.free) if self._flat(i)]
        if self.told and flat:
            what = "this parameter" if len(flat) == 1 else "these parameters"
            yield f"{', '.join(flat)}: the fit is flat along {what}; only the range limits the interval"
        yield from self._alike()
        for text, value, low, high in self.together():
            yield f"together: {text} = {value:.4g}, 90 % from {low:.4g} to {high:.4g}"
        for i, parameter in enumerate(self.parameters):
            if parameter.key.startswith("friction."):  # a law is always fitted: nobody measured its scene
                continue
            sd = math.sqrt(max(float(self.covariance[i, i]), 1e-300))
            apart = abs(self.law.free[i].coordinate(parameter.stated) - float(self.z[i])) if parameter.stated else 0.0
            if self.fits and parameter.verdict in (IDENTIFIED, WEAK) and apart > _CONTRADICTS * sd:
                stated = f"{parameter.stated:.4g} {_plain(parameter.unit)}".rstrip()
                yield f"{parameter.key}: the data contradict the stated {stated}"
        for each in self.influence:
            if not each.told and each.others:
                yield _alike(each, [q.key for q in self.parameters if q.verdict == IDENTIFIED])
        if self.runs and not self.repeats:
            shares = ", ".join(f"{100.0 * self.deviation[i]:.2g} % in {MEASURES[i]}" for i in (0, 2, 3))
            yield f"deviation between runs beyond the errors of their means: {shares}; it widens every interval"
        if helps := self.help():
            yield helps

    def _alike(self) -> Iterator[str]:
        """Pairs of parameters that act alike, and parameters of friction that act as offsets do."""
        keys = [free.key for free in self.law.free]
        offsets = self.offsets.names
        wide = [self.half(i, self.covariance) > WIDE for i in range(len(keys))]
        for i, k in combinations(range(len(keys)), 2):
            correlation = self.correlation(i, k)
            if abs(correlation) > _ALIKE:
                yield f"{keys[i]} and {keys[k]} have the correlation {correlation:.2f}: vary what separates them"
        levels: dict[tuple[int, ...], list[int]] = {}
        for i, key in enumerate(keys):
            if "friction" in key and wide[i]:
                beside = tuple(k for k in range(len(keys), len(self.z)) if abs(self.correlation(i, k)) > _ALIKE)
                levels.setdefault(beside, []).append(i)
        for beside, alike in levels.items():
            if beside:
                weakest = min((self.correlation(i, k) for i in alike for k in beside), key=abs)
                named = offsets[beside[0] - len(keys)] if len(beside) == 1 else f"{len(beside)} offsets"
                act = "act" if len(alike) > 1 else "acts"
                only = "only one level of each record can be told; " if len(beside) == len(self.runs) > 1 else ""
                acting = " and ".join(keys[i] for i in alike)
                yield (f"{acting} {act} as {named} (correlation {weakest:.2f}): {only}offset and level: vary the load")

    def help(self) -> str:
        """The fixed value that would help most if it were free; "" if none would."""
        told = [each for each in self.influence if each.told and each.score > 3.0 and each.gain > 0.1]
        if not told or (self.fits and self.repeats):
            return ""
        best = max(told, key=lambda each: each.gain)
        return (
            f"freeing {best.key} would help most: it takes away {100.0 * best.gain:.2g} % of the sum of squares, "
            f"changed by {100.0 * best.change:+.3g} %"
        )


@dataclass(frozen=True)
class Identified(Result):
    """The result of `rig.identify`: the fit of each law, the best first."""

    FIGURE: ClassVar = "rig.analysis.identification.figures:identified_figure"

    task: Task
    fits: tuple[LawFit, ...]
    proposals: tuple[Any, ...] = ()

    @classmethod
    def of(cls, task: Task, fits: Sequence[LawFit]) -> Identified:
        """The answer of fits: laws that fit come first, then those that miss less."""
        return cls(task, tuple(sorted(fits, key=lambda fit: (not fit.fits, fit.size))))

    @property
    def best(self) -> LawFit:
        """The law that fits best."""
        return self.fits[0]

    @property
    def parameters(self) -> tuple[Parameter, ...]:
        """The parameters of the best law."""
        return self.best.parameters

    @property
    def complete(self) -> bool:
        """Whether a law fits and every parameter is identified, at least weakly."""
        return all(parameter.verdict in (IDENTIFIED, WEAK) for parameter in self.parameters)

    @property
    def scene(self) -> Scene:
        """The scene with the parameters that are identified."""
        return self.best.law.scene.with_values({p.key: p.value for p in self.told})

    @property
    def told(self) -> tuple[Parameter, ...]:
        """The parameters that are written into a scene: identified, also weakly, of a law that fits."""
        return tuple(p for p in self.parameters if p.verdict in (IDENTIFIED, WEAK))

    def shown(self) -> Iterator[str | Table | Result]:
        """Yield parameters, runs, predictions, laws, and the next experiments."""
        best = self.best
        how = "from experiments"
        if any(run.evidence.run.kind == "cycles" for run in best.runs):
            how = "cycle by cycle" if best.repeats else "by measures of cycles"
        law = f", law {best.law.name}" if best.law.name else ""
        runs_and_law = f"{counted(len(best.runs), 'run')}{law}"
        yield f"{self.task.scene.name}: {runs_and_law}, {how}; {best.evaluations} evaluations"
        if alone := left_out(self.task.scene):
            yield f"  {alone}"
        yield "  low to high: interval of 90 %; rms: over the noise; p: of the misfit"
        yield self.listed()
        yield ""
        yield self._runs()
        for run in best.predicted:
            yield f"\n{run.name} (not fitted), {_told(run)}"
        if table := self._predictions():
            yield table
        if len(self.fits) > 1:
            size = "size: rms over the noise" if best.repeats else "size: deviation between runs"
            yield f"\n  {size}"
            yield self._laws()
        words = [*best.words()]
        if words:
            yield ""
            yield from (f"  {word}" for word in words)
        for proposal in self.proposals:
            yield ""
            yield proposal

    def listed(self) -> Table:
        """Return the parameters."""
        numbers = [Column(name, digits=".5g") for name in ("value", "low", "high", "stated")]
        of_scene = self.task.scene.values()
        rows = []
        for p in self.parameters:
            stated = p.stated if p.key in of_scene else None  # another law has keys that the scene lacks
            ends = (p.low, p.high) if math.isfinite(p.low) else (None, None)
            rows.append((p.key, p.value, *ends, stated, _plain(p.unit), p.verdict))
        return Table("parameters", [Column("key"), *numbers, Column("unit"), Column("verdict")], rows)

    def _runs(self) -> Table:
        repeats = self.best.repeats
        counts = (Column(name, digits=".0f") for name in ("cycles", "left_out"))
        columns = (Column("name"), *counts, Column("rms", digits=".3g"), Column("p", digits=".2g"))
        rows = [(r.name, r.cycles, r.dropped, r.rms if repeats else None, r.p) for r in self.best.runs]
        return Table("runs", columns, rows)

    def _predictions(self) -> Table | None:
        """The measures of the runs that were not fitted, beside their bands of 95 %."""
        numbers = (Column(name, digits=".4g") for name in ("measured", "predicted", "low", "high"))
        rows = []
        for run in self.best.predicted:
            for name, measure in _measures(run).items():
                rows.append((run.name, name, *measure.values(), run.inside[name]))
        columns = (Column("run"), Column("measure"), *numbers, Column("inside"))
        return Table("predictions", columns, rows) if rows else None

    def _laws(self) -> Table:
        rows = []
        for fit in self.fits:
            unknown = ", ".join(p.key for p in fit.parameters if p.verdict == UNKNOWN)
            rows.append((fit.law.name, fit.size, fit.p, fit.fits, unknown))
        numbers = (Column("size", digits=".3g"), Column("p", digits=".2g"))
        return Table("laws", (Column("law"), *numbers, Column("fits"), Column(UNKNOWN)), rows)

    def facts(self) -> dict[str, Any]:
        """Return method, parameters, runs, laws and proposals."""
        best = self.best
        offsets = zip(best.offsets.names, best.z[len(best.law.free) :], best.offsets.sizes)
        return {
            "scene": self.task.scene.name,
            "left_out": left_out(self.task.scene),
            "law": best.law.name,
            "method": "cycles" if best.repeats else "measures",
            "converged": best.converged,
            "p": best.p,
            "parameters": [vars(p) for p in self.parameters],
            "offsets": {name: float(z * size) for name, z, size in offsets},
            "together": [dict(zip(("what", "value", "low", "high"), row)) for row in best.together()],
            "runs": [
                {"name": r.name, "cycles": r.cycles, "left_out": r.dropped, "rms": r.rms, "p": r.p} for r in best.runs
            ],
            "predicted": [{"name": run.name, "why": run.why, "measures": _measures(run)} for run in best.predicted],
            "laws": [_law_json(fit) for fit in self.fits],
            "notes": [*best.words()],
            "next": [proposal.to_json() for proposal in self.proposals],
        }

    def predict(self, name: str) -> RunFit:
        """The run `name` that was not fitted, beside its bands. Raises KeyError."""
        return {run.name: run for run in self.best.predicted}[name]


def phases(run: RunFit) -> Iterator[tuple[Reals, Reals, Reals, Reals]]:
    """Of each column of a run: phase, mean of the measured cycles, their deviation, and the model there."""
    evidence: CycleRun = run.evidence
    ends = np.cumsum([samples.shape[1] for samples in evidence.samples])
    fine = run.left.shape == (len(evidence.begins), ends[-1])
    for i, samples in enumerate(evidence.samples):
        t = evidence.times[i].mean(axis=0) / evidence.period
        left = run.left[:, ends[i] - samples.shape[1] : ends[i]] if fine else 0.0
        model = samples - left * evidence.sigma[i]
        yield t, samples.mean(axis=0), samples.std(axis=0), model.mean(axis=0)


def _alike(each: Influence, identified: Sequence[str]) -> str:
    strong = [(name, c) for name, c in each.others if name in identified and abs(abs(c) - 1.0) < 0.25]
    only = f": only its {'ratio' if strong[0][1] > 0.0 else 'product'} with {strong[0][0]} can" if strong else ""
    return f"{each.key} cannot be told beside {', '.join(name for name, _ in each.others)}{only}"


def _plain(unit: str) -> str:
    return "" if unit == "1" else unit


def _told(run: RunFit) -> str:
    """What there is of a run that was not fitted."""
    return f"no prediction: {run.why}" if run.response is None else counted(run.cycles, "cycle")


def _law_json(fit: LawFit) -> dict[str, Any]:
    verdicts = {p.key: p.verdict for p in fit.parameters}
    return {"law": fit.law.name, "size": fit.size, "p": fit.p, "fits": fit.fits, "verdicts": verdicts}


def _measures(run: RunFit) -> dict[str, dict[str, float]]:
    """The measures of a run that was not fitted, their predictions and bands of 95 %; none without a prediction."""
    if run.response is None:
        return {}
    return {
        name: {
            "measured": math.exp(run.measures[i]),
            "predicted": math.exp(run.model[i]),
            "low": math.exp(run.model[i] - run.band[i]),
            "high": math.exp(run.model[i] + run.band[i]),
        }
        for i, name in enumerate(MEASURES[:4])
    }
