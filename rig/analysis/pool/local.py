"""Worker processes on this machine, which get batches until no unit is left; a lost worker is replaced."""

from __future__ import annotations

import base64
import json
import pickle
import threading
from collections.abc import Callable, Mapping
from pathlib import Path
from types import TracebackType
from typing import Self

from rig.analysis.pool.schedule import Schedule
from rig.analysis.pool.store import Store
from rig.analysis.pool.work import Work
from rig.child_process import Child, end
from rig.errors import WorkerError

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
        self.batch, self.at = batch, 0
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
                self.batch, self.at = [], 0


class WorkerProcesses:
    """`count` worker processes that compute `work` into `store`, from `with` to its end.

    `failed`: units that ended their worker twice, with the reason.
    """

    def __init__(self, work: Work, store: Store, count: int) -> None:
        self._store, self._count = store, count
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
        ends the whole work, and if a worker ends before it has begun.
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
        if member.child.fault or not member.ready:
            what = f"{member.child.name}: {member.child.fault}" if member.child.fault else ending
            raise WorkerError(f"{what}{self._store.kept}")
        for unit in schedule.lost(member.batch):
            self.failed[unit] = f"ended its worker twice: {ending}"
        member.batch, member.at = [], 0
