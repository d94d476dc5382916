"""Controllers within the compiled loop (rig.solve.control): what it needs of them before, and what it has done after.

Between two stretches of frames everything is as if each controller had been asked from here: its line, its queue and
its counts go on. What is not as usual is left to the exchange at that tick: an actuator that is no state of the rig, a
line on safe values, an answer that fails.
"""

from __future__ import annotations

import ctypes
from collections.abc import Collection, Sequence
from math import nan

from rig.bench.line import SAFE, Line
from rig.bench.operation import Operation
from rig.bench.working import Working
from rig.solve.control import COUNT, NOW, UNUSUAL, Controls

_Answer = ctypes.CFUNCTYPE(ctypes.c_int64, *[ctypes.c_int64] * 5)


class Inside:
    """Lends controllers of `operation` to the compiled loop while the stand is carried through many frames."""

    def __init__(self, operation: Operation) -> None:
        self._exchange, self._stand = operation.exchange, operation.stand
        self._controls: Controls = self._stand.controls
        self._command = memoryview(self._controls.command)
        self._lent: list[tuple[Working, slice]] = []
        self._asked = _Answer(self._ask)
        self._address = ctypes.cast(self._asked, ctypes.c_void_p).value

    def lend(self, working: Sequence[Working]) -> Collection[str]:
        """Lend what can be lent of these, which have answered what was due at this tick; their names."""
        c, lent, driven = self._controls, self._lent, 0
        for one in working:
            line = one.line
            places = [self._stand.plain(drive) for drive in line.drives]
            if not line.values or line.wanted or line.status == SAFE or None in places:
                continue
            drives = slice(driven, driven := driven + len(places))
            c.index[drives], c.slope[drives] = zip(*places)
            self._lay(len(lent), one, drives)
            lent.append((one, drives))
        c.clock[NOW], c.clock[COUNT], c.clock[UNUSUAL] = self._stand.tick, len(lent), 0
        return [one.name for one, _ in lent]

    def _lay(self, i: int, one: Working, drives: slice) -> None:
        c, line, inputs, in_force = self._controls, one.line, self._stand.inputs, self._exchange.in_force
        c.low[drives] = [inputs[drive].low for drive in line.drives]
        c.high[drives] = [inputs[drive].high for drive in line.drives]
        c.force[drives] = [in_force.get(drive, nan) for drive in line.drives]
        for k, (due, answered, values) in enumerate(line.queue):
            c.queue[i, k] = due, answered
            c.queued[drives, k] = values
        record = c.lines[i]
        record["answer"] = self._address
        record["period"], record["delay"] = line.period, line.delay
        record["drives"], record["driven"] = drives.start, drives.stop
        record["due"], record["given"], record["last"] = one.due, -1, line.last
        record["oldest"], record["waiting"] = 0, len(line.queue)
        record["kept"] = record["clamped"] = 0

    def take_back(self) -> None:
        """Take over what the lent controllers have done."""
        c = self._controls
        for i, (one, drives) in enumerate(self._lent):
            record, line = c.lines[i], one.line
            one.due = int(record["due"])
            if not (c.clock[UNUSUAL] and record["given"] == c.clock[NOW]):
                one.given = None  # it is in force, or waits for that
            line.queue.clear()
            for k in range(int(record["waiting"])):
                at = (int(record["oldest"]) + k) % c.queue.shape[1]
                due, answered = c.queue[i, at].tolist()
                line.queue.append((due, answered, tuple(c.queued[drives, at].tolist())))
            if kept := int(record["kept"]):
                line.went_on(c.rows[i, :kept], c.values[:kept, drives], self._exchange.keeps)
                self._count(line, kept, int(record["clamped"]))
        self._lent.clear()
        c.clock[COUNT] = 0

    def _count(self, line: Line, kept: int, clamped: int) -> None:
        line.counts.taken += kept
        line.counts.clamped += clamped
        line.counts.oldest = max(line.counts.oldest, line.delay)
        for name, value in zip(line.drives, line.values):
            self._exchange.in_force[name] = self._stand.values[name] = value

    def _ask(self, i: int, t_ns: int, heard: int, command: int, state: int) -> int:
        """What the compiled loop calls: 0 if the command is there, 1 if somebody has to look at it."""
        one, drives = self._lent[i]
        try:
            values = one.ask(t_ns // self._stand.frame_ns)
        except BaseException as fault:  # no compiled code lets it through
            one.fault = fault
            return 1
        if len(values) != drives.stop - drives.start:
            return 1
        for k, value in enumerate(values, drives.start):
            self._command[k] = value
        return 0
