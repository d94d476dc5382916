"""The session of the bus between processes, over Zenoh.

A session declares publishers, receivers, watches and servers at Zenoh. Callbacks never call Zenoh: they only put what
arrived into a bounded queue (`Inbox`), from which it is read with a timeout that signals cannot make endless
(`patiently`).

To encode a batch and to hand it to Zenoh takes 100 us or more: with the blocks of many sensors up to half of a frame.
The plant only puts it into a queue, and a thread (`Sender`) works while the plant waits for its next frame.
"""

from __future__ import annotations

import _signal
import atexit
import contextlib
import queue
import signal
import threading
import time
from collections.abc import Callable, Iterable
from contextlib import suppress
from typing import TYPE_CHECKING, Any, Generic, TypeVar

import zenoh

from rig.bus import messages, topics
from rig.bus.access import BusUser, take_user
from rig.bus.address import Reservation, is_live
from rig.bus.batch import Batch
from rig.bus.inbound import InboundCheck, Row
from rig.bus.port import PRESENCES, Receiver, Session, Watch
from rig.bus.publishers import Publisher
from rig.bus.queries import WAITING, Answer, Request, Server
from rig.bus.topics import HEADER, Arrived, Message
from rig.errors import BusError

if TYPE_CHECKING:
    from rig.bus.contact import Contact
    from rig.bus.tickets import Ticket

_SLICE_S = 0.1
"""Longest delay of a signal [s]. # chosen"""
_MASK: Any = getattr(_signal, "pthread_sigmask", None)
"""The function of the operating system: that of the module signal turns numbers into enums, which takes 10 us."""
_MAIN = threading.main_thread().ident
_SIGNALS = tuple(int(getattr(signal, s)) for s in ("SIGINT", "SIGTERM", "SIGHUP", "SIGXCPU") if hasattr(signal, s))
_BLOCK, _RESTORE = (int(getattr(signal, name, 0)) for name in ("SIG_BLOCK", "SIG_SETMASK"))

T = TypeVar("T")

_AT_ONCE: dict[str, Any] = {"congestion_control": zenoh.CongestionControl.DROP}
"""How a query is sent, and with it the answer."""
_WHOLE: dict[str, Any] = {
    "congestion_control": zenoh.CongestionControl.BLOCK,
    "priority": zenoh.Priority.DATA_LOW,
}
"""The models of a structure have megabytes, which DROP never delivers; what waits holds up its own priority alone."""
_LARGE = 60_000
"""Bytes of an answer that fits into one of Zenoh's batches."""
_MOST = 64
"""Number of waiting functions beyond which the plant waits too: one without a pace could outrun the sender."""
_SENDER_CLOSING_S = 1.0
"""Longest time for sending what still waits when the session closes."""

_JOINING = 0.5  # s after which the processes of a run have heard of each other
_KEYS = 4096  # most keys that a receiver remembers
_PUT = zenoh.SampleKind.PUT

_CLOSING_S = 2.0  # time allowed for closing the connection


def patiently(waiting: queue.SimpleQueue[T], timeout: float) -> T:
    """The next item of a queue; wait for it at most `timeout` seconds. Raises queue.Empty.

    In the main thread signals are blocked for slices of at most 0.1 s: a signal handler that lasts longer than the
    timeout would make `SimpleQueue.get` wait for ever (CPython 3.11: the remaining time becomes negative).
    """
    if waiting.qsize():
        return waiting.get_nowait()
    if _MASK is None or threading.get_ident() != _MAIN:
        return waiting.get(True, timeout)
    deadline = time.monotonic() + timeout
    left = timeout
    while True:
        before = _MASK(_BLOCK, _SIGNALS)
        try:
            return waiting.get(True, left if left < _SLICE_S else _SLICE_S)
        except queue.Empty:
            if left <= _SLICE_S:
                raise
        finally:
            _MASK(_RESTORE, before)
        left = max(deadline - time.monotonic(), 0.0)


class Inbox(Generic[T]):
    """A queue of at most `depth` items that drops the oldest when it is full. Any thread may fill and empty it."""

    def __init__(self, depth: int) -> None:
        self._queue: queue.SimpleQueue[T] = queue.SimpleQueue()
        self._depth = depth
        self.qsize = self._queue.qsize
        """The number of items in the queue."""

    def put(self, entry: T) -> None:
        """Add an item; drop the oldest one if there are more than `depth`."""
        self._queue.put(entry)
        if self._queue.qsize() > self._depth:
            with suppress(queue.Empty):
                self._queue.get_nowait()

    def take(self, timeout: float) -> T | None:
        """The oldest item; wait for it at most `timeout` seconds. None if there is none."""
        if timeout <= 0.0 and not self._queue.qsize():  # the usual case; an exception would take longer
            return None
        try:
            return patiently(self._queue, timeout) if timeout > 0.0 else self._queue.get_nowait()
        except queue.Empty:
            return None


