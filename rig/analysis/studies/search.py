"""A global search for the smallest or largest value of a measure: differential evolution over ranges of parameters.

The search is a function of its seed, so that its points come in the same order each time. Their values are stored like
those of a study: when the same search is started again, it reads them and continues from there. A point without a value
(no limit cycle, a run that stopped) is worse than every other one. Source: Storn and Price, J. Global Optim. 11 (1997)
341-359, as scipy.optimize.differential_evolution implements it.

The result of a search: its points, the best one, and how it came there.
"""

from __future__ import annotations

import csv
import io
import math
from collections import Counter
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any, ClassVar

import numpy as np
import scipy
from numpy.typing import NDArray

from rig.analysis.kernel_shapes import prepare
from rig.analysis.pool import Arrays, Progress, Store, Work, pool
from rig.analysis.pool.cluster import check as check_cluster
from rig.analysis.studies.factors import Factor, changed, factors, with_unit
from rig.analysis.studies.functions import check_not_loading
from rig.analysis.studies.measures import Measure, Measured, evaluate, measures, one_unit
from rig.analysis.studies.runs import MOST, MOST_SEED, as_arrays, digest
from rig.errors import RigError, SceneError, UsageError
from rig.printable import columns
from rig.quantities import run_length_ns, whole
from rig.record.provenance import provenance
from rig.record.run import Run
from rig.results import Result
from rig.scenes.scene import Scene

Array = NDArray[np.float64]
_APART = "not converged: the same search with more --evaluations and --force continues from here"
_CLOSE = 0.01  # of the range: nearer to an end, the range limits the search


@dataclass(frozen=True)
class SearchResult(Result):
    """The result of `rig.optimise`: `values` of the measure at `points` [point, parameter] (SI), in the order of the
    search; nan with a reason where there is none. `settled`: whether the points have converged.
    """

    FIGURE: ClassVar = "rig.analysis.studies.result:search_figure"

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
        return {one.key: float(v) for one, v in zip(self.factors, self.points[self.best])}

    def text(self) -> str:
        """Return the report as text."""
        what = f"{'largest' if self.largest else 'smallest'} {self.measure}"
        counts = Counter(why for why in self.reasons if why)
        missing = [f"  {count} points have no value: {why}" for why, count in counts.most_common(3)]
        if self.best is None:
            return "\n".join([f"{self.scene.name}: no point has a value of {self.measure}", *missing])
        unit = "" if self.unit in ("", "1") else f" {self.unit}"
        lines = [f"{self.scene.name}: {what} {self.value:.6g}{unit}, point {self.best + 1} of {len(self.values)}", ""]
        rows: list[tuple[str, ...]] = [("parameter", "best", "from", "to", "")]
        for one, value in zip(self.factors, self.points[self.best].tolist()):
            low, high = one.axis.values
            near = min(value - low, high - value) < _CLOSE * (high - low)
            note = "at the end of its range: a wider one may hold a better point" if near else ""
            rows.append((one.key, *(one.axis.text(v) for v in (value, low, high)), note))
        lines += [*columns(rows, "<>>><"), ""]
        lines += [f"  the points have {'converged' if self.settled else _APART}"]
        return "\n".join([*lines, *missing])

    def __repr__(self) -> str:
        return self.text()

    def to_json(self) -> dict[str, Any]:
        """Return the fields as JSON values; parameters in SI."""
        return {
            "scene": self.scene.name,
            "measure": self.measure,
            "unit": self.unit,
            "largest": self.largest,
            "value": self.value,
            "parameters": self.parameters,
            "ranges": {one.key: list(one.axis.values) for one in self.factors},
            "evaluations": len(self.values),
            "settled": self.settled,
            "folder": str(self.folder),
        }

    def csv(self) -> str:
        """Return every point as a line of a CSV file with the units in its head; parameters in SI."""
        made = io.StringIO()
        writer = csv.writer(made)
        writer.writerow([*(one.axis.si_label for one in self.factors), with_unit(self.measure, self.unit), "reason"])
        for point, value, why in zip(self.points.tolist(), self.values.tolist(), self.reasons):
            writer.writerow([*point, value, why])
        return made.getvalue()


