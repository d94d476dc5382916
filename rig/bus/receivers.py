"""What a process receives on the bus: messages of topics, and the presence of other processes.

Every message has a header of 16 bytes before its payload: its number on this topic, counted from 0 by the publisher,
and the simulated time. A missing number shows the receiver that a message was lost. Messages lost after the last one
received show when the sender publishes its totals.
"""

from __future__ import annotations

import time
from abc import ABC, abstractmethod
from collections import deque
from typing import Any

from rig.bus import topics
from rig.bus.arrivals import Arrived, Count, Message, Presence, Refused
from rig.bus.batch import Batch
from rig.bus.inbound import InboundCheck

_MOST, _TOPICS = 256, 4096
"""Most items that one call processes, so that a flood of messages cannot block it."""
DRAINED = 1 << 14
"""Most messages that one call of `Receiver.drain` returns."""
PRESENCES = 1 << 14
"""Most presence tokens that wait to be read."""


class Receiver(ABC):
    """Receives messages whose topic matches one of some patterns.

    At most `depth` messages wait; beyond that the oldest are dropped. A batch counts as one waiting message.
    """

    def __init__(
        self, inbound: InboundCheck, patterns: tuple[str, ...], depth: int, copies: Batch | None = None
    ) -> None:
        self.inbound, self.patterns, self.depth = inbound, patterns, depth
        self.heard = topics.heard(patterns)
        """The pattern to which it is subscribed; it may match more topics than `patterns`."""
        self.counts: dict[str, Count] = {}
        self._wants: dict[str, bool] = {"batch": True}
        self._opened: deque[Arrived] = deque()
        """Messages of the last batch that are not read yet."""
        self._copies = copies
        """The batch to which the plant adds copies of the commands it accepts."""

    @abstractmethod
    def _next(self, timeout: float) -> Any:
        """The oldest waiting item as the transport delivered it, or None after `timeout` seconds."""

    @abstractmethod
    def _arrived(self, found: Any) -> Arrived:
        """Convert what the transport delivered to raw data; nothing is checked."""

    def _usual(self, found: Any) -> Message | None:
        """Short path for the next message of a known topic: check, count and copy it. None: take the long path."""
        return None

    def _wanted(self, topic: str) -> bool:
        """Whether a topic matches one of the patterns."""
        wanted = self._wants.get(topic)
        if wanted is None:
            if len(self._wants) >= _TOPICS:
                self._wants = {"batch": True}
            wanted = self._wants[topic] = any(topics.matches(pattern, topic) for pattern in self.patterns)
        return wanted

    def _message(self, arrived: Arrived) -> Message:
        if not self._wanted(arrived.topic):
            raise Refused("not asked for", f"{arrived.topic[:80]} does not match {', '.join(self.patterns)}")
        return self.inbound.message(arrived, self.counts)

    def get(self, timeout: float = 0.0) -> Message | None:
        """The oldest accepted message; wait for it at most `timeout` seconds. None if there is none."""
        deadline = time.monotonic() + timeout if timeout else 0.0
        for _ in range(_MOST):
            if self._opened:
                arrived = self._opened.popleft()
            else:
                found = self._next(timeout)
                if found is None:
                    return None
                if (message := self._usual(found)) is not None:
                    return message
                arrived = self._arrived(found)
            if arrived.topic == "batch":
                inside = self.inbound.let_in(self.inbound.opened, arrived) or ()
                self._opened.extend([one for one in inside if self._wanted(one.topic)])
            elif self.heard != "**" or self._wanted(arrived.topic):
                message = self.inbound.let_in(self._message, arrived)
                if message is not None:
                    if self._copies is not None and arrived.header is not None:
                        self._copies.add(arrived.user, arrived.topic, arrived.header, arrived.payload)
                    return message
            timeout = max(deadline - time.monotonic(), 0.0) if timeout else 0.0
        return None

    def drain(self) -> list[Message]:
        """All messages that wait now, at most `DRAINED`."""
        found: list[Message] = []
        while len(found) < DRAINED and (one := self.get()) is not None:
            found.append(one)
        return found

    @property
    def received(self) -> int:
        """Number of messages received on all topics."""
        return sum(count.received for count in self.counts.values())

    @property
    def lost(self) -> int:
        """Number of messages lost between the first and the last one received, on all topics."""
        return sum(count.lost for count in self.counts.values())


class Watch(ABC):
    """Observes which processes join and leave the run."""

    def __init__(self, inbound: InboundCheck) -> None:
        self.inbound = inbound
        self.present: set[tuple[str, str]] = set()
        """(role, name) of every process that is present, as of the last `poll`."""
        self._held: dict[str, tuple[str, str]] = {}
        """User -> its (role, name). Operators share one user and do not announce themselves."""

    @abstractmethod
    def _next(self, timeout: float) -> Arrived | None: ...

    def poll(self, timeout: float = 0.0) -> list[Presence]:
        """Processes that joined or left since the last call; wait at most `timeout` seconds for the first change."""
        changes: list[Presence] = []
        for _ in range(_MOST):
            arrived = self._next(0.0 if changes else timeout)
            if arrived is None:
                break
            found = self.inbound.let_in(self.inbound.presence, arrived)
            if found is None:
                continue
            who = (found.role, found.name)
            if self._held.get(arrived.user, who) != who:  # a process has one name only
                self.inbound.count(arrived.user, Refused("a second name"))
            elif found.here and len(self.present) >= _MOST:
                self.inbound.count("others", Refused("too many"))
            elif found.here != (who in self.present):
                if found.here:
                    self.present.add(who)
                    self._held[arrived.user] = who
                else:
                    self.present.discard(who)
                    self._held.pop(arrived.user, None)
                changes.append(found)
        return changes

    def all_here(self) -> set[tuple[str, str]]:
        """(role, name) of every process that is present, after all waiting changes are processed."""
        for _ in range(PRESENCES // _MOST):
            self.poll()
        return self.present

    def wait_for(self, role: str, name: str, timeout: float) -> bool:
        """Whether the process `name` in `role` is present; wait for it at most `timeout` seconds."""
        deadline = time.monotonic() + timeout
        self.poll()
        while (role, name) not in self.present and (left := deadline - time.monotonic()) > 0.0:
            self.poll(left)
        return (role, name) in self.present
