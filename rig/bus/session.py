"""The bus between processes, over Zenoh.

No call of Zenoh is made inside a callback: a callback only puts what arrived into a queue.
"""

from __future__ import annotations

import atexit
import contextlib
import json
import queue
import threading
import time
from collections.abc import Callable
from typing import Any

import zenoh

from rig.bus import messages, topics
from rig.bus.address import Claim
from rig.bus.port import HEADER, Answer, Message, Presence, Publisher, Receiver, Request, Server, Session, Watch
from rig.errors import BusError

_CLOSING_S = 2.0


class _Publisher(Publisher):
    def __init__(self, topic: str, publisher: zenoh.Publisher) -> None:
        super().__init__(topic)
        self._zenoh = publisher

    def _send(self, payload: bytes, header: bytes) -> None:
        try:
            self._zenoh.put(payload, attachment=header)
        except zenoh.ZError as fault:
            raise BusError(f"{self.topic} could not be sent: {fault}") from None


class _Receiver(Receiver):
    """Shared by both ways to wait: turns what Zenoh delivers into messages and refuses strangers."""

    def __init__(self, depth: int, prefix: int) -> None:
        super().__init__(depth)
        self._prefix = prefix

    def _message(self, sample: zenoh.Sample, arrived_ns: int = 0) -> Message:
        topic = str(sample.key_expr)[self._prefix :]
        attachment = sample.attachment
        if topic not in self.counts and str(sample.encoding) != messages.encoding(topic):
            raise BusError(
                f"{topic} speaks {sample.encoding}, this process {messages.encoding(topic)}: "
                "the processes of a run must come from the same installation"
            )
        if attachment is None:
            raise BusError(f"a message on {topic} carries no sequence number; something else publishes there")
        seq, t_ns = HEADER.unpack(attachment.to_bytes())
        return Message(topic, sample.payload.to_bytes(), seq, t_ns, arrived_ns)


class _Queued(_Receiver):
    """Woken by each message."""

    def __init__(self, depth: int, prefix: int, stamped: bool) -> None:
        super().__init__(depth, prefix)
        self._queue: queue.SimpleQueue[Any] = queue.SimpleQueue()
        put, clock = self._queue.put, time.monotonic_ns
        self._stamped = stamped
        self.take: Callable[[zenoh.Sample], None] = (lambda sample: put((sample, clock()))) if stamped else put

    def _waiting(self) -> int:
        return self._queue.qsize()

    def _next(self, timeout: float) -> Message | None:
        try:
            found = self._queue.get(timeout=timeout) if timeout > 0.0 else self._queue.get_nowait()
        except queue.Empty:
            return None
        return self._message(*found) if self._stamped else self._message(found)


class _Polled(_Receiver):
    """Messages wait in Zenoh's own channel and cost this process nothing until they are drained."""

    def __init__(self, depth: int, prefix: int) -> None:
        super().__init__(depth, prefix)
        self.subscriber: Any = None

    def _waiting(self) -> int:
        return 0  # the channel is a ring of `depth` and drops the oldest itself

    def _next(self, timeout: float) -> Message | None:
        deadline = time.monotonic() + timeout
        while True:
            try:
                sample = self.subscriber.try_recv()
            except zenoh.ZError:  # closed
                return None
            if sample is not None:
                return self._message(sample)
            if time.monotonic() >= deadline:
                return None
            time.sleep(0.001)


class _Watch(Watch):
    def __init__(self, prefix: int) -> None:
        super().__init__()
        self._prefix = prefix
        self._queue: queue.SimpleQueue[zenoh.Sample] = queue.SimpleQueue()
        self.take = self._queue.put

    def _next(self, timeout: float) -> Presence | None:
        try:
            sample = self._queue.get(timeout=timeout) if timeout > 0.0 else self._queue.get_nowait()
        except queue.Empty:
            return None
        _, role, name = str(sample.key_expr)[self._prefix :].split("/")
        return Presence(role, name, sample.kind == zenoh.SampleKind.PUT)


class _Request(Request):
    def __init__(self, query: zenoh.Query) -> None:
        self._query = query
        payload = query.payload
        self.body = json.loads(payload.to_bytes()) if payload is not None else {}

    def reply(self, text: bytes) -> None:
        with contextlib.suppress(zenoh.ZError), self._query as query:  # the asker may have gone
            query.reply(query.key_expr, text)

    def refuse(self, why: str) -> None:
        with contextlib.suppress(zenoh.ZError), self._query as query:
            query.reply_err(why.encode())


