"""What a session declares at Zenoh: publishers, receivers, watches and servers.

Callbacks never call Zenoh: they only put what arrived into a queue.
"""

from __future__ import annotations

import contextlib
import queue
import time
from collections.abc import Callable
from typing import Any

import zenoh

from rig.bus.arrivals import HEADER, Arrived, Message
from rig.bus.batch import Batch
from rig.bus.inbound import InboundCheck, Row
from rig.bus.publisher import Publisher
from rig.bus.queries import WAITING, Answer, Request, Server
from rig.bus.receivers import PRESENCES, Receiver, Watch
from rig.bus.waiting import Inbox, patiently
from rig.errors import BusError

_KEYS = 4096  # most keys that a receiver remembers
_PUT = zenoh.SampleKind.PUT


class ZenohPublisher(Publisher):
    """A publisher over Zenoh. Raises BusError if a message cannot be sent."""

    def __init__(self, topic: str, publisher: zenoh.Publisher) -> None:
        super().__init__(topic)
        self._put = publisher.put

    def send(self, payload: bytes, header: bytes) -> None:
        """See `Publisher.send`."""
        try:
            self._put(header + payload)
        except zenoh.ZError as fault:
            raise BusError(f"{self.topic} could not be sent: {fault}") from None


def _who(key: Any, prefix: int) -> tuple[str, str]:
    """User and topic of a key `rig/<run>/<user>/<topic>`."""
    user, _, topic = str(key)[prefix:].partition("/")
    return user, topic


class _ZenohReceiver(Receiver):
    """Common part of the two receivers: converts what Zenoh delivers."""

    def __init__(
        self, inbound: InboundCheck, patterns: tuple[str, ...], depth: int, prefix: int, copies: Batch | None = None
    ) -> None:
        super().__init__(inbound, patterns, depth, copies)
        self._prefix = prefix
        self._who: dict[str, tuple[str, str]] = {}
        """Key -> user and topic."""
        self._rows: dict[str, Row] = {}
        """Key -> how to read its messages, known after the first one was accepted."""

    def _arrived(self, found: tuple[zenoh.Sample, int]) -> Arrived:
        sample, arrived_ns = found
        key = str(sample.key_expr)
        who = self._who.get(key)
        if who is None:
            if len(self._who) >= _KEYS:
                self._who.clear()
            who = self._who[key] = _who(key, self._prefix)
        user, topic = who
        data, encoding = sample.payload.to_bytes(), "" if who in self.inbound.granted else str(sample.encoding)
        header, payload = data[: HEADER.size], data[HEADER.size :]
        return Arrived(user, topic, payload, header, sample.kind == _PUT, encoding, arrived_ns)

    def _usual(self, found: tuple[zenoh.Sample, int]) -> Message | None:
        sample, arrived_ns = found
        key = str(sample.key_expr)
        row = self._rows.get(key)
        if row is None or row.granted_by is not self.inbound.granted:
            row = self.inbound.row(*_who(key, self._prefix), self.counts)
            if row is None or not self._wanted(row.topic):
                return None
            if len(self._rows) >= _KEYS:
                self._rows.clear()
            self._rows[key] = row
        data = sample.payload.to_bytes()
        message = self.inbound.usual(row, data, arrived_ns)
        if message is not None and self._copies is not None:
            self._copies.add(row.user, row.topic, data[: HEADER.size], message.payload)
        return message


class QueuedReceiver(_ZenohReceiver):
    """A receiver that each message wakes; messages beyond the depth are dropped at the next read.

    Zenoh's thread puts messages into the queue directly. A Python function in between, to limit the queue, would hold
    the interpreter lock when the reader wakes: that costs 60 us of a round trip of 280 us (measured).
    """

    def __init__(
        self,
        inbound: InboundCheck,
        patterns: tuple[str, ...],
        depth: int,
        prefix: int,
        copies: Batch | None = None,
        stamped: bool = False,
    ) -> None:
        super().__init__(inbound, patterns, depth, prefix, copies)
        self._queue: queue.SimpleQueue[Any] = queue.SimpleQueue()
        put, clock = self._queue.put, time.monotonic_ns
        self._stamped = stamped
        self.take: Callable[[zenoh.Sample], None] = (lambda sample: put((sample, clock()))) if stamped else put

    def _next(self, timeout: float) -> tuple[zenoh.Sample, int] | None:
        waiting = self._queue
        for _ in range(waiting.qsize() - self.depth):
            waiting.get_nowait()
        try:
            found = patiently(waiting, timeout) if timeout > 0.0 else waiting.get_nowait()
        except queue.Empty:
            return None
        return found if self._stamped else (found, 0)


class PolledReceiver(_ZenohReceiver):
    """A receiver whose messages wait in a ring buffer of Zenoh and cost this process nothing until they are drained."""

    subscriber: Any = None

    def _next(self, timeout: float) -> tuple[zenoh.Sample, int] | None:
        deadline = time.monotonic() + timeout
        while True:
            try:
                sample = self.subscriber.try_recv()
            except zenoh.ZError:  # closed
                return None
            if sample is not None:
                return sample, 0
            if time.monotonic() >= deadline:
                return None
            time.sleep(0.001)


class ZenohWatch(Watch):
    """A watch of presence tokens over Zenoh."""

    def __init__(self, inbound: InboundCheck, prefix: int) -> None:
        super().__init__(inbound)
        self._prefix = prefix
        self._inbox = Inbox[zenoh.Sample](PRESENCES)
        self.take = self._inbox.put

    def _next(self, timeout: float) -> Arrived | None:
        sample = self._inbox.take(timeout)
        if sample is None:
            return None
        return Arrived(*_who(sample.key_expr, self._prefix), put=sample.kind == _PUT)


class _ZenohRequest(Request):
    def __init__(self, query: zenoh.Query, key: str, topic: str) -> None:
        user = str(query.key_expr).rpartition("/")[2]
        self._query, self._key = query, f"{key}/{user}"
        payload = query.payload
        self.asked = Arrived(user, topic, payload.to_bytes() if payload is not None else b"")

    def reply(self, text: bytes) -> None:
        with contextlib.suppress(zenoh.ZError), self._query as query:  # the asker may have gone
            query.reply(self._key, text)

    def refuse(self, why: str) -> None:
        with contextlib.suppress(zenoh.ZError), self._query as query:
            query.reply_err(why.encode(errors="replace"))


class ZenohServer(Server):
    """A server of one query over Zenoh."""

    def __init__(self, inbound: InboundCheck, answer: Answer, key: str, topic: str) -> None:
        super().__init__(inbound, answer)
        self._key, self._topic = key, topic
        self._inbox = Inbox[zenoh.Query](WAITING)
        self.waiting = self._inbox.qsize
        self.take = self._inbox.put  # Zenoh answers a dropped query for us: its asker learns that nobody answers

    def _next(self, timeout: float) -> Request | None:
        query = self._inbox.take(timeout)
        return None if query is None else _ZenohRequest(query, self._key, self._topic)
