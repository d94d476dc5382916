"""Studies: a scene over parameters, with measures; grids, samples of distributions, repeated runs, and a search.

factors    the varied parameters: values, or distributions in Python or as text; conditions; a study as a TOML file
runs       the points of a study, each computed for itself; recordings of chosen points
measures   of cycle, motion, modes and run
functions  own measures: Python functions of a Run
result     values, units, reasons; as text, CSV, xarray
figures    their figures, and that of a search
search     a global search
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from dataclasses import replace
from numbers import Integral
from pathlib import Path
from typing import Any

from rig.analysis.pool import Progress, Store, carry_out
from rig.analysis.pool.work import this_processor
from rig.analysis.studies.factors import condition
from rig.analysis.studies.functions import check_not_loading
from rig.analysis.studies.measures import Measure, measures
from rig.analysis.studies.result import COLUMNS, StudyResult, gathered
from rig.analysis.studies.runs import Plan, StudyRuns, check_length, check_random, plan, random_parts
from rig.analysis.studies.runs import keep as keep_recordings
from rig.errors import Faults
from rig.record.provenance import provenance
from rig.record.run import Run
from rig.scenes.scene import Scene

__all__ = ["ROOT", "StudyResult", "StudyRuns", "prepared", "study"]
ROOT = Path("studies")


def prepared(
    scene: Scene,
    over: Mapping[str, Any],
    measure: str | Callable[[Run], Any] | Iterable[str | Callable[[Run], Any]],
    samples: int | None = None,
    sampling: str = "random",
    repeat: int = 1,
    seed: int | None = None,
    duration: float | None = None,
    keep: str | None = None,
) -> StudyRuns:
    """Return a checked study of `scene`. Raises SceneError, UsageError with every fault that is found."""
    check_not_loading()
    faults = Faults()
    names = [measure] if isinstance(measure, str) or callable(measure) else measure
    wanted: tuple[Measure, ...] = faults(lambda: measures(scene, names), ())
    nothing = Plan((), 1, sampling, 1, 0)
    points = faults(lambda: plan(scene, over, samples, sampling, repeat, seed), nothing)
    keys = [factor.key for factor in points.factors]
    taken = {*COLUMNS, *points.dimensions, *keys}
    for each in wanted:
        if each.name in taken:
            fault = f"measure {each.name}: a column of the results has this name; rename the function"
            faults.found.append(fault)
    if wanted and keep is not None:
        faults(lambda: condition(keep, wanted), None)
    work = StudyRuns(scene, points, wanted, duration)
    faults(lambda: check_length(scene, duration, work.of_run or keep is not None), None)
    if isinstance(repeat, Integral) and repeat > 1:
        faults(lambda: check_random(scene, f"{repeat} runs of a point"), None)
        if wanted and not work.of_run and random_parts(scene):
            faults.found.append(
                f"repeat = {repeat}: all measures are those of the plant without noise, which no seed changes"
            )
    faults.raise_found()
    return work


def study(
    work: StudyRuns,
    root: Path = ROOT,
    workers: int | None = None,
    progress: Progress | None = None,
    keep: str | None = None,
    cluster: str = "",
) -> StudyResult:
    """Carry out a study; what its folder under `root` contains already is not computed again.

    `workers`: processes, one for each core by default. `keep`: condition of the runs whose recordings are kept in the
    folder. `cluster`: workers of dask instead of processes of this machine (rig.analysis.pool.cluster). Raises
    UsageError for a folder or a cluster that cannot be used and for a measure that several processes cannot compute,
    WorkerError if workers fail; what is finished stays.
    """
    workers = work.usable_workers(workers, cluster)
    points = work.work
    store = Store.of(points, root)
    apart = not work.unportable and any(measure.function for measure in work.measures)  # a function can end its process
    with store.open(points):
        rows = carry_out(points, store, workers, progress, apart, cluster)
    about = provenance(work.plan.seed)
    if store.processors - {this_processor()}:  # those that computed it, if they are others than this one
        about["processors"] = "; ".join(sorted(store.processors))
    result = gathered(work, rows, about, store.folder)
    if keep is None:
        return result
    number, holds = condition(keep, work.measures)
    chosen = [k for k, value in enumerate(result.values[:, number].tolist()) if holds(value)]
    processes = None if cluster else workers
    recordings = keep_recordings(work, chosen, store.folder / "runs", processes)
    return replace(result, recordings=recordings)