ROOT = Path("searches")
EVALUATIONS = 600
"""Default largest number of points."""
_POPULATION = 15  # points of a generation for each parameter, as scipy has it
_WORST = 1e100  # of a point without a value: scipy computes a generation again whose values are all infinite
_LEAST = 5  # points that differential evolution needs


@dataclass(frozen=True)
class SearchRuns:
    """The points of a search, which are known while it runs.

    `factors`: the parameters with the ends of their ranges. Every point is run with `seed`.
    """

    scene: Scene
    factors: tuple[Factor, ...]
    measure: Measure
    largest: bool
    evaluations: int
    seed: int
    duration: float | None

    @property
    def name(self) -> str:
        """The scene."""
        return self.scene.name

    @property
    def portable(self) -> bool:
        """Whether other processes can compute it."""
        return self.measure.function is None or self.measure.function.portable

    @property
    def bounds(self) -> list[tuple[float, float]]:
        """The ends of the ranges (SI)."""
        return [(one.axis.values[0], one.axis.values[1]) for one in self.factors]

    @property
    def work(self) -> Work:
        """The search as a work (rig.analysis.pool), which learns its points while it runs.

        More evaluations continue a search: its points are the same up to there.
        """
        what = [self.factors, self.measure, self.largest, self.seed, self.duration, scipy.__version__]
        return Work(self.compute, range(MOST), self.name, digest(self.scene, repr(what)), self.prepare, self.failed)

    @property
    def population(self) -> int:
        """Number of points of a generation."""
        return max(_LEAST, _POPULATION * len(self.factors))

    def prepare(self) -> None:
        """Compile the kernels."""
        prepare([self.scene])

    def compute(self, unit: int, *given: float) -> Arrays:
        """Compute the measure of a point with the values `given` (SI)."""
        try:
            scene = changed(self.scene, {one.key: v for one, v in zip(self.factors, given)}, self.seed)
            found = evaluate(scene, [self.measure], self.duration)
        except SceneError as fault:
            found = Measured((math.nan,), (self.measure.unit,), "; ".join(fault.faults))
        return as_arrays(found) | {"point": np.array(given)}

    def failed(self, unit: int, why: str) -> Arrays:
        """Return a point without a value."""
        return as_arrays(Measured((math.nan,), (self.measure.unit,), why))


def prepared(
    scene: Scene,
    over: Mapping[str, Any],
    measure: str | Callable[[Run], Any],
    largest: bool = False,
    evaluations: int = EVALUATIONS,
    seed: int | None = None,
    duration: float | None = None,
) -> SearchRuns:
    """Return a checked search of `scene`; `over`: key -> range, "10 N:30 N" or (10.0, 30.0).

    Raises SceneError, UsageError with every fault that is found.
    """
    check_not_loading()
    faults: list[str] = []

    def checked(make: Callable[[], Any]) -> Any:
        try:
            return make()
        except RigError as fault:
            faults.append(str(fault))

    found = checked(lambda: measures(scene, [measure]))
    ranges = {key: _range(given) for key, given in over.items()} if isinstance(over, Mapping) else {}
    faults += [f'{key}: expected a range FROM:TO, such as "10 N:30 N"' for key, ends in ranges.items() if ends is None]
    given = {key: ends for key, ends in ranges.items() if ends is not None}
    varied: tuple[Factor, ...] = (
        checked(lambda: factors(scene, given if ranges else over)) if given or not ranges else ()
    )
    checked(lambda: run_length_ns(duration))
    first = checked(lambda: whole("seed", scene.seed if seed is None else seed, 0, MOST_SEED))
    for one in varied or ():
        if not one.axis.values[0] < one.axis.values[1]:
            faults.append(f"{one.key}: the range must rise, from {one.axis.text(one.axis.values[0])} upwards")
    least = max(_LEAST, _POPULATION * max(len(ranges), 1))
    most = checked(lambda: whole("evaluations", evaluations, 1, MOST))
    if most and most < least:
        faults.append(f"evaluations = {most}: must be at least {least} for {len(ranges)} parameters")
    if found and found[0].of_run and duration is None and scene.duration_ns is None:
        faults.append(f"{scene.name} has no protocol that ends; state a duration: --duration 10")
    if faults:
        raise UsageError("\n".join(faults))
    return SearchRuns(scene, varied, found[0], largest, most, first, duration)


