"""Messages of the plant that wait a few milliseconds to be sent as one, for those who are in no hurry.

A put of its own costs the plant 20 to 40 us, since it wakes a thread of the bus, and wakes each reader (measured); to
add a message to a batch costs 1 us. Numbers and times are those that each message would have by itself, so that what is
lost of it is seen as before. Steps and commands are in the batch too: they go straight between plant and controllers,
and everyone else reads these copies.
"""

from __future__ import annotations

import time
from collections.abc import Callable

from rig.bus import messages

WAITS_NS = 25_000_000
"""Age [ns] at which the next message sends a batch; a plant sends it sooner by itself, 50 times a second."""
LONGEST = 1 << 15
"""Size [bytes] at which a batch is sent at once: half of what Zenoh sends in one piece."""


class Batch:
    """Collects messages and hands them to `send` as one payload. For one thread."""

    def __init__(self, send: Callable[[bytes], None]) -> None:
        self.gather: Callable[[], object] = lambda: None
        """Called before a batch is sent, to add what is collected elsewhere."""
        self._send = send
        self._places: dict[tuple[str, str], int] = {}
        """(user, topic) -> place in the batch."""
        self._rows: list[tuple[int, bytes, bytes]] = []
        self._size, self._due = 0, 0

    def add(self, user: str, topic: str, header: bytes, payload: bytes) -> None:
        """A message that `user` says on `topic`; `header`: its number and time as they are sent with it."""
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
        """Send what has been collected."""
        self._size, self._due = 0, time.monotonic_ns() + WAITS_NS  # what is added now must not begin this anew
        self.gather()
        if not self._rows:
            return
        users, names = zip(*self._places)
        places, headers, said = zip(*self._rows)
        batch = messages.TYPES["Batch"](user=users, topic=names, place=places, header=headers, said=said)
        self._places, self._rows, self._size = {}, [], 0
        self._send(batch.SerializeToString())
