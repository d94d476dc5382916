"""Studies: a scene over parameters, with measures; grids, samples of distributions, repeated runs, and a search.

factors    the varied parameters: values, or distributions in Python or as text; conditions on measures
runs       the points of a study, each computed for itself; recordings of chosen points
measures   of cycle, motion and run; functions: own
result     values, units, reasons; as text, figure, CSV, xarray
file       a study as a TOML file
search     a global search
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from dataclasses import replace
from numbers import Integral
from pathlib import Path
from typing import Any

from rig.analysis.pool import Progress, Store, carry_out
from rig.analysis.pool.cluster import check as check_cluster
from rig.analysis.pool.store import this_processor
from rig.analysis.repeat import REMEDY, sources
from rig.analysis.studies.factors import condition
from rig.analysis.studies.functions import check_not_loading
from rig.analysis.studies.measures import measures
from rig.analysis.studies.result import COLUMNS, StudyResult, gathered
from rig.analysis.studies.runs import StudyRuns, plan
from rig.analysis.studies.runs import keep as keep_recordings
from rig.errors import RigError, UsageError
from rig.quantities import run_length_ns
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
    faults: list[str] = []

    def checked(make: Callable[[], Any]) -> Any:
        try:
            return make()
        except RigError as fault:
            faults.append(str(fault))

    wanted = checked(lambda: measures(scene, [measure] if isinstance(measure, str) or callable(measure) else measure))
    points = checked(lambda: plan(scene, over, samples, sampling, repeat, seed))
    if wanted and points:
        taken = {*COLUMNS, *points.dimensions, *(one.key for one in points.factors)}
        faults += [f"measure {one.name}: a column of the results has this name; rename the function"
                   for one in wanted if one.name in taken]  # fmt: skip
    if wanted and keep is not None:
        checked(lambda: condition(keep, wanted))
    of_runs = any(one.of_run for one in wanted or ())
    if (of_runs or keep is not None) and duration is None and scene.duration_ns is None:
        faults.append(f"{scene.name} has no protocol that ends; state a duration: --duration 10")
    checked(lambda: run_length_ns(duration))
    several = isinstance(repeat, Integral) and repeat > 1
    if several and not sources(scene):
        faults.append(f"{scene.name}: nothing in it is random, so that {repeat} runs of a point are the same. {REMEDY}")
    elif several and wanted and not of_runs:
        faults.append(f"repeat = {repeat}: all measures are those of the plant without noise, which no seed changes")
    if faults:
        raise UsageError("\n".join(faults))
    return StudyRuns(scene, points, wanted, duration)


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
    if cluster:
        check_cluster(cluster, workers)
    if not work.portable and (workers != 1 or cluster):
        names = ", ".join(one.name for one in work.measures if one.function and not one.function.portable)
        if workers is not None or cluster:
            raise UsageError(
                f"measure {names}: worker processes cannot load it; define it at the top level of a .py file, "
                "or compute in this process with one worker"
            )
        workers = 1
    points = work.work
    store = Store.of(points, root)
    with store.open(points):
        own = work.portable and any(one.function for one in work.measures)  # a function can end its process
        found = carry_out(points, store, workers, progress, own, cluster)
    result = gathered(work, found, _provenance(work, store), store.folder)
    if keep is None:
        return result
    number, holds = condition(keep, work.measures)
    chosen = [k for k, value in enumerate(result.values[:, number].tolist()) if holds(value)]
    return replace(
        result, recordings=keep_recordings(work, chosen, store.folder / "runs", None if cluster else workers)
    )


def _provenance(work: StudyRuns, store: Store) -> dict[str, str]:
    """The provenance of a result; the processors that computed it, if they are of several types or others than this."""
    found = provenance(work.plan.seed)
    others = sorted(store.processors - {this_processor()})
    return found | ({"processors": "; ".join(sorted(store.processors))} if others else {})