class Sender:
    """Calls functions one after another in a thread of its own."""

    def __init__(self) -> None:
        self._queue: queue.SimpleQueue[Callable[[], None] | None] = queue.SimpleQueue()
        self._fault: BusError | None = None
        self._thread: threading.Thread | None = None

    def post(self, send: Callable[[], None]) -> None:
        """Have `send` called soon. Raises BusError if a former one has failed."""
        if self._fault is not None:
            raise self._fault
        if self._thread is None:
            self._thread = threading.Thread(target=self._work, name="sender", daemon=True)
            self._thread.start()
        while self._queue.qsize() > _MOST:
            time.sleep(0.001)
        self._queue.put(send)

    def _work(self) -> None:
        while (send := self._queue.get()) is not None:
            try:
                send()
            except BusError as fault:
                self._fault = fault
            except Exception as fault:  # of a function that encodes: it must neither be lost nor end this thread
                self._fault = BusError(f"a message could not be encoded: {fault!r}")

    def close(self) -> None:
        """Wait until everything is sent, and end the thread."""
        if self._thread is not None:
            self._queue.put(None)
            self._thread.join(_SENDER_CLOSING_S)


class _Publisher(Publisher):
    """A publisher over Zenoh. Raises BusError if a message cannot be sent."""

    def __init__(self, topic: str, publisher: zenoh.Publisher) -> None:
        super().__init__(topic)
        self._put = publisher.put

    def send(self, payload: bytes, header: bytes) -> None:
        try:
            self._put(header + payload)
        except zenoh.ZError as fault:
            raise BusError(f"{self.topic} could not be sent: {fault}") from None


def _user_and_topic(key: Any, prefix: int) -> tuple[str, str]:
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
        self._rows: dict[str, Row] = {}
        """Key -> how to read its messages, known after the first one was accepted."""

    def _arrived(self, delivered: tuple[zenoh.Sample, int]) -> Arrived:
        sample, arrived_ns = delivered
        who = _user_and_topic(sample.key_expr, self._prefix)
        data = sample.payload.to_bytes()
        encoding = "" if who in self.inbound.granted else str(sample.encoding)
        header = data[: HEADER.size]
        payload = data[HEADER.size :]
        return Arrived(*who, payload, header, sample.kind == _PUT, encoding, arrived_ns)

    def _usual(self, delivered: tuple[zenoh.Sample, int]) -> Message | None:
        sample, arrived_ns = delivered
        key = str(sample.key_expr)
        row = self._rows.get(key)
        if row is None or row.granted_by is not self.inbound.granted:
            row = self.inbound.row(*_user_and_topic(key, self._prefix), self.counts)
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


class _QueuedReceiver(_ZenohReceiver):
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
        put = self._queue.put
        clock = time.monotonic_ns
        self._stamped = stamped
        self.take: Callable[[zenoh.Sample], None] = (lambda sample: put((sample, clock()))) if stamped else put

    def _next(self, timeout: float) -> tuple[zenoh.Sample, int] | None:
        waiting = self._queue
        for _ in range(waiting.qsize() - self.depth):
            waiting.get_nowait()
        try:
            delivered = patiently(waiting, timeout) if timeout > 0.0 else waiting.get_nowait()
        except queue.Empty:
            return None
        return delivered if self._stamped else (delivered, 0)


class _PolledReceiver(_ZenohReceiver):
    """A receiver whose messages wait in a ring buffer of Zenoh and cost this process nothing until they are drained."""

    receive: Callable[[], zenoh.Sample | None]

    def _next(self, timeout: float) -> tuple[zenoh.Sample, int] | None:
        deadline = time.monotonic() + timeout
        while True:
            try:
                sample = self.receive()
            except zenoh.ZError:  # closed
                return None
            if sample is not None:
                return sample, 0
            if time.monotonic() >= deadline:
                return None
            time.sleep(0.001)


class _Watch(Watch):
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
        return Arrived(*_user_and_topic(sample.key_expr, self._prefix), put=sample.kind == _PUT)


