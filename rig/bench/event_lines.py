"""Events of a run as lines for the terminal."""

from __future__ import annotations

from collections.abc import Callable

from rig.bus.receivers import Receiver

_LINE = 400
"""Longest text of an event that is shown."""
ELSEWHERE = frozenset({"step", "overrun", "end", "verdict"})
"""Kinds of events that the live line or the summary shows; all others are shown as lines."""
MOST = 20
"""Most lines of one call."""


class EventLines:
    """Shows events of a run: `say` gets a line for each."""

    def __init__(self, say: Callable[[str], object]) -> None:
        self._say = say
        self.over = False
        """Whether the plant has announced the end of the run."""

    def show(self, events: Receiver) -> None:
        """Show the events that have arrived."""
        lines: list[str] = []
        for message in events.drain():
            event, who = message.said, message.topic[6:]  # of the topic's process, whatever the event says
            own = who == "plant"
            self.over = self.over or (own and event.kind == "end")
            if event.kind not in ELSEWHERE and not (self.over and event.kind == "left"):  # all leave at the end
                first = event.text.partition("\n")[0]
                text = "".join(filter(str.isprintable, f"{event.kind[:_LINE]}: {first[:_LINE]}"))
                lines.append(f"{event.t_ns / 1e9:9.3f} s  {'' if own else f'{who}: '}{text}")
        for line in lines[:MOST]:
            self._say(line)
        if len(lines) > MOST:
            self._say(f"            {len(lines) - MOST} more events: rig report shows those that are recorded")
