"""The session of the bus between processes, over Zenoh.

Callbacks never call Zenoh: they only put what arrived into a queue.
"""

from __future__ import annotations

import atexit
import contextlib
import queue
import threading
import time
from collections.abc import Callable
from typing import Any

import zenoh

from rig.bus import messages, topics
from rig.bus.access import BusUser, take_seat
from rig.bus.address import Claim, is_live
from rig.bus.arrivals import HEADER, Arrived, Message
from rig.bus.batch import Batch
from rig.bus.inbound import InboundCheck, Row
from rig.bus.port import PRESENCES, Receiver, Session, Watch
from rig.bus.publisher import Publisher
from rig.bus.queries import WAITING, Answer, Request, Server
from rig.bus.waiting import Inbox, patiently
from rig.errors import BusError

_CLOSING_S = 2.0
_KEYS = 4096
_PUT = zenoh.SampleKind.PUT


class _Publisher(Publisher):
    def __init__(self, topic: str, publisher: zenoh.Publisher) -> None:
        super().__init__(topic)
        self._put = publisher.put

    def send(self, payload: bytes, header: bytes) -> None:
        try:
            self._put(header + payload)
        except zenoh.ZError as fault:
            raise BusError(f"{self.topic} could not be sent: {fault}") from None


def _who(key: Any, prefix: int) -> tuple[str, str]:
    """User and topic of a key `rig/<run>/<user>/<topic>`."""
    user, _, topic = str(key)[prefix:].partition("/")
    return user, topic


class _Receiver(Receiver):
    """Common part of the two receivers: converts what Zenoh delivers."""

    def __init__(
        self, door: InboundCheck, patterns: tuple[str, ...], depth: int, prefix: int, copies: Batch | None = None
    ) -> None:
        super().__init__(door, patterns, depth, copies)
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
        data, encoding = sample.payload.to_bytes(), "" if who in self.door.granted else str(sample.encoding)
        header, payload = data[: HEADER.size], data[HEADER.size :]
        return Arrived(user, topic, payload, header, sample.kind == _PUT, encoding, arrived_ns)

    def _usual(self, found: tuple[zenoh.Sample, int]) -> Message | None:
        sample, arrived_ns = found
        key = str(sample.key_expr)
        row = self._rows.get(key)
        if row is None or row.granted_by is not self.door.granted:
            row = self.door.row(*_who(key, self._prefix), self.counts)
            if row is None or not self._wanted(row.topic):
                return None
            if len(self._rows) >= _KEYS:
                self._rows.clear()
            self._rows[key] = row
        data = sample.payload.to_bytes()
        message = self.door.usual(row, data, arrived_ns)
        if message is not None and self._copies is not None:
            self._copies.add(row.user, row.topic, data[: HEADER.size], message.payload)
        return message


class _Queued(_Receiver):
    """A receiver that each message wakes; messages beyond the depth are dropped at the next read.

    Zenoh's thread puts messages into the queue directly. A Python function in between, to limit the queue, would hold
    the interpreter lock when the reader wakes: that costs 60 us of a round trip of 280 us (measured).
    """

    def __init__(
        self,
        door: InboundCheck,
        patterns: tuple[str, ...],
        depth: int,
        prefix: int,
        copies: Batch | None = None,
        stamped: bool = False,
    ) -> None:
        super().__init__(door, patterns, depth, prefix, copies)
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


class _Polled(_Receiver):
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


class _Watch(Watch):
    def __init__(self, door: InboundCheck, prefix: int) -> None:
        super().__init__(door)
        self._prefix = prefix
        self._inbox = Inbox[zenoh.Sample](PRESENCES)
        self.take = self._inbox.put

    def _next(self, timeout: float) -> Arrived | None:
        sample = self._inbox.take(timeout)
        if sample is None:
            return None
        return Arrived(*_who(sample.key_expr, self._prefix), put=sample.kind == _PUT)


class _Request(Request):
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


class _Server(Server):
    def __init__(self, door: InboundCheck, answer: Answer, key: str, topic: str) -> None:
        super().__init__(door, answer)
        self._key, self._topic = key, topic
        self._inbox = Inbox[zenoh.Query](WAITING)
        self.take = self._inbox.put  # Zenoh answers a dropped query for us: its asker learns that nobody answers

    def _next(self, timeout: float) -> Request | None:
        query = self._inbox.take(timeout)
        return None if query is None else _Request(query, self._key, self._topic)


