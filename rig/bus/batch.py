"""Batches: messages of the plant that wait a few milliseconds and are sent together, for readers without deadline.

A separate put costs the plant 20 to 40 us, because it wakes a thread of the bus, and it wakes each reader (measured).
Adding a message to a batch costs 1 us. Each message keeps its own number and time, so that readers still detect lost
messages. Batches also contain copies of steps and commands: the originals travel directly between plant and
controllers, and all other processes read the copies.
"""

from __future__ import annotations

import time
from collections.abc import Callable

from rig.bus import messages

WAITS_NS = 25_000_000
"""Age [ns] of a batch at which the next message sends it. A plant flushes 50 times a second, which is sooner."""
LONGEST = 1 << 15
"""Size [bytes] at which a batch is sent at once: half of what Zenoh sends in one piece."""


class Batch:
    """Collects messages and gives them to `send` as one payload. Not thread-safe."""

    def __init__(self, send: Callable[[bytes], None]) -> None:
        self.gather: Callable[[], object] = lambda: None
        """Called before a batch is sent; it may add more messages."""
        self._send = send
        self._places: dict[tuple[str, str], int] = {}
        """(user, topic) -> place in the batch."""
        self._rows: list[tuple[int, bytes, bytes]] = []
        self._size, self._due = 0, 0

    def add(self, user: str, topic: str, header: bytes, payload: bytes) -> None:
        """Add a message of `user` on `topic`; `header` contains its number and time, packed."""
        now, places = time.monotonic_ns(), self._places
        if not self._rows:
            self._due = now + WAITS_NS
        place = places.get((user, topic))
        if place is None:
            place = places[user, topic] = len(places)
        self._rows.append((place, header, payload))
        self._size += len(payload)
        if self._size >= LONGEST or now >= self._due:
            self.flush()

    def flush(self) -> None:
        """Send the collected messages as one batch."""
        self._size, self._due = 0, time.monotonic_ns() + WAITS_NS  # messages that `gather` adds must not flush again
        self.gather()
        if not self._rows:
            return
        users, names = zip(*self._places)
        places, headers, said = zip(*self._rows)
        batch = messages.TYPES["Batch"](user=users, topic=names, place=places, header=headers, said=said)
        self._places, self._rows, self._size = {}, [], 0
        self._send(batch.SerializeToString())