class _Request(Request):
    def __init__(self, query: zenoh.Query, key: str, topic: str) -> None:
        user = str(query.key_expr).rpartition("/")[2]
        self._query = query
        self._key = f"{key}/{user}"
        payload = query.payload
        self.asked = Arrived(user, topic, payload.to_bytes() if payload is not None else b"")

    def reply(self, text: bytes) -> None:
        if len(text) > _LARGE:  # waits for the asker, as nobody else may
            threading.Thread(target=self._reply, args=(text,), name="bus-reply", daemon=True).start()
        else:
            self._reply(text)

    def _reply(self, text: bytes) -> None:
        with contextlib.suppress(zenoh.ZError), self._query as query:  # the asker may have gone
            query.reply(self._key, text)

    def refuse(self, why: str) -> None:
        with contextlib.suppress(zenoh.ZError), self._query as query:
            query.reply_err(why.encode(errors="replace"))


class _Server(Server):
    """A server of one query over Zenoh."""

    def __init__(self, inbound: InboundCheck, answer: Answer, key: str, topic: str) -> None:
        super().__init__(inbound, answer)
        self._key = key
        self._topic = topic
        self._inbox = Inbox[zenoh.Query](WAITING)
        self.waiting = self._inbox.qsize
        self.take = self._inbox.put  # Zenoh answers a dropped query for us: its asker learns that nobody answers

    def _next(self, timeout: float) -> Request | None:
        query = self._inbox.take(timeout)
        return None if query is None else _Request(query, self._key, self._topic)


