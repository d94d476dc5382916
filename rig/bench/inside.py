"""Controllers within the compiled loop (rig.solve.control): what it needs of them before, and what it has done after.

Between two stretches of frames everything is as if each controller had been asked from here: its line, its queue and
its counts go on. What is not as usual is left to the exchange at that tick: an actuator that is no state of the rig, a
line on safe values, an answer that fails.
"""

from __future__ import annotations

import ctypes
from collections.abc import Collection, Generator, Sequence
from math import nan
from typing import Any, NamedTuple

from controllers.native import Native
from rig.bench.line import SAFE
from rig.bench.operation import Operation
from rig.bench.working import Working
from rig.solve.control import COUNT, NOW, UNUSUAL

_Answer = ctypes.CFUNCTYPE(ctypes.c_int64, ctypes.c_int64)
"""It takes the first argument only, which is all that it needs."""


class Lent(NamedTuple):
    """A controller that is lent, its parts of the arrays, and its compiled `update`, if that answers."""

    one: Working
    reads: slice
    drives: slice
    native: Native | None


class Inside:
    """Lends controllers of `operation` to the compiled loop while the stand is carried through many frames."""

    def __init__(self, operation: Operation) -> None:
        self._exchange, self._stand = operation.exchange, operation.stand
        self._controls = self._stand.controls
        self._command: Any = self._controls.command.data
        self._clock: Any = self._controls.clock.data
        self._lent: list[Lent] = []
        self._called: list[tuple[Working, int, int]] = []
        """The same for `_answers`: the first of its actuators, and how many."""
        answers = self._answers()
        next(answers)
        self._asked = _Answer(answers.send)
        self._address = ctypes.cast(self._asked, ctypes.c_void_p).value

    def lend(self, working: Sequence[Working]) -> Collection[str]:
        """Lend what can be lent of these, which have answered what was due at this tick; their names."""
        c, lent, read, driven = self._controls, self._lent, 0, 0
        for one in working:
            line, columns = one.line, one.columns
            places = [self._stand.plain(drive) for drive in line.drives]
            if not line.values or line.wanted or line.status == SAFE or None in places:
                continue
            native = one.native() if read + len(columns) <= len(c.columns) else None
            found = Lent(one, slice(read, read + len(columns)), slice(driven, driven + len(places)), native)
            if native is not None:
                c.columns[found.reads] = columns
                read += len(columns)
            driven += len(places)
            c.place[found.drives], c.slope[found.drives] = zip(*places)
            self._lay(len(lent), found)
            lent.append(found)
            self._called.append((one, found.drives.start, len(places)))
        c.clock[NOW], c.clock[COUNT], c.clock[UNUSUAL] = self._stand.tick, len(lent), 0
        return [found.one.name for found in lent]

    def _lay(self, i: int, found: Lent) -> None:
        one, reads, drives, native = found
        c, line, inputs, in_force = self._controls, one.line, self._stand.inputs, self._exchange.in_force
        c.low[drives] = [inputs[drive].low for drive in line.drives]
        c.high[drives] = [inputs[drive].high for drive in line.drives]
        c.force[drives] = [in_force.get(drive, nan) for drive in line.drives]
        for k, (due, answered, values) in enumerate(line.queue):
            c.queue[i, k] = due, answered
            c.queued[drives, k] = values
        record = c.lines[i]
        record["hears"], record["deaf"] = (0, 0) if native is None else (reads.start, reads.stop)
        record["answer"] = self._address if native is None else native.address
        record["heard_at"] = c.heard.ctypes.data + c.heard.itemsize * reads.start
        record["command_at"] = c.command.ctypes.data + c.command.itemsize * drives.start
        record["memory_at"] = 0 if native is None else native.memory.ctypes.data
        record["period"], record["delay"] = line.period, line.delay
        record["drives"], record["driven"] = drives.start, drives.stop
        record["due"], record["given"], record["updates"] = one.due, -1, 0
        record["last"], record["oldest"], record["waiting"] = line.last, 0, len(line.queue)
        record["kept"] = record["clamped"] = 0

    def take_back(self) -> None:
        """Take over what the lent controllers have done."""
        c = self._controls
        for i, found in enumerate(self._lent):
            one, reads, drives, native = found
            record, line = c.lines[i], one.line
            updates, now = int(record["updates"]), int(c.clock[NOW])
            if native is not None:
                one.due = int(record["due"])
                if updates:
                    t_ns = (one.due - line.period) * self._stand.frame_ns
                    heard, command = tuple(c.heard[reads].tolist()), tuple(c.command[drives].tolist())
                    one.loop.went_on(updates, t_ns, heard, native.state(), command)
            if c.clock[UNUSUAL] and record["given"] == now:
                one.given = tuple(c.command[drives].tolist())
            line.queue.clear()
            for k in range(int(record["waiting"])):
                at = (int(record["oldest"]) + k) % c.queue.shape[1]
                due, answered = c.queue[i, at].tolist()
                line.queue.append((due, answered, tuple(c.queued[drives, at].tolist())))
            if kept := int(record["kept"]):
                line.went_on(c.rows[i, :kept], c.values[:kept, drives])
                line.counts.taken += kept
                line.counts.clamped += int(record["clamped"])
                line.counts.oldest = max(line.counts.oldest, line.delay)
                for name, value in zip(line.drives, line.values):
                    self._exchange.in_force[name] = self._stand.values[name] = value
        self._lent.clear()
        self._called.clear()
        c.clock[COUNT] = 0

    def _answers(self) -> Generator[int, int, None]:
        """What the compiled loop calls with the place of who is due: 0 if the command is there, 1 if one has to look.

        A generator, since a Ctrl-C strikes where Python begins again after compiled code: here that is inside `try`. A
        function would lose it, as no compiled code lets an exception through.
        """
        result = 1
        while True:
            i = 0
            try:
                i = yield result
                result = 1
                one, first, count = self._called[i]
                values = one.ask(int(self._clock[NOW]))
                if len(values) == count:
                    for value in values:
                        self._command[first] = value
                        first += 1
                    one.given = None
                    result = 0
            except GeneratorExit:
                return
            except BaseException as fault:
                self._called[i][0].fault = fault
