"""Lends controllers to the compiled loop (rig.solve.control_loop) for many frames, and takes the results back.

After that everything is as if each controller had been called from Python: its queue and its counts are up to date. The
loop leaves unusual cases to the exchange at their tick: an actuator that is not a state of the rig, a controller on
safe values, an answer that fails.
"""

from __future__ import annotations

import ctypes
from collections.abc import Collection, Generator, Sequence
from math import inf, nan
from typing import Any, NamedTuple

from rig.bench.run.command_queue import AS_SENT, SAFE, CommandQueue
from rig.bench.run.exchange import Playback, PlayedCommands
from rig.bench.run.experiment import Experiment
from rig.bench.run.local_controllers import ControllerInProcess
from rig.controllers.runtime.native import Native
from rig.solve.control_loop import ANSWERED, AS, COUNT, DUE, NOW, ROWS, UNUSUAL

# A callback that uses only the first argument of the compiled call.
_Answer = ctypes.CFUNCTYPE(ctypes.c_int64, ctypes.c_int64)
_NEVER = 1 << 62  # frames


class CompiledQueue(NamedTuple):
    """A command queue that is lent, its slices of the arrays, and its source: a controller at work or a recording."""

    queue: CommandQueue
    reads: slice
    drives: slice
    one: ControllerInProcess | None
    native: Native | None
    played: PlayedCommands | None


