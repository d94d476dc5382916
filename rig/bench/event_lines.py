"""Events of a run as lines for the terminal."""

from __future__ import annotations

from collections.abc import Callable

from rig.bus.receivers import Receiver

_LINE = 400
"""Longest text of an event that is shown."""
SHOWN = frozenset(
    "begin joined left mark timeout parameter knock limit emergency diverged fault never "
    "missing safe back refused flood overruled evicted pause warning".split()
)
"""Kinds of events that are shown during the run."""


class EventLines:
    """Shows events of a run: `say` gets a line for each."""

    def __init__(self, say: Callable[[str], object]) -> None:
        self._say = say
        self.over = False
        """Whether the plant has announced the end of the run."""

    def show(self, events: Receiver) -> None:
        """Show the events that have arrived."""
        for message in events.drain():
            event, who = message.said, message.topic[6:]  # of the topic's process, whatever the event says
            own = who == "plant"
            self.over = self.over or (own and event.kind == "end")
            if event.kind in SHOWN and not (self.over and event.kind == "left"):  # all leave at the end
                text = "".join(filter(str.isprintable, event.text.partition("\n")[0][:_LINE]))
                self._say(f"{event.t_ns / 1e9:9.3f} s  {'' if own else f'{who}: '}{event.kind}: {text}")
