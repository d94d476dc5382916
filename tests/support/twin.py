"""The bus within one process: the sessions of `rig.bus` without Zenoh, for tests that need no processes."""

from __future__ import annotations

import threading
import time

from rig.bus import messages, topics
from rig.bus.batch import Batch
from rig.bus.inbound import InboundCheck
from rig.bus.port import PRESENCES, Receiver, Session, Watch
from rig.bus.publishers import Publisher
from rig.bus.queries import WAITING, Answer, Request, Server
from rig.bus.session import Inbox
from rig.bus.topics import Arrived


class Twin:
    """The hub of one run; `open` a session for each that takes part. Sessions may live in different threads."""

    def __init__(self, run: str = "twin") -> None:
        self.run = run
        self._lock = threading.RLock()
        self.receivers: list[_Receiver] = []
        self.watches: list[tuple[str, _Watch]] = []
        self.servers: dict[str, _Server] = {}
        self._alive: list[tuple[str, str]] = []

    def open(self, role: str, name: str) -> Session:
        """A session for the one who plays `role` under `name`."""
        return TwinSession(self, role, name)

    def receivers_of(self, topic: str, speaker: Session) -> list[_Receiver]:
        """Everyone who wants `topic`, but for the one who speaks."""
        with self._lock:
            looped = topics.way(topic) == topics.LOOP
            return [
                r
                for r in self.receivers
                if r.owner is not speaker and topics.matches(r.heard, topic) and not (looped and r.heard == "**")
            ]

    def listen(self, receiver: _Receiver) -> None:
        """Deliver to `receiver` from now on."""
        with self._lock:
            self.receivers.append(receiver)

    def look(self, who: str, watch: _Watch) -> None:
        """Tell `watch` who is here, and of everyone who comes and goes."""
        with self._lock:
            self.watches.append((who, watch))
            for role, name in self._alive:
                if topics.matches(who, f"{role}/{name}"):
                    watch.queue.put(Arrived(name, f"alive/{role}/{name}"))

    def here(self, who: str) -> set[tuple[str, str]]:
        """Role and name of everyone who has joined and fits `who`."""
        with self._lock:
            return {(role, name) for role, name in self._alive if topics.matches(who, f"{role}/{name}")}

    def tell(self, role: str, name: str, here: bool) -> None:
        """Someone joins or leaves."""
        with self._lock:
            (self._alive.append if here else self._alive.remove)((role, name))
            for who, watch in self.watches:
                if topics.matches(who, f"{role}/{name}"):
                    watch.queue.put(Arrived(name, f"alive/{role}/{name}", put=here))

    @property
    def has_plant(self) -> bool:
        """Whether somebody is the plant."""
        with self._lock:
            return any(role == "plant" for role, _ in self._alive)

    def offer(self, topic: str, server: _Server) -> None:
        """Let `server` answer questions on `topic`."""
        with self._lock:
            self.servers[topic] = server

    def server_of(self, topic: str) -> _Server | None:
        """Who answers `topic`."""
        with self._lock:
            return self.servers.get(topic)

    def forget(self, receivers: list[Receiver], servers: list[_Server]) -> None:
        """A session has closed."""
        with self._lock:
            self.receivers = [one for one in self.receivers if one not in receivers]
            self.servers = {topic: server for topic, server in self.servers.items() if server not in servers}


class _Publisher(Publisher):
    def __init__(self, topic: str, hub: Twin, speaker: Session) -> None:
        super().__init__(topic)
        self._hub, self._speaker = hub, speaker
        self._encoding = messages.encoding(topic)

    def send(self, payload: bytes, header: bytes) -> None:
        for receiver in self._hub.receivers_of(self.topic, self._speaker):
            now = time.monotonic_ns() if receiver.stamped else 0
            receiver.queue.put(Arrived(self._speaker.user, self.topic, payload, header, True, self._encoding, now))


class _Receiver(Receiver):
    def __init__(
        self, owner: Session, patterns: tuple[str, ...], depth: int, stamped: bool, copies: Batch | None
    ) -> None:
        super().__init__(owner.inbound, patterns, depth, copies)
        self.owner, self.stamped = owner, stamped
        self.queue = Inbox[Arrived](depth)

    def _next(self, timeout: float) -> Arrived | None:
        return self.queue.take(timeout)

    def _arrived(self, found: Arrived) -> Arrived:
        return found


class _Watch(Watch):
    def __init__(self, door: InboundCheck) -> None:
        super().__init__(door)
        self.queue = Inbox[Arrived](PRESENCES)

    def _next(self, timeout: float) -> Arrived | None:
        return self.queue.take(timeout)


class Asked(Request):
    """A question, and where its answer is put."""

    def __init__(self, asked: Arrived) -> None:
        self.asked = asked
        self.answer = Inbox[tuple[bool, bytes]](1)

    def reply(self, text: bytes) -> None:
        self.answer.put((True, text))

    def refuse(self, why: str) -> None:
        self.answer.put((False, why.encode(errors="replace")))


class _Server(Server):
    def __init__(self, door: InboundCheck, answer: Answer) -> None:
        super().__init__(door, answer)
        self.queue = Inbox[Asked](WAITING)
        self.waiting = self.queue.qsize

    def _next(self, timeout: float) -> Request | None:
        return self.queue.take(timeout)


class TwinSession(Session):
    def __init__(self, hub: Twin, role: str, name: str) -> None:
        super().__init__(hub.run, role, name, name, frozenset({"plant", "operator"}))
        self._hub = hub
        self._servers: list[_Server] = []
        self._announced = False

    def _publisher(self, topic: str) -> Publisher:
        return _Publisher(topic, self._hub, self)

    def subscribe(self, *patterns: str, depth: int = 4096, polled: bool = False, stamped: bool = False) -> Receiver:
        found = _Receiver(self, patterns, depth, stamped, self._copies(patterns))
        self._hub.listen(found)
        self._receivers.append(found)
        return found

    def announce(self) -> None:
        self._hub.tell(self.role, self.name, True)
        self._announced = True

    def leave(self) -> None:
        """Take back what `announce` has told."""
        if self._announced:
            self._hub.tell(self.role, self.name, False)
            self._announced = False

    def stand_in(self, role: str, name: str) -> Session:
        self._stand_ins.append(self._hub.open(role, name))
        return self._stand_ins[-1]

    def watch(self, who: str = "*/*") -> Watch:
        found = _Watch(self.inbound)
        self._hub.look(who, found)
        return found

    def present(self, who: str = "*/*", timeout: float = 2.0) -> set[tuple[str, str]]:
        return self._hub.here(who)

    def serve(self, topic: str, answer: Answer) -> Server:
        self._own(topic)
        found = _Server(self.inbound, answer)
        self._hub.offer(topic, found)
        self._servers.append(found)
        return found

    def _ask(self, topic: str, text: bytes, timeout: float) -> tuple[bool, bytes] | None:
        server = self._hub.server_of(topic)
        if server is None:
            return None
        request = Asked(Arrived(self.user, topic, text))
        server.queue.put(request)
        return request.answer.take(timeout)

    @property
    def ended(self) -> bool:
        return not self._hub.has_plant

    def close(self) -> None:
        for other in self._stand_ins:
            other.close()
        self.flush()
        self._hub.forget(self._receivers, self._servers)
        self.leave()
