"""The journal of a run: its events in order, the same in every mode."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, NamedTuple

OPERATOR = "operator"
"""Value of `by` in the data of events that somebody outside the plant caused."""


class Event(NamedTuple):
    """One event: time, source, kind, text and data."""

    t_ns: int
    tick: int
    source: str
    kind: str
    text: str
    data: dict[str, Any]


class Journal:
    """The events of a run in order. `now()` returns the present tick."""

    def __init__(self, frame_ns: int, now: Callable[[], int], source: str = "plant") -> None:
        self.events: list[Event] = []
        """The events that nobody has taken."""
        self.count = 0
        """Number of events so far."""
        self._frame_ns = frame_ns
        self._now = now
        self._source = source
        self._apart = max(1_000_000_000 // frame_ns, 1)
        self._noted: dict[str, tuple[int, int]] = {}

    def note(self, kind: str, text: str, **data: Any) -> None:
        """Add an event of this tick."""
        self.note_at(self._now(), kind, text, **data)

    def note_at(self, tick: int, kind: str, text: str, **data: Any) -> None:
        """Add an event of tick `tick`."""
        self.events.append(Event(tick * self._frame_ns, tick, self._source, kind, text, data))
        self.count += 1

    def take(self) -> list[Event]:
        """The events since the last call, which the journal forgets: a live run would fill the memory with them."""
        taken = self.events
        self.events = []
        return taken

    def repeated(self, kind: str, text: str, **data: Any) -> None:
        """Add an event unless the same was added less than 1 s of simulated time ago; then only count it."""
        tick = self._now()
        key = f"{kind} {text}"
        last, unsaid = self._noted.get(key, (tick - self._apart, 0))
        if tick - last < self._apart:
            self._noted[key] = (last, unsaid + 1)
            return
        self._noted[key] = (tick, 0)
        self.note(kind, f"{text} ({unsaid} more since)" if unsaid else text, **data)
