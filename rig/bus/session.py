"""The session of the bus between processes, over Zenoh."""

from __future__ import annotations

import atexit
import contextlib
import threading
from collections.abc import Callable
from typing import Any

import zenoh

from rig.bus import messages, topics
from rig.bus.access import BusUser, take_user
from rig.bus.address import Reservation, is_live
from rig.bus.port import Session
from rig.bus.publisher import Publisher
from rig.bus.queries import Answer, Server
from rig.bus.receivers import Receiver, Watch
from rig.bus.sender import Sender
from rig.bus.zenoh_endpoints import PolledReceiver, QueuedReceiver, ZenohPublisher, ZenohServer, ZenohWatch
from rig.errors import BusError

_CLOSING_S = 2.0  # time allowed for closing the connection


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
        self._zenoh, self._bus_user, self._reservation = opened, bus_user, reservation
        self._shared = shared
        """Whether another session owns the connection and closes it."""
        self._prefix, self._loop = f"rig/{run}/", f"loop/{run}/"
        self._mine = f"{self._prefix}{bus_user.user}/"
        self._declared: list[Any] = []
        self._sender = Sender()
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
        return ZenohPublisher(topic, declared)

    def _root(self, topic: str) -> str:
        return self._loop if topics.way(topic) == topics.LOOP else self._prefix

    def _post(self, send: Callable[[], None]) -> None:
        """See `Session._post`."""
        self._sender.post(send)

    def subscribe(self, *patterns: str, depth: int = 4096, polled: bool = False, stamped: bool = False) -> Receiver:
        """See `Session.subscribe`."""
        heard = topics.heard(patterns)
        root = self._root(heard)
        key = f"{root}{self._user_of(heard)}/{heard}"
        how = (self.inbound, patterns, depth, len(root), self._copies(patterns))
        found: PolledReceiver | QueuedReceiver
        if polled:
            found = PolledReceiver(*how)
            found.subscriber = self._zenoh.declare_subscriber(key, zenoh.handlers.RingChannel(depth))
            self._declared.append(found.subscriber)
        else:
            found = QueuedReceiver(*how, stamped)
            handler = zenoh.handlers.Callback(found.take, indirect=False)
            self._declared.append(self._zenoh.declare_subscriber(key, handler))
        self._receivers.append(found)
        return found

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
        found = ZenohWatch(self.inbound, len(self._prefix))
        self._declared.append(
            self._zenoh.liveliness().declare_subscriber(
                f"{self._prefix}*/alive/{who}", zenoh.handlers.Callback(found.take, indirect=False), history=True
            )
        )
        return found

    def present(self, who: str = "*/*", timeout: float = 2.0) -> set[tuple[str, str]]:
        """See `Session.present`."""
        found = ZenohWatch(self.inbound, len(self._prefix))
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
        found = ZenohServer(self.inbound, answer, key, topic)
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
                payload = reply.err.payload.to_bytes() if reply.err is not None else b""
                return None if payload == b"Timeout" else (False, payload)
        except zenoh.ZError as fault:
            raise BusError(f"the query {topic} could not be sent: {fault}") from None
        return None

    @property
    def ended(self) -> bool:
        """See `Session.ended`."""
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
        self._bus_user.release()
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
