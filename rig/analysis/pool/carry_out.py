"""Carrying out a work: what its folder does not contain yet is computed, here or by workers, and saved as it comes."""

from __future__ import annotations

import tempfile
import time
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from typing import Protocol

from rig.analysis.pool.local import SPAN, WorkerProcesses
from rig.analysis.pool.schedule import Schedule
from rig.analysis.pool.store import Store
from rig.analysis.pool.work import MOST_WORKERS, Arrays, Progress, Work
from rig.quantities import whole
from rig.scheduling import cores


def carry_out(
    work: Work,
    store: Store,
    workers: int | None = None,
    progress: Progress | None = None,
    apart: bool = False,
    cluster: str = "",
) -> dict[int, Arrays]:
    """Compute what `store`, which the caller has opened, does not contain yet; return the results of all units.

    `workers`: processes, one for each core by default; a single one computes in this process, unless `apart`.
    `cluster`: that of rig.analysis.pool.cluster.Cluster instead. A unit whose worker is lost is tried again once. One
    that ends its worker twice has the result of `Work.given_up`, which is not stored: the next call tries it again.
    Raises WorkerError for a fault that ends the whole work; what is finished stays in the store.
    """
    say = progress or (lambda done, total: None)
    ready = store.load()
    todo = [unit for unit in range(work.total) if unit not in ready]
    done = len(ready)
    say(done, work.total)
    if not todo:
        return ready
    with pool(work, store, workers, len(todo), apart, cluster) as found:
        found.compute(dict.fromkeys(todo, ()), lambda new: say(done + new, work.total))
    return store.load() | {unit: work.given_up(unit, why) for unit, why in found.failed.items()}


@contextmanager
def pool(
    work: Work, store: Store, workers: int | None, most: int, apart: bool = False, cluster: str = ""
) -> Iterator[Pool]:
    """Workers for `work`, its kernels compiled; for at most `most` units at a time. See `carry_out`."""
    if cluster:
        from rig.analysis.pool.cluster import Cluster

        with Cluster(work, store, cluster, workers) as found:
            work.prepare()
            yield found
        return
    count = min(cores() if workers is None else whole("workers", workers, 1, MOST_WORKERS), most)
    if count == 1 and not apart:
        yield Here(work, store)
        return
    with WorkerProcesses(work, store, count) as processes:
        work.prepare()  # while the workers start
        yield processes


class Pool(Protocol):
    """Workers of one work. `failed`: units that ended their worker, with the reason."""

    failed: dict[int, str]

    def compute(self, units: Mapping[int, tuple[float, ...]], progress: Callable[[int], object]) -> None:
        """Compute `units` (number -> values that they are given) and save them."""


class Here:
    """A pool of one worker: this process."""

    def __init__(self, work: Work, store: Store) -> None:
        self._work, self._store = work, store
        self.failed: dict[int, str] = {}

    def compute(self, units: Mapping[int, tuple[float, ...]], progress: Callable[[int], object]) -> None:
        """Compute units and save them, batch by batch; on an interruption also what is finished."""
        schedule = Schedule(units, 1, SPAN)
        while batch := schedule.batch():
            begin, found = time.perf_counter(), dict[int, Arrays]()
            try:
                for unit in batch:
                    found[unit] = self._work.compute(unit, *units[unit])
                    progress(len(units) - schedule.left + len(found))
            finally:
                if found:
                    self._store.save(found)
            schedule.done(batch, time.perf_counter() - begin)


@contextmanager
def temporary(work: Work) -> Iterator[Store]:
    """A store in a folder that is deleted in the end, for results that are needed only once."""
    with tempfile.TemporaryDirectory(prefix="friction-rig-") as folder:
        store = Store(Path(folder), lasting=False)
        with store.open(work):
            yield store