class ZenohSession(Session):
    """A session that connects processes through Zenoh."""

    def __init__(
        self,
        run: str,
        role: str,
        bus_user: BusUser,
        opened: zenoh.Session,
        reservation: Reservation | None,
        shared: bool = False,
    ) -> None:
        super().__init__(run, role, bus_user.name, bus_user.user, bus_user.reserved)
        self._zenoh = opened
        self._bus_user = bus_user
        self._reservation = reservation
        self._shared = shared
        """Whether another session owns the connection and closes it."""
        self._prefix = f"rig/{run}/"
        self._loop = f"loop/{run}/"
        self._mine = f"{self._prefix}{bus_user.user}/"
        self._declared: list[Any] = []
        self._sender = Sender()
        self._closed = False
        self._held: list[BusUser] = []
        """Users of tickets: no process of this host can take their seats."""
        self._holders: dict[str, str] = {}
        """User of a ticket -> the connection that has its seat."""
        self._contact: Contact | None = None
        self._over = False
        """On another host than the plant's: whether the plant has said farewell."""
        atexit.register(self.close)

    def hold(self, users: Iterable[str]) -> None:
        """Keep the seats of the users of tickets; for the plant only. Operators have none."""
        for user in users:
            if user != "operator":
                self._held.append(take_user(self.run, "controller", user))
                self._holders[user] = ""

    def seat(self, user: str, holder: str) -> None:
        """See `Session.seat`."""
        if user in self._holders:
            before = self._holders[user]
            if before != holder and before in {str(link.zid) for link in self._zenoh.info.links()}:
                raise BusError(
                    f"the seat {user} is taken: another process uses this ticket, or has vanished in the last 30 s"
                )
            self._holders[user] = holder

    def depend(self, ticket: Ticket) -> None:
        """Be a session of another host than the plant's, with a ticket."""
        from rig.bus.contact import Contact  # imports ssl: only processes of other hosts wait for it

        self._contact = Contact(ticket)
        info = self._zenoh.info

        def changed(event: zenoh.LinkEvent) -> None:
            self.lost = self.lost or event.kind != _PUT

        def farewell(_: zenoh.Sample) -> None:
            self._over = True

        self._declared += [
            info.declare_link_events_listener(zenoh.handlers.Callback(changed, indirect=False)),
            self._zenoh.declare_subscriber(
                f"{self._prefix}plant/total/plant", zenoh.handlers.Callback(farewell, indirect=False)
            ),
        ]

    @property
    def holds(self) -> dict[str, str]:
        """See `Session.holds`."""
        return {} if self._contact is None else {"holds": str(self._zenoh.info.zid())}

    @property
    def gone(self) -> str:
        """See `Session.gone`."""
        return "" if self._contact is None or self._over or not self.lost else self._contact.loss()

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

    def _post(self, send: Callable[[], None]) -> None:
        self._sender.post(send)

    def subscribe(self, *patterns: str, depth: int = 4096, polled: bool = False, stamped: bool = False) -> Receiver:
        """See `Session.subscribe`."""
        heard = topics.heard(patterns)
        root = self._root(heard)
        key = f"{root}{self._user_of(heard)}/{heard}"
        how = (self.inbound, patterns, depth, len(root), self._copies(patterns))
        receiver = _PolledReceiver(*how) if polled else _QueuedReceiver(*how, stamped)
        if isinstance(receiver, _PolledReceiver):
            self._declared.append(self._zenoh.declare_subscriber(key, zenoh.handlers.RingChannel(depth)))
            receiver.receive = self._declared[-1].try_recv
        else:
            handler = zenoh.handlers.Callback(receiver.take, indirect=False)
            self._declared.append(self._zenoh.declare_subscriber(key, handler))
        self._receivers.append(receiver)
        return receiver

    def _user_of(self, pattern: str) -> str:
        """The user that publishes on topics of `pattern`, or "*" if unknown; "*" costs 25 us in a round trip."""
        name = topics.speaker(pattern)
        return name if name == "plant" or name in self.inbound.reserved else "*"  # else a guest, whose user is unknown

    def announce(self) -> None:
        """See `Session.announce`."""
        token = self._zenoh.liveliness().declare_token(f"{self._mine}alive/{self.role}/{self.name}")
        self._declared.append(token)

    def stand_in(self, role: str, name: str) -> Session:
        """See `Session.stand_in`."""
        bus_user = take_user(self.run, role, name)
        self._stand_ins.append(ZenohSession(self.run, role, bus_user, self._zenoh, None, shared=True))
        return self._stand_ins[-1]

    def watch(self, who: str = "*/*") -> Watch:
        """See `Session.watch`."""
        watcher = _Watch(self.inbound, len(self._prefix))
        self._declared.append(
            self._zenoh.liveliness().declare_subscriber(
                f"{self._prefix}*/alive/{who}", zenoh.handlers.Callback(watcher.take, indirect=False), history=True
            )
        )
        return watcher

    def present(self, who: str = "*/*", timeout: float = 2.0) -> set[tuple[str, str]]:
        """See `Session.present`."""
        watcher = _Watch(self.inbound, len(self._prefix))
        until = time.monotonic() + min(timeout, _JOINING)
        try:
            while True:
                for reply in self._zenoh.liveliness().get(f"{self._prefix}*/alive/{who}", timeout=timeout):
                    if reply.ok is not None:
                        watcher.take(reply.ok)
                if watcher.all_here() or time.monotonic() > until:
                    break
                time.sleep(0.02)  # a session that has just joined gets no answer from the others yet
        except zenoh.ZError as fault:
            raise BusError(f"the processes of run {self.run} could not be queried: {fault}") from None
        return watcher.all_here()

    def serve(self, topic: str, answer: Answer) -> Server:
        """See `Session.serve`."""
        self._own(topic)
        key = self._mine + topic
        server = _Server(self.inbound, answer, key, topic)
        handler = zenoh.handlers.Callback(server.take, indirect=False)
        self._declared.append(self._zenoh.declare_queryable(f"{key}/*", handler, complete=True))
        return server

    def _ask(self, topic: str, text: bytes, timeout: float) -> tuple[bool, bytes] | None:
        try:
            replies = self._zenoh.get(
                f"{self._prefix}{self._user_of(topic)}/{topic}/{self.user}",
                payload=text,
                timeout=timeout,
                **(_WHOLE if topic == "scene" else _AT_ONCE),
            )
            for reply in replies:
                if reply.ok is not None:
                    return True, reply.ok.payload.to_bytes()
                payload = reply.err.payload.to_bytes() if reply.err is not None else b""
                return None if payload == b"Timeout" else (False, payload)
        except zenoh.ZError as fault:
            raise BusError(f"the query {topic} could not be sent: {fault}") from None
        return None

    @property
    def ended(self) -> bool:
        """See `Session.ended`."""
        if self._contact is not None:
            return self.lost
        return self._reservation is None and not is_live(self.run)

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
        for bus_user in (self._bus_user, *self._held):
            bus_user.release()
        if self._reservation is not None:
            self._reservation.release()

    def _end(self) -> None:
        with contextlib.suppress(BusError):
            self.flush()
        self._sender.close()
        for declared in reversed(self._declared):
            with contextlib.suppress(zenoh.ZError):
                declared.undeclare()
        if self._shared:
            return
        with contextlib.suppress(zenoh.ZError):
            self._zenoh.close()  # type: ignore[no-untyped-call]
