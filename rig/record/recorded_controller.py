"""What a recording contains of one controller: its commands, changes of its parameters, when it took part."""

from __future__ import annotations

import json
from dataclasses import dataclass, field
from typing import Any

from rig.controllers.runtime.skipped import KIND
from rig.record.message_scan import Record


@dataclass
class RecordedController:
    """The recorded messages of the controller `name`.

    `saved`: of a run in one process, whose controllers work from the begin to the end and publish nothing themselves.
    """

    name: str
    saved: bool
    answers: dict[int, tuple[float, ...]] = field(default_factory=dict)
    """Tick -> command as it was sent."""
    skipped: list[dict[str, Any]] = field(default_factory=list)
    """Data of its events about steps that it did not answer."""
    tuned: dict[int, dict[str, Any]] = field(default_factory=dict)
    """Tick after which parameters were changed -> changes."""
    lives: list[list[int]] = field(default_factory=list)
    """First and last tick of each process of this name that answered: one that was killed may have a successor."""
    _here: bool = False
    _number: int = 0

    def note(self, record: Record, content: Any) -> None:
        """Add a message of the recording, if it is about this controller."""
        kind, _, sender = record.topic.partition("/")
        if kind == "event" and sender == "plant" and content.kind == "begin":
            self._here = self.name in _content_of(content).get("here", ())
        elif kind == "event" and sender == self.name and content.kind == "parameter":
            data = _content_of(content)
            self._tune(data.get("after_tick"), data.get("set"))
        elif kind == "event" and sender == self.name and content.kind == KIND:
            self.skipped.append(_content_of(content))
        elif kind == "event" and sender == "plant" and content.kind == "parameter" and self.saved:
            self._note_protocol(content)
        elif kind == "act" and sender == self.name:
            self.answers[content.tick] = tuple(content.values)
            if not self.saved:
                self._live(content.tick, record.seq)

    def _note_protocol(self, content: Any) -> None:
        """Add a change by the protocol."""
        begin = f"controllers.{self.name}."
        changes = _content_of(content).get("set")
        if isinstance(changes, dict):
            mine = {key.removeprefix(begin): value for key, value in changes.items() if key.startswith(begin)}
            if mine:
                self._tune(content.tick - 1, mine)  # it is made before the step of that tick is answered

    def _tune(self, tick: Any, changes: Any) -> None:
        if isinstance(tick, int) and isinstance(changes, dict):  # otherwise time or content is unknown: skip it
            self.tuned.setdefault(tick, {}).update(changes)

    def _live(self, tick: int, number: int) -> None:
        if not self.lives:
            self.lives.append([0 if self._here else tick, tick])
        elif number < self._number:  # a process counts its messages from 0
            self.lives.append([tick, tick])
        self.lives[-1][1] = tick
        self._number = number

    @property
    def begins(self) -> list[int]:
        """The ticks at which a process of this controller joined, at least one."""
        return [first for first, _ in self.lives] or [0]

    def silent_at(self, tick: int) -> bool:
        """Whether the recording lacks the command that answers this step, although the controller took part."""
        return tick not in self.answers and any(first <= tick <= last for first, last in self.lives)


def _content_of(event: Any) -> dict[str, Any]:
    data = json.loads(event.data or "{}")
    return data if isinstance(data, dict) else {}