def _range(given: Any) -> Any:
    """The two ends of a range as the values of a parameter; None for what is no range."""
    if isinstance(given, str):
        parts = [part.strip() for part in given.split(":")]
        return ", ".join(parts) if len(parts) == 2 and all(parts) and "," not in given else None
    if not isinstance(given, Sequence | np.ndarray) or len(given) != 2 or "" in map(str, given):
        return None
    return list(given)


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

    if cluster:
        check_cluster(cluster, workers)
    if not work.portable and (workers is not None or cluster) and workers != 1:
        raise UsageError(f"measure {work.measure.name}: worker processes cannot load it; define it in a .py file")
    units = work.work
    store, say = Store.of(units, root), progress or (lambda done, total: None)
    with (
        store.open(units),
        pool(units, store, workers if work.portable else 1, work.population, cluster=cluster) as processes,
    ):
        found = store.load()
        asked = 0

        def values(points: NDArray[np.float64]) -> NDArray[np.float64]:
            """The values of a generation, [point], to be made small; `points` [parameter, point]."""
            nonlocal asked, found
            rows = {asked + i: tuple(point) for i, point in enumerate(points.T.tolist())}
            todo = {unit: given for unit, given in rows.items() if unit not in found}
            begin, asked = asked, asked + len(rows)
            ready = begin + len(rows) - len(todo)
            if todo:
                processes.compute(todo, lambda done: say(ready + done, work.evaluations))
                found = store.load()
                found |= {unit: work.failed(unit, why) | {"point": np.array(rows[unit])}
                          for unit, why in processes.failed.items() if unit in rows}  # fmt: skip
            say(asked, work.evaluations)
            sign = -1.0 if work.largest else 1.0
            made = sign * _values(found, asked)[0][begin:]
            return np.where(np.isfinite(made), made, _WORST)

        ended = differential_evolution(
            values,
            work.bounds,
            rng=np.random.default_rng(work.seed),
            init=_first_generation(work),
            maxiter=work.evaluations // work.population - 1,
            polish=False,
            updating="deferred",
            vectorized=True,
        )
    rows = [found[unit] for unit in range(asked)]
    made, unit = _values(found, asked)
    return SearchResult(
        scene=work.scene,
        factors=work.factors,
        measure=work.measure.name,
        unit=unit,
        largest=work.largest,
        points=np.array([row["point"] for row in rows]),
        values=made,
        reasons=tuple(str(row["reason"]) for row in rows),
        settled=bool(ended.success),
        provenance=provenance(work.seed),
        folder=store.folder,
    )


def _values(found: Mapping[int, Arrays], count: int) -> tuple[NDArray[np.float64], str]:
    """The values of the first points in one unit, and this unit."""
    rows = [found[unit] for unit in range(count)]
    return one_unit([float(row["values"][0]) for row in rows], [str(row["units"][0]) for row in rows])


def _first_generation(work: SearchRuns) -> NDArray[np.float64]:
    """The first generation, [point, parameter] (SI): a Latin hypercube."""
    from scipy.stats import qmc

    shares = qmc.LatinHypercube(len(work.factors), rng=np.random.default_rng(work.seed)).random(work.population)
    low, high = np.array(work.bounds).T
    return np.asarray(low + (high - low) * shares)
