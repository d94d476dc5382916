"""Carrying out a work: what its folder does not contain yet is computed, here or by workers, and saved as it comes.

Worker processes of this machine get batches until no unit is left; a lost worker is replaced.
"""

from __future__ import annotations

import base64
import json
import pickle
import tempfile
import threading
import time
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from types import TracebackType
from typing import TYPE_CHECKING, Self

from rig.analysis.pool.work import MOST_WORKERS, Arrays, Progress, Schedule, Store, Work
from rig.errors import WorkerError
from rig.machine.process import Child, end
from rig.machine.scheduling import cores
from rig.quantities import whole

if TYPE_CHECKING:
    from rig.analysis.pool.cluster import Cluster

Ask = Callable[[Mapping[int, tuple[float, ...]], Callable[[int], object]], list[Arrays]]
"""What computes the units that a work asks for, see `asking`."""
SPAN = 2.0  # s of a batch: an interruption loses at most so much, and saving it (5 to 7 ms) costs little
_WORKER = "rig.analysis.pool.worker"  # not imported here: Python warns of a module that is run and was imported before
_LOOK = 0.1  # s between two reports of progress
_PATIENCE = 1.0  # s for an idle worker to end


class _Member:
    """A worker process and the batch it computes. `at`: units of it that are finished."""

    def __init__(self, name: str, folder: Path, heard: threading.Event) -> None:
        self.child = Child(name, [_WORKER, str(folder)], heard, fed=True)
        self.ready = False
        self.batch: list[int] = []
        self.at = 0

    def give(self, batch: list[int], units: Mapping[int, tuple[float, ...]]) -> None:
        """Let the worker compute a batch."""
        self.batch = batch
        self.at = 0
        self.child.feed(json.dumps([[unit, *units[unit]] for unit in batch]))

    def hear(self, schedule: Schedule) -> None:
        """Take in what the worker has told."""
        for what, value in self.child.new_words():
            if what == "ready":
                self.ready = True
            elif what == "at":
                self.at = value
            elif what == "done":
                schedule.done(self.batch, value)
                self.batch = []
                self.at = 0


class WorkerProcesses:
    """`count` worker processes that compute `work` into `store`, from `with` to its end.

    `failed`: units that ended their worker twice, with the reason.
    """

    def __init__(self, work: Work, store: Store, count: int) -> None:
        self._store = store
        self._count = count
        self._work = base64.b64encode(pickle.dumps(work)).decode()
        self._heard = threading.Event()
        self._members: list[_Member] = []
        self._started = 0
        self.failed: dict[int, str] = {}

    def __enter__(self) -> Self:
        for _ in range(self._count):
            self._members.append(self._start())
        return self

    def __exit__(self, kind: type[BaseException] | None, fault: BaseException | None, at: TracebackType | None) -> None:
        for member in self._members:
            member.child.dismiss()
        end([member.child for member in self._members], 0.0 if kind else _PATIENCE)

    def _start(self) -> _Member:
        self._started += 1
        member = _Member(f"worker {self._started}", self._store.folder, self._heard)
        member.child.feed(self._work)
        return member

    def compute(self, units: Mapping[int, tuple[float, ...]], progress: Callable[[int], object]) -> None:
        """Compute `units` (number -> values that they are given) and save them.

        `progress` gets the number of finished units, at least ten times a second. Raises WorkerError for a fault that
        ends the whole work, and if a worker ends before any has begun.
        """
        schedule = Schedule(units, self._count, SPAN)
        while schedule.left:
            self._heard.clear()
            for place, member in enumerate(self._members):
                over = member.child.code is not None and member.child.wait(1.0)  # its last words have been read
                member.hear(schedule)
                if over:
                    member.child.dismiss()
                    self._lost(member, schedule)
                    if schedule.waiting:
                        self._members[place] = member = self._start()
                elif member.ready and not member.batch and schedule.waiting:
                    member.give(schedule.batch(), units)
            progress(len(units) - schedule.left + sum(member.at for member in self._members))
            if schedule.left:
                self._heard.wait(_LOOK)

    def _lost(self, member: _Member, schedule: Schedule) -> None:
        """Send the batch of a worker that has ended out again. Raises WorkerError if this is of no use."""
        ending = member.child.ending
        if member.child.fault or not any(other.ready for other in self._members):
            what = f"{member.child.name}: {member.child.fault}" if member.child.fault else ending
            raise WorkerError(f"{what}{self._store.kept}")
        for unit in schedule.lost(member.batch):
            self.failed[unit] = f"ended its worker twice: {ending}"
        member.batch = []
        member.at = 0


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
    `cluster`: the workers of this dask scheduler instead. A unit whose worker is lost is tried again once. One
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
    with pool(work, store, workers, len(todo), apart, cluster) as computing:
        computing.compute(dict.fromkeys(todo, ()), lambda new: say(done + new, work.total))
    return store.load() | {unit: work.given_up(unit, why) for unit, why in computing.failed.items()}


