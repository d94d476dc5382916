"""The exchange of a re-simulation: recorded commands take effect at the same ticks with the same values."""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence

import numpy as np

from rig.bench.run.command_queue import CommandQueue
from rig.bench.run.exchange import Exchange
from rig.errors import LogError
from rig.record.run import Commands
from rig.solve.control_loop import ROWS


class PlayedCommands:
    """The recorded commands of one controller; the first `done` of them have taken effect."""

    def __init__(self, commands: Commands) -> None:
        self.commands, self.done = commands, 0
        self._ticks = commands.tick.tolist()

    def due(self, ahead: int = 0) -> int | None:
        """The tick of the next command, or of the one `ahead` commands later; None if there is none."""
        at = self.done + ahead
        return self._ticks[at] if at < len(self._ticks) else None


class Playback(Exchange):
    """An exchange that plays recorded commands and ignores controllers, up to tick `end` if it is not None.

    From `end` on it is an `Exchange`.
    """

    end: int | None = None
    played: Mapping[str, PlayedCommands] = {}

    def play(self, recorded: Mapping[str, Commands], end: int | None = None) -> None:
        """Take the commands of each controller before tick `end` from a recording; all without `end`."""
        self.end = end
        readable = [(name, found) for name, found in recorded.items() if found.tick.size]  # damage may leave none
        self.played = {name: PlayedCommands(_before(end, found)) for name, found in readable}
        for queue in self.queues.values():
            self._fits(queue)

    def admit(self, name: str, drives: Sequence[str], period_ns: int, delay_ns: int = 0) -> CommandQueue:
        """See `Exchange.admit`. Raises LogError if the recorded commands have another number of values."""
        queue = super().admit(name, drives, period_ns, delay_ns)
        self._fits(queue)
        return queue

    def _fits(self, queue: CommandQueue) -> None:
        if (played := self.played.get(queue.name)) is not None:
            if (width := played.commands.values.shape[1]) != len(queue.drives):
                raise LogError(f"the recorded commands of {queue.name} have {width} values, its actuators are "
                               f"{', '.join(queue.drives)}")  # fmt: skip

    @property
    def plays(self) -> bool:
        """Whether commands come from the recording at this tick."""
        return self.end is None or self._runner.tick < self.end

    def receive(self, sender: str, answered: int, values: Sequence[float]) -> None:
        """Take a command that takes effect at `end` or later; the recording has those before."""
        if self.end is None:
            return
        queue = self.queues[sender]
        due = answered + queue.delay
        if due >= self.end:
            super().receive(sender, answered, values)
        elif queue.link is not None and len(values) == len(queue.drives) and queue.connected:
            queue.put(due, answered, values, due)
            while queue.queue and queue.queue[0][0] < self.end:  # the recording has it
                queue.queue.popleft()

    def until(self, but: Collection[str] = ()) -> int | None:
        """The tick of the next recorded command; None if there is none.

        Ignores controllers whose admission is not in the recording. For the controllers in `but`, which the compiled
        loop handles, it is the tick of the first command that exceeds the loop's capacity.
        """
        if not self.plays:
            return super().until(but)
        due = [] if (step := self._next_step()) is None else [step]
        played = [(name, one) for name, one in self.played.items() if name in self.queues]
        ticks = [one.due(ROWS if name in but else 0) for name, one in played]
        return min([*due, *(tick for tick in ticks if tick is not None)], default=None)

    def take_over(self) -> list[CommandQueue]:
        """Put into force the recorded commands of this tick; from `end` on those that controllers have sent."""
        if not self.plays:
            return super().take_over()
        tick, changed = self._runner.tick, self._changed
        changed.clear()
        for queue in self._order:
            one = self.played.get(queue.name)
            while one is not None and (due := one.due()) is not None and due <= tick:
                _, answered, status, values = (column[one.done].tolist() for column in one.commands)
                self.impose(queue, answered, status, tuple(values))
                one.done += 1
                changed.append(queue)
        if self._steps:
            self._step()
        return changed


def _before(end: int | None, found: Commands) -> Commands:
    """The commands before tick `end`; all of them without it."""
    count = found.tick.size if end is None else int(np.searchsorted(found.tick, end))
    return Commands(found.tick[:count], found.answered[:count], found.status[:count], found.values[:count])
