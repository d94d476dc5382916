"""Batches: messages of the plant that wait a few milliseconds and are sent together, for readers without deadline.

A separate put costs the plant 20 to 40 us, because it wakes a thread of the bus, and it wakes each reader (measured).
Adding a message to a batch costs 1 us: it is encoded when the batch is. Each message keeps its own number and time, so
that readers still detect lost messages. Batches also contain copies of steps and commands: the originals travel
directly between plant and controllers, and all other processes read the copies.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator
from typing import Any

from rig.bus.messages import TYPES
from rig.bus.topics import HEADER

WAITS_NS = 25_000_000
"""Age [ns] of a batch at which it is sent. A plant flushes 50 times a second: sooner."""
EVERY = 16
"""Messages of a batch between two checks of its age."""
LONGEST = 1 << 15
"""Size [bytes] at which encoded messages are sent, and of the pieces of a batch: half of what Zenoh sends in one."""
_KEEPING = 7000  # bytes that Zenoh needs to keep a batch, in addition to its payload (measured)
WAITING = (160 << 20) // (LONGEST + _KEEPING)
"""Most batches that wait in the memory of a recorder: 160 MB."""

Row = tuple[str, str, bytes | tuple[int, int], Callable[..., bytes], tuple[Any, ...]]
"""User, topic, header (packed, or number and time), and the function that encodes the message, with its arguments."""


class Batch:
    """Collects messages and gives them to `send`. Not thread-safe."""

    def __init__(self, send: Callable[[list[Row]], None]) -> None:
        self.gather: Callable[[], object] = lambda: None
        """Called before a batch is sent; it may add more messages."""
        self.rows: list[Row] = []
        """The collected messages. A plant appends to it, which costs it less than a call; then `flush_if_due`."""
        self._send = send
        self._size = 0
        self._due = 0

    def add(self, user: str, topic: str, header: bytes, payload: bytes) -> None:
        """Add an encoded message of `user` on `topic`; `header` contains its number and time, packed."""
        self._size += len(payload)
        self.rows.append((user, topic, header, bytes, (payload,)))
        if not len(self.rows) % EVERY:
            self.flush_if_due()
        if self._size >= LONGEST:
            self.flush()

    def flush_if_due(self) -> None:
        """Send the messages if they have waited long enough; to be called after every `EVERY` messages."""
        if time.monotonic_ns() >= self._due:
            self.flush()

    def flush(self) -> None:
        """Send the collected messages as one batch."""
        self._size = 0
        self._due = time.monotonic_ns() + WAITS_NS  # messages that `gather` adds must not flush again
        self.gather()
        if self.rows:
            rows = self.rows
            self.rows = []
            self._size = 0
            self._send(rows)


def encoded_batches(rows: list[Row]) -> Iterator[bytes]:
    """Encode messages as Batches of about `LONGEST` bytes."""
    places: dict[tuple[str, str], int] = {}
    columns: list[tuple[int, bytes, bytes]] = []
    size = 0
    for user, topic, header, encode, given in rows:
        content = encode(*given)
        packed = header if isinstance(header, bytes) else HEADER.pack(*header)
        columns.append((places.setdefault((user, topic), len(places)), packed, content))
        size += len(content)
        if size >= LONGEST:
            yield _encoded(places, columns)
            places = {}
            columns = []
            size = 0
    if columns:
        yield _encoded(places, columns)


def _encoded(places: dict[tuple[str, str], int], columns: list[tuple[int, bytes, bytes]]) -> bytes:
    users, names = zip(*places)
    place, headers, contents = zip(*columns)
    batch = TYPES["Batch"](user=users, topic=names, place=place, header=headers, said=contents)
    return bytes(batch.SerializeToString())
