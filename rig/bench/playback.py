"""The exchange of a re-simulation: recorded commands take effect at the same ticks with the same values."""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence

from rig.bench.command_queue import CommandQueue
from rig.bench.exchange import Exchange
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
    """An exchange that plays recorded commands and ignores controllers."""

    def play(self, recorded: Mapping[str, Commands]) -> None:
        """Take the commands of each controller from a recording."""
        self.played = {name: PlayedCommands(commands) for name, commands in recorded.items()}

    def receive(self, sender: str, answered: int, values: Sequence[float]) -> None:
        """Do nothing: commands of controllers are ignored."""

    def until(self, but: Collection[str] = ()) -> int | None:
        """The tick of the next recorded command; None if there is none.

        Ignores controllers whose admission is not in the recording. For the controllers in `but`, which the compiled
        loop handles, it is the tick of the first command that exceeds the loop's capacity.
        """
        due = [self._runner.tick + 1] if self._stairs else []
        played = [(name, one) for name, one in self.played.items() if name in self.lines]
        ticks = [one.due(ROWS if name in but else 0) for name, one in played]
        return min([*due, *(tick for tick in ticks if tick is not None)], default=None)

    def take_over(self) -> list[CommandQueue]:
        """Put into force the recorded commands of this tick."""
        tick, changed = self._runner.tick, self._changed
        changed.clear()
        for line in self._order:
            one = self.played.get(line.name)
            while one is not None and (due := one.due()) is not None and due <= tick:
                _, answered, status, values = (column[one.done].tolist() for column in one.commands)
                self.impose(line, answered, status, tuple(values))
                one.done += 1
                changed.append(line)
        if self._stairs:
            self._climb()
        return changed