class ZenohSession(Session):
    """A session that connects processes through Zenoh."""

    def __init__(
        self, run: str, role: str, seat: BusUser, opened: zenoh.Session, claim: Claim | None, shared: bool = False
    ) -> None:
        super().__init__(run, role, seat.name, seat.user, seat.reserved)
        self._zenoh, self._seat, self._claim = opened, seat, claim
        self._shared = shared
        """Whether another session owns the connection and closes it."""
        self._prefix, self._loop = f"rig/{run}/", f"loop/{run}/"
        self._mine = f"{self._prefix}{seat.user}/"
        self._declared: list[Any] = []
        self._closed = False
        atexit.register(self.close)

    def _publisher(self, topic: str) -> Publisher:
        declared = self._zenoh.declare_publisher(
            f"{self._root(topic)}{self.user}/{topic}",
            encoding=messages.encoding(topic),
            congestion_control=zenoh.CongestionControl.DROP,
            priority=getattr(zenoh.Priority, topics.of(topic).priority),
            express=False,
            allowed_destination=zenoh.Locality.REMOTE,  # nobody hears himself
        )
        self._declared.append(declared)
        return _Publisher(topic, declared)

    def _root(self, topic: str) -> str:
        return self._loop if topics.way(topic) == topics.LOOP else self._prefix

    def subscribe(self, *patterns: str, depth: int = 4096, polled: bool = False, stamped: bool = False) -> Receiver:
        """See `Session.subscribe`."""
        heard = topics.heard(patterns)
        root = self._root(heard)
        key = f"{root}{self._user_of(heard)}/{heard}"
        how = (self.door, patterns, depth, len(root), self._copies(patterns))
        found: _Polled | _Queued
        if polled:
            found = _Polled(*how)
            found.subscriber = self._zenoh.declare_subscriber(key, zenoh.handlers.RingChannel(depth))
            self._declared.append(found.subscriber)
        else:
            found = _Queued(*how, stamped)
            handler = zenoh.handlers.Callback(found.take, indirect=False)
            self._declared.append(self._zenoh.declare_subscriber(key, handler))
        self._receivers.append(found)
        return found

    def _user_of(self, pattern: str) -> str:
        """The user that publishes on topics of `pattern`, or "*" if unknown; "*" costs 25 us in a round trip."""
        name = topics.speaker(pattern)
        return name if name == "plant" or name in self.door.reserved else "*"  # else a guest, whose user is unknown

    def announce(self) -> None:
        """See `Session.announce`."""
        token = self._zenoh.liveliness().declare_token(f"{self._mine}alive/{self.role}/{self.name}")
        self._declared.append(token)

    def stand_in(self, role: str, name: str) -> Session:
        """See `Session.stand_in`."""
        seat = take_seat(self.run, role, name)
        self._stand_ins.append(ZenohSession(self.run, role, seat, self._zenoh, None, shared=True))
        return self._stand_ins[-1]

    def watch(self, who: str = "*/*") -> Watch:
        """See `Session.watch`."""
        found = _Watch(self.door, len(self._prefix))
        self._declared.append(
            self._zenoh.liveliness().declare_subscriber(
                f"{self._prefix}*/alive/{who}", zenoh.handlers.Callback(found.take, indirect=False), history=True
            )
        )
        return found

    def present(self, who: str = "*/*", timeout: float = 2.0) -> set[tuple[str, str]]:
        """See `Session.present`."""
        found = _Watch(self.door, len(self._prefix))
        try:
            for reply in self._zenoh.liveliness().get(f"{self._prefix}*/alive/{who}", timeout=timeout):
                if reply.ok is not None:
                    found.take(reply.ok)
        except zenoh.ZError as fault:
            raise BusError(f"the processes of run {self.run} could not be queried: {fault}") from None
        return found.all_here()

    def serve(self, topic: str, answer: Answer) -> Server:
        """See `Session.serve`."""
        self._own(topic)
        key = self._mine + topic
        found = _Server(self.door, answer, key, topic)
        handler = zenoh.handlers.Callback(found.take, indirect=False)
        self._declared.append(self._zenoh.declare_queryable(f"{key}/*", handler, complete=True))
        return found

    def _ask(self, topic: str, text: bytes, timeout: float) -> tuple[bool, bytes] | None:
        try:
            replies = self._zenoh.get(
                f"{self._prefix}{self._user_of(topic)}/{topic}/{self.user}",
                payload=text,
                timeout=timeout,
                congestion_control=zenoh.CongestionControl.DROP,  # the answer inherits this setting
            )
            for reply in replies:
                if reply.ok is not None:
                    return True, reply.ok.payload.to_bytes()
                said = reply.err.payload.to_bytes() if reply.err is not None else b""
                return None if said == b"Timeout" else (False, said)
        except zenoh.ZError as fault:
            raise BusError(f"the query {topic} could not be sent: {fault}") from None
        return None

    @property
    def ended(self) -> bool:
        """See `Session.ended`."""
        return self._claim is None and not is_live(self.run)

    def close(self) -> None:
        """See `Session.close`."""
        if self._closed:
            return
        self._closed = True
        for other in self._stand_ins:
            other.close()
        atexit.unregister(self.close)
        ending = threading.Thread(target=self._end, name="bus-close", daemon=True)  # a hung peer may block it for long
        try:
            ending.start()
            ending.join(_CLOSING_S)
        except RuntimeError:  # the interpreter is shutting down and starts no more threads
            self._end()
        self._seat.release()
        if self._claim is not None:
            self._claim.release()

    def _end(self) -> None:
        with contextlib.suppress(BusError):
            self.flush()
        for declared in reversed(self._declared):
            with contextlib.suppress(zenoh.ZError):
                declared.undeclare()
        if self._shared:
            return
        with contextlib.suppress(zenoh.ZError):
            self._zenoh.close()  # type: ignore[no-untyped-call]