@contextmanager
def pool(
    work: Work, store: Store, workers: int | None, most: int, apart: bool = False, cluster: str = ""
) -> Iterator[Here | WorkerProcesses | Cluster]:
    """Workers for `work`, its kernels compiled; for at most `most` units at a time. See `carry_out`."""
    if cluster:
        from rig.analysis.pool.cluster import joined

        with joined(work, store, cluster) as dask:
            work.prepare()
            yield dask
        return
    count = min(cores() if workers is None else whole("workers", workers, 1, MOST_WORKERS), most)
    if count == 1 and not apart:
        yield Here(work, store)
        return
    with WorkerProcesses(work, store, count) as processes:
        work.prepare()  # while the workers start
        yield processes


@contextmanager
def asking(work: Work, store: Store, workers: int | None, most: int, cluster: str = "") -> Iterator[Ask]:
    """Open the store of a work whose units are known only while it runs, and yield what computes them.

    It gets units, number -> values that they are given, and a progress that gets how many of them are ready. It returns
    their results in this order; those that the store contains are not computed again. Raises as `carry_out`.
    """
    with store.open(work), pool(work, store, workers, most, cluster=cluster) as computing:
        rows = store.load()

        def ask(units: Mapping[int, tuple[float, ...]], progress: Callable[[int], object]) -> list[Arrays]:
            todo = {unit: given for unit, given in units.items() if unit not in rows}
            ready = len(units) - len(todo)
            if todo:
                computing.compute(todo, lambda done: progress(ready + done))
                rows.update(store.load(min(todo)))
                lost = {unit: why for unit, why in computing.failed.items() if unit in todo}
                try:
                    rows.update({unit: work.given_up(unit, why) for unit, why in lost.items()})
                except WorkerError as fault:
                    raise WorkerError(f"{fault}{store.kept}") from None
            progress(len(units))
            return [rows.pop(unit) for unit in units]

        yield ask


class Here:
    """A pool of one worker: this process."""

    def __init__(self, work: Work, store: Store) -> None:
        self._work = work
        self._store = store
        self.failed: dict[int, str] = {}

    def compute(self, units: Mapping[int, tuple[float, ...]], progress: Callable[[int], object]) -> None:
        """Compute units and save them, batch by batch; on an interruption also what is finished."""
        schedule = Schedule(units, 1, SPAN)
        while batch := schedule.batch():
            begin = time.perf_counter()
            with_values = [(unit, *units[unit]) for unit in batch]
            self._store.compute(self._work, with_values, {}, lambda done: progress(len(units) - schedule.left + done))
            schedule.done(batch, time.perf_counter() - begin)


@contextmanager
def temporary(work: Work) -> Iterator[Store]:
    """A store in a folder that is deleted in the end, for results that are needed only once."""
    with tempfile.TemporaryDirectory(prefix="friction-rig-") as folder:
        store = Store(Path(folder), lasting=False)
        with store.open(work):
            yield store
