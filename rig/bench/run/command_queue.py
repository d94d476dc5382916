"""The commands of one controller: those that wait, the one in force, and counts."""

from __future__ import annotations

from array import array
from bisect import insort
from collections import deque
from collections.abc import Sequence
from dataclasses import dataclass
from operator import itemgetter
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rig.bus.impaired_link import ImpairedLink
from rig.record.run import Commands

AS_SENT = 0
CLAMPED = 1
SAFE = 2
"""Values of `status` of a command that took effect."""


@dataclass
class Counts:
    """Counts of what happened to the commands of one controller.

    `late`: commands that took effect more than one frame after the measurement they answer (beyond the stated delay).
    `oldest`: age of the oldest command that took effect [frames]. `held`: frames in which a command was due but had not
    arrived. `outdated`: commands that were too old to take effect (`CommandQueue.oldest`). `safe`: number of times that
    safe values replaced missing commands.
    """

    taken: int = 0
    late: int = 0
    oldest: int = 0
    held: int = 0
    overtaken: int = 0
    outdated: int = 0
    clamped: int = 0
    not_finite: int = 0
    refused: int = 0
    safe: int = 0


class CommandQueue:
    """The queue of the commands of one controller, and the command in force. Times are in ticks."""

    __slots__ = (
        "_columns",
        "answered",
        "connected",
        "counts",
        "delay",
        "drives",
        "hold",
        "last",
        "link",
        "name",
        "oldest",
        "oldest_in_time",
        "period",
        "queue",
        "status",
        "values",
        "wanted",
    )

    def __init__(
        self, name: str, drives: Sequence[str], period: int, delay: int, hold: int, link: ImpairedLink | None = None
    ) -> None:
        self.name = name
        self.drives = tuple(drives)
        self.period = period
        self.delay = delay
        self.hold = hold
        """Time for which the last command is held when commands are missing."""
        self.queue: deque[tuple[int, int, Sequence[float]]] = deque()
        self.link = link
        """The link that its commands come over; None: a perfect one."""
        self.oldest_in_time = delay + (0 if link is None else link.most)
        """Largest age at which a command is in time [frames], one frame of the bus left out."""
        self.oldest = self.oldest_in_time + period + hold
        """Largest age at which a command may take effect [frames]: after this time safe values replace it."""
        self.connected = True
        self.values: tuple[float, ...] = ()
        """The command in force; () before the first one."""
        self.wanted: tuple[float, ...] = ()
        """The latest command, if it needs a rig that is still being built; else ()."""
        self.answered = -1
        self.status = AS_SENT
        self.last = 0
        self.counts = Counts()
        self._columns = (array("q"), array("q"), array("q"), array("d"))

    def follow(self, former: CommandQueue) -> None:
        """Continue the counts and recorded commands of the queue that the controller of this name had before.

        A recording has one number of values for each name, so commands to another number of actuators are left out.
        """
        self.counts = former.counts
        if len(former.drives) == len(self.drives):
            self._columns = former._columns

    def put(self, sent: int, answered: int, values: Sequence[float], now: int) -> None:
        """Take a command that its controller sends at tick `sent`: it counts from then on, or when its link has it.

        Copies that would have arrived before tick `now` arrive at `now`.
        """
        if self.link is None:
            self.queue.append((max(sent, now), answered, values))
        else:
            for due in self.link.arrivals(answered, sent):
                insort(self.queue, (max(due, now), answered, values), key=itemgetter(0))

    def keep(self, tick: int) -> None:
        """Record the command in force from `tick` on."""
        ticks, answered, status, values = self._columns
        ticks.append(tick)
        answered.append(self.answered)
        status.append(self.status)
        values.extend(self.values)

    def adopt(self, rows: NDArray[Any], values: NDArray[np.float64]) -> None:
        """Record commands that the compiled loop put into force.

        `rows` [row]: rig.solve.control_loop.COMMAND; `values` float64 [row, actuator].
        """
        self.values = tuple(values[-1].tolist())
        self.last, self.answered, self.status = rows[-1].tolist()
        for i, new in enumerate((rows["tick"], rows["answered"], rows["status"], values)):
            self._columns[i].frombytes(np.ascontiguousarray(new).tobytes())

    def taken(self) -> tuple[array[int], array[int], array[int], array[float]] | None:
        """Take what was recorded since the last call: ticks, answered, statuses, concatenated values; None if empty."""
        ticks, answered, status, values = self._columns
        if not ticks:
            return None
        rows = ticks[:], answered[:], status[:], values[:]
        for column in self._columns:
            del column[:]
        return rows

    def commands(self) -> Commands:
        """The recorded commands that were not taken yet."""
        ticks, answered, status = (np.array(column, np.int64) for column in self._columns[:3])
        return Commands(ticks, answered, status, np.array(self._columns[3]).reshape(len(ticks), len(self.drives)))
