"""A global search for the smallest or largest value of a measure: differential evolution over ranges of parameters.

The search is a function of its seed, so that its points come in the same order each time. Their values are stored like
those of a study: when the same search is started again, it reads them and continues from there. A point without a value
(no limit cycle, a run that stopped) is worse than every other one. Source: Storn and Price, J. Global Optim. 11 (1997)
341-359, as scipy.optimize.differential_evolution implements it.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any, ClassVar

import numpy as np
import scipy
from numpy.typing import NDArray

from rig.analysis.pool import Arrays, Progress, Store, asking
from rig.analysis.studies.factors import Factor, ranges
from rig.analysis.studies.functions import check_not_loading
from rig.analysis.studies.measures import Measure, measures, one_unit
from rig.analysis.studies.runs import MOST, Plan, StudyRuns, check_length, first_seed
from rig.errors import Faults, UsageError
from rig.printable import counted
from rig.quantities import whole
from rig.record.provenance import provenance
from rig.record.run import Run
from rig.results import Column, Result, Table
from rig.scenes.scene import Scene

Array = NDArray[np.float64]
_APART = "not converged: the same search with more --evaluations and --force continues from here"
_CLOSE = 0.01  # of the range: nearer to an end, the range limits the search
ROOT = Path("searches")
EVALUATIONS = 600
"""Default largest number of points."""
_POPULATION = 15  # points of a generation for each parameter, as scipy has it
_WORST = 1e100  # of a point without a value: scipy computes a generation again whose values are all infinite
_LEAST = 5  # points that differential evolution needs


@dataclass(frozen=True)
class SearchResult(Result):
    """The result of `rig.optimise`: `values` of the measure at `points` [point, parameter] (SI), in the order of the
    search; nan with a reason where there is none. `settled`: whether the points have converged.
    """

    FIGURE: ClassVar = "rig.analysis.studies.figures:search_figure"

    scene: Scene
    factors: tuple[Factor, ...]
    measure: str
    unit: str
    largest: bool
    points: Array
    values: Array
    reasons: tuple[str, ...]
    settled: bool
    provenance: Mapping[str, str]
    folder: Path
    belief: tuple[str, ...] = ()
    """Lines on what the controllers are told of the rig."""
    left_out: str = ""
    """Whether the measure is that of the plant without its controllers, in words."""

    @cached_property
    def best(self) -> int | None:
        """Number of the best point; None if no point has a value."""
        if not np.isfinite(self.values).any():
            return None
        return int(np.nanargmax(self.values) if self.largest else np.nanargmin(self.values))

    @property
    def value(self) -> float:
        """The best value; nan if no point has one."""
        return float("nan") if self.best is None else float(self.values[self.best])

    @property
    def parameters(self) -> dict[str, float]:
        """The parameters of the best point (SI); empty if no point has a value."""
        if self.best is None:
            return {}
        return {factor.key: float(v) for factor, v in zip(self.factors, self.points[self.best])}

    def shown(self) -> Iterator[str | Table]:
        """Yield the best value and its parameters."""
        what = f"{'largest' if self.largest else 'smallest'} {self.measure}"
        counts = Counter(why for why in self.reasons if why)
        missing = [f"  {count} points have no value: {why}" for why, count in counts.most_common(3)]
        if self.best is None:
            yield f"{self.scene.name}: no point has a value of {self.measure}"
            yield from missing
            return
        unit = "" if self.unit in ("", "1") else f" {self.unit}"
        yield f"{self.scene.name}: {what} {self.value:.6g}{unit}, point {self.best + 1} of {len(self.values)}"
        for remark in (*self.belief, self.left_out):
            if remark:
                yield f"  {remark}"
        yield ""
        numbers = (Column(name, digits=".6g") for name in ("best", "from", "to"))
        columns = (Column("parameter"), *numbers, Column("unit"), Column("note"))
        rows = []
        for factor, value in zip(self.factors, self.points[self.best].tolist()):
            low, high = factor.axis.values
            note = ""
            if min(value - low, high - value) < _CLOSE * (high - low):
                note = "at the end of its range: a wider one may hold a better point"
            shown = (v / factor.axis.scale for v in (value, low, high))
            rows.append((factor.key, *shown, factor.axis.shown, note))
        yield Table("best", columns, rows)
        yield f"\n  the points have {'converged' if self.settled else _APART}"
        yield from missing

    def facts(self) -> dict[str, Any]:
        """Return the best value and its parameters; parameters in SI."""
        return {
            "scene": self.scene.name,
            "measure": self.measure,
            "unit": self.unit,
            "largest": self.largest,
            "value": self.value,
            "parameters": self.parameters,
            "ranges": {factor.key: list(factor.axis.values) for factor in self.factors},
            "evaluations": len(self.values),
            "belief": list(self.belief),
            "left_out": self.left_out,
            "settled": self.settled,
            "folder": str(self.folder),
        }

    def listed(self) -> Table:
        """Return a row for each point; parameters in SI."""
        parameters = (factor.axis.column() for factor in self.factors)
        columns = (*parameters, Column(self.measure, self.unit), Column("reason"))
        points = zip(self.points.tolist(), self.values.tolist(), self.reasons)
        return Table("points", columns, [(*point, value, why) for point, value, why in points])


@dataclass(frozen=True)
class SearchRuns(StudyRuns):
    """The points of a search for the smallest or `largest` value of a measure, which are known while it runs.

    The parameters of the plan have the ends of their ranges as values. More `evaluations` continue a search: its points
    are the same up to there.
    """

    largest: bool
    evaluations: int

    @property
    def items(self) -> range:
        """The numbers that a point can have."""
        return range(MOST)

    @property
    def identity(self) -> list[Any]:
        """What the values of the points depend on, besides scene and sources."""
        return [self.plan, *self.measures, self.largest, self.duration, scipy.__version__]

    @property
    def population(self) -> int:
        """Number of points of a generation."""
        return max(_LEAST, _POPULATION * len(self.plan.factors))


def prepared(
    scene: Scene,
    over: Mapping[str, Any],
    minimise: str | Callable[[Run], Any] | None = None,
    maximise: str | Callable[[Run], Any] | None = None,
    evaluations: int = EVALUATIONS,
    seed: int | None = None,
    duration: float | None = None,
) -> SearchRuns:
    """Return a checked search of `scene`; `over`: key -> range, "10 N:30 N" or (10.0, 30.0).

    `minimise`, `maximise`: the measure, one of the two. Raises SceneError, UsageError with every fault that is found.
    """
    check_not_loading()
    given_measures = [measure for measure in (minimise, maximise) if measure is not None]
    if len(given_measures) != 1:
        raise UsageError("state one measure: minimise, such as cycle.amplitude, or maximise")
    if not over:
        raise UsageError(
            f"{scene.name}: nothing is free and nothing is uncertain; state a range to search in (--over KEY=FROM:TO), "
            "what is not known of the rig (--against KEY=RANGE), or both"
        )
    faults = Faults()
    wanted: tuple[Measure, ...] = faults(lambda: measures(scene, given_measures)[:1], ())
    varied: tuple[Factor, ...] = faults(lambda: ranges(scene, over), ())
    first = faults(lambda: first_seed(scene, seed), 0)
    count = len(over) if isinstance(over, Mapping) else 1
    least = max(_LEAST, _POPULATION * count)
    most = faults(lambda: whole("evaluations", evaluations, 1, MOST), least)
    if most < least:
        faults.found.append(f"evaluations = {most}: must be at least {least} for {counted(count, 'parameter')}")
    plan = Plan(varied, 1, "", 1, first, alike=True)
    work = SearchRuns(scene, plan, wanted, duration, maximise is not None, most)
    faults(lambda: check_length(scene, duration, work.of_run), None)
    faults.raise_found()
    return work


def search(
    work: SearchRuns,
    root: Path = ROOT,
    workers: int | None = None,
    progress: Progress | None = None,
    cluster: str = "",
) -> SearchResult:
    """Carry out a search; values that its folder under `root` contains already are not computed again.

    `workers`, `cluster`: as for a study. Raises UsageError, WorkerError as a study does; what is finished stays.
    """
    from scipy.optimize import differential_evolution
    from scipy.stats import qmc

    workers = work.usable_workers(workers, cluster)
    units = work.work
    store = Store.of(units, root)
    say = progress or (lambda done, total: None)
    low, high = np.array([factor.axis.values for factor in work.plan.factors]).T
    points: list[list[float]] = []
    rows: list[Arrays] = []
    with asking(units, store, workers, work.population, cluster) as ask:

        def values(generation: Array) -> Array:
            """The values of a `generation` [parameter, point], to be made small."""
            begin = len(points)
            points.extend(generation.T.tolist())
            todo = {unit: tuple(points[unit]) for unit in range(begin, len(points))}
            rows.extend(ask(todo, lambda done: say(begin + done, work.evaluations)))
            every, _ = _values(rows)
            to_be_small = (-1.0 if work.largest else 1.0) * every[begin:]
            return np.where(np.isfinite(to_be_small), to_be_small, _WORST)

        sampler = qmc.LatinHypercube(len(low), rng=np.random.default_rng(work.plan.seed))
        shares = sampler.random(work.population)
        ended = differential_evolution(
            values,
            [*zip(low.tolist(), high.tolist())],
            rng=np.random.default_rng(work.plan.seed),
            init=low + (high - low) * shares,
            maxiter=work.evaluations // work.population - 1,
            polish=False,
            updating="deferred",
            vectorized=True,
        )
    measured, unit = _values(rows)
    reasons = tuple(str(row["reason"]) for row in rows)
    return SearchResult(
        scene=work.scene,
        factors=work.plan.factors,
        measure=work.measures[0].name,
        unit=unit,
        largest=work.largest,
        points=np.array(points),
        values=measured,
        reasons=reasons,
        settled=bool(ended.success),
        provenance=provenance(work.plan.seed),
        folder=store.folder,
        belief=tuple(work.belief),
        left_out=work.left_out,
    )


def _values(rows: Sequence[Arrays]) -> tuple[Array, str]:
    """The values of all points in one unit, and this unit."""
    return one_unit([float(row["values"][0]) for row in rows], [str(row["units"][0]) for row in rows])