class CompiledControllers:
    """Lends controllers of `experiment` to the compiled loop while the plant runner computes many frames."""

    def __init__(self, experiment: Experiment) -> None:
        self._exchange, self._runner = experiment.exchange, experiment.runner
        self._tables = self._runner.controllers
        self._command: Any = self._tables.command.data
        self._clock: Any = self._tables.clock.data
        self._compiled: list[CompiledQueue] = []
        answers = self._answers()
        next(answers)
        self._asked = _Answer(answers.send)
        self._address = ctypes.cast(self._asked, ctypes.c_void_p).value

    def lend(self, working: Sequence[ControllerInProcess]) -> Collection[str]:
        """Lend all controllers of `working`, or of a recording, that the loop can handle; returns their names.

        The controllers have given the answers due at this tick, and recorded commands of this tick are in force.
        """
        c = self._tables
        c.clock[NOW], c.clock[COUNT], c.clock[UNUSUAL] = self._runner.tick, 0, 0
        for one in working:
            if one.queue.values and not one.queue.wanted and one.queue.status != SAFE and one.queue.link is None:
                self._lend(one.queue, one, None)
        if isinstance(self._exchange, Playback) and self._exchange.plays:
            for name, played in self._exchange.played.items():
                if name in self._exchange.queues:
                    self._lend(self._exchange.queues[name], None, played)
        return [found.queue.name for found in self._compiled]

    def _lend(self, queue: CommandQueue, one: ControllerInProcess | None, played: PlayedCommands | None) -> None:
        c, i = self._tables, len(self._compiled)
        read, driven = (self._compiled[-1].reads.stop, self._compiled[-1].drives.stop) if i else (0, 0)
        places = [self._runner.plain(drive) for drive in queue.drives]
        fits = i < len(c.controllers) and driven + len(places) <= len(c.command) and len(queue.queue) < ROWS
        if not fits or None in places or not self._exchange.faulty.keys().isdisjoint(queue.drives):
            return
        native = None
        columns: Sequence[int] = () if one is None else one.columns
        if one is not None and read + len(columns) <= len(c.columns):
            native = one.native()
        reads = slice(read, read + (0 if native is None else len(columns)))
        drives = slice(driven, driven + len(places))
        c.columns[reads] = columns[: reads.stop - read]
        c.place[drives], c.slope[drives] = zip(*places)
        c.force[drives] = [self._exchange.in_force.get(drive, nan) for drive in queue.drives]
        found = CompiledQueue(queue, reads, drives, one, native, played)
        record = c.controllers[i]
        record["hears"], record["deaf"] = reads.start, reads.stop
        record["drives"], record["driven"] = drives.start, drives.stop
        record["given"], record["updates"], record["kept"], record["clamped"] = -1, 0, 0, 0
        record["oldest"] = 0
        if one is not None:
            self._lay_working(record, i, found, one)
        else:
            self._lay_played(record, i, found)
        self._compiled.append(found)
        c.clock[COUNT] = i + 1

    def _lay_working(self, record: Any, i: int, found: CompiledQueue, one: ControllerInProcess) -> None:
        queue, reads, drives, _, native, _ = found
        c, inputs = self._tables, self._runner.inputs
        c.low[drives] = [inputs[drive].low for drive in queue.drives]
        c.high[drives] = [inputs[drive].high for drive in queue.drives]
        for k, (due, answered, values) in enumerate(queue.queue):
            c.queue[i, k] = due, answered, AS_SENT
            c.queued[k, drives] = values
        record["answer"] = self._address if native is None else native.address
        record["heard_at"] = c.heard.ctypes.data + c.heard.itemsize * reads.start
        record["command_at"] = c.command.ctypes.data + c.command.itemsize * drives.start
        record["memory_at"] = 0 if native is None else native.memory.ctypes.data
        record["period"], record["delay"], record["waiting"] = queue.period, queue.delay, len(queue.queue)
        record["due"], record["last"] = one.due, queue.last

    def _lay_played(self, record: Any, i: int, found: CompiledQueue) -> None:
        c, played = self._tables, found.played
        assert played is not None
        tick, answered, status, values = (column[played.done : played.done + ROWS] for column in played.commands)
        count = len(tick)
        c.queue[i, :count, DUE], c.queue[i, :count, ANSWERED], c.queue[i, :count, AS] = tick, answered, status
        c.queued[:count, found.drives] = values
        c.low[found.drives], c.high[found.drives] = -inf, inf  # recorded commands are already clamped
        record["answer"], record["due"], record["waiting"] = 0, -1, count
        record["period"], record["last"] = _NEVER, 0

    def take_back(self) -> None:
        """Update queues, counts and states of the lent controllers with what the loop has done."""
        c = self._tables
        for i, found in enumerate(self._compiled):
            queue, record, drives = found.queue, c.controllers[i], found.drives
            if found.one is not None:
                self._take_back_working(record, i, found, found.one)
            if kept := int(record["kept"]):
                queue.adopt(c.rows[i, :kept], c.values[:kept, drives])
                if found.played is not None:
                    found.played.done += kept
                for name, value in zip(queue.drives, queue.values):
                    self._exchange.in_force[name] = self._runner.values[name] = value
        self._compiled.clear()
        c.clock[COUNT] = 0

    def _take_back_working(self, record: Any, i: int, found: CompiledQueue, one: ControllerInProcess) -> None:
        c, queue, drives = self._tables, found.queue, found.drives
        updates, kept = int(record["updates"]), int(record["kept"])
        if found.native is not None:
            one.due = int(record["due"])
            if updates:
                t_ns = (one.due - queue.period) * self._runner.frame_ns
                heard, command = tuple(c.heard[found.reads].tolist()), tuple(c.command[drives].tolist())
                one.loop.adopt(updates, t_ns, heard, found.native.state(), command)
        if c.clock[UNUSUAL] and record["given"] == c.clock[NOW]:
            one.given = tuple(c.command[drives].tolist())
        queue.queue.clear()
        for k in range(int(record["waiting"])):
            at = (int(record["oldest"]) + k) % ROWS
            due, answered, _ = c.queue[i, at].tolist()
            queue.queue.append((due, answered, tuple(c.queued[at, drives].tolist())))
        if kept:
            queue.counts.taken += kept
            queue.counts.clamped += int(record["clamped"])
            queue.counts.oldest = max(queue.counts.oldest, queue.delay)

    def _answers(self) -> Generator[int, int, None]:
        """The callback of the compiled loop: takes the index of the controller that is due; yields 1 if it answered.

        It yields 0 if the exchange must handle the case. It is a generator because Ctrl-C raises where Python resumes
        after compiled code or where a loop repeats, and here both are inside `try`. A function would lose the
        exception, since compiled code does not propagate it.
        """
        result, i = 0, 0
        while True:
            try:
                while True:
                    i = 0
                    i = yield result
                    result = 0
                    queue, _, drives, one, _, _ = self._compiled[i]
                    values, first = one.ask(self._clock[NOW]), drives.start  # type: ignore[union-attr]
                    if len(values) == len(queue.drives):
                        for value in values:
                            self._command[first] = value
                            first += 1
                        one.given = None  # type: ignore[union-attr]
                        result = 1
            except GeneratorExit:
                return
            except BaseException as fault:
                self._compiled[i].one.fault, result = fault, 0  # type: ignore[union-attr]