class _Server(Server):
    def __init__(self, answer: Answer) -> None:
        super().__init__(answer)
        self._queue: queue.SimpleQueue[zenoh.Query] = queue.SimpleQueue()
        self.take = self._queue.put

    def _next(self, timeout: float) -> Request | None:
        try:
            return _Request(self._queue.get(timeout=timeout) if timeout > 0.0 else self._queue.get_nowait())
        except queue.Empty:
            return None


class ZenohSession(Session):
    """A connection between processes."""

    def __init__(self, run: str, role: str, name: str, opened: zenoh.Session, claim: Claim | None) -> None:
        super().__init__(run, role, name)
        self._zenoh, self._claim = opened, claim
        self._prefix = f"rig/{run}/"
        self._declared: list[Any] = []
        self._closed = False
        atexit.register(self.close)

    def _publisher(self, topic: str) -> Publisher:
        declared = self._zenoh.declare_publisher(
            self._prefix + topic,
            encoding=messages.encoding(topic),
            congestion_control=zenoh.CongestionControl.DROP,
            priority=getattr(zenoh.Priority, topics.of(topic).priority),
            express=False,
            allowed_destination=zenoh.Locality.REMOTE,  # nobody hears himself
        )
        self._declared.append(declared)
        return _Publisher(topic, declared)

    def subscribe(self, pattern: str, depth: int = 4096, *, polled: bool = False, stamped: bool = False) -> Receiver:
        """See `Session.subscribe`."""
        key, prefix = self._prefix + pattern, len(self._prefix)
        found: _Polled | _Queued
        if polled:
            found = _Polled(depth, prefix)
            found.subscriber = self._zenoh.declare_subscriber(key, zenoh.handlers.RingChannel(depth))
            self._declared.append(found.subscriber)
        else:
            found = _Queued(depth, prefix, stamped)
            handler = zenoh.handlers.Callback(found.take, indirect=False)
            self._declared.append(self._zenoh.declare_subscriber(key, handler))
        self._receivers.append(found)
        return found

    def announce(self) -> None:
        """See `Session.announce`."""
        token = self._zenoh.liveliness().declare_token(f"{self._prefix}alive/{self.role}/{self.name}")
        self._declared.append(token)

    def watch(self, who: str = "*/*") -> Watch:
        """See `Session.watch`."""
        found = _Watch(len(self._prefix))
        self._declared.append(
            self._zenoh.liveliness().declare_subscriber(
                f"{self._prefix}alive/{who}", zenoh.handlers.Callback(found.take, indirect=False), history=True
            )
        )
        return found

    def serve(self, topic: str, answer: Answer) -> Server:
        """See `Session.serve`."""
        topics.of(topic)
        found = _Server(answer)
        handler = zenoh.handlers.Callback(found.take, indirect=False)
        self._declared.append(self._zenoh.declare_queryable(self._prefix + topic, handler, complete=True))
        return found

    def _ask(self, topic: str, text: bytes, timeout: float) -> tuple[bool, bytes] | None:
        try:
            replies = self._zenoh.get(
                self._prefix + topic,
                payload=text,
                timeout=timeout,
                congestion_control=zenoh.CongestionControl.DROP,  # the answer is sent as the question was
            )
            for reply in replies:
                if reply.ok is not None:
                    return True, reply.ok.payload.to_bytes()
                said = reply.err.payload.to_bytes() if reply.err is not None else b""
                return None if said == b"Timeout" else (False, said)
        except zenoh.ZError as fault:
            raise BusError(f"{topic} could not be asked: {fault}") from None
        return None

    def close(self) -> None:
        """See `Session.close`."""
        if self._closed:
            return
        self._closed = True
        atexit.unregister(self.close)
        ending = threading.Thread(target=self._end, name="bus-close", daemon=True)  # a hung peer may hold it for long
        try:
            ending.start()
            ending.join(_CLOSING_S)
        except RuntimeError:  # the interpreter is ending and starts no threads any more
            self._end()
        if self._claim is not None:
            self._claim.release()

    def _end(self) -> None:
        for declared in reversed(self._declared):
            with contextlib.suppress(zenoh.ZError):
                declared.undeclare()
        with contextlib.suppress(zenoh.ZError):
            self._zenoh.close()  # type: ignore[no-untyped-call]
