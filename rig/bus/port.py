"""What a process sees of the bus: publishers, receivers, signs of life, questions and answers.

The classes here count; how bytes travel is the business of `rig.bus.session` (Zenoh, between processes) and
`rig.bus.twin` (within one process). Every message carries 16 bytes beside its payload: its number on this topic,
counted from 0 by the publisher, and the simulated time. A receiver that finds a number missing has lost a message;
what was lost after the last one it got shows when the sender tells its totals.
"""

from __future__ import annotations

import json
import struct
import time
from abc import ABC, abstractmethod
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, NamedTuple

from rig.bus import messages, topics
from rig.errors import BusError, RigError

HEADER = struct.Struct("<QQ")


class Message(NamedTuple):
    """One message as it arrived. `arrived_ns` is the monotonic clock at arrival, 0 unless the receiver stamps."""

    topic: str
    payload: bytes
    seq: int
    t_ns: int
    arrived_ns: int = 0


@dataclass
class Count:
    """What has been seen of one topic."""

    received: int = 0
    lost: int = 0
    """Numbers missing between the first and the last message received."""
    first: int = -1
    last: int = -1

    def see(self, seq: int) -> None:
        """Count a message; a number that is not above the last one means that the publisher started anew."""
        if seq > self.last >= 0:
            self.lost += seq - self.last - 1
        elif self.last < 0:
            self.first = seq
        self.last = seq
        self.received += 1

    def tail(self, sent: int) -> int:
        """Messages lost after the last one received, once it is known that `sent` were sent."""
        return max(sent - 1 - self.last, 0)


class Presence(NamedTuple):
    """Someone joined (`here`) or left."""

    role: str
    name: str
    here: bool


class Publisher(ABC):
    """Sends on one topic; never waits for a reader."""

    def __init__(self, topic: str) -> None:
        self.topic = topic
        self.sent = 0

    def put(self, payload: bytes, t_ns: int) -> None:
        """Send `payload`, said at simulated time `t_ns`."""
        self._send(payload, HEADER.pack(self.sent, t_ns))
        self.sent += 1

    @abstractmethod
    def _send(self, payload: bytes, header: bytes) -> None: ...


class Receiver(ABC):
    """Receives what fits one pattern of topics. What exceeds `depth` waiting messages is dropped, oldest first."""

    def __init__(self, depth: int) -> None:
        self.depth = depth
        self.counts: dict[str, Count] = {}

    @abstractmethod
    def _next(self, timeout: float) -> Message | None:
        """The oldest waiting message, or None after `timeout` seconds."""

    @abstractmethod
    def _waiting(self) -> int: ...

    def get(self, timeout: float = 0.0) -> Message | None:
        """The oldest message, waited for at most `timeout` seconds; None if there is none."""
        for _ in range(self._waiting() - self.depth):
            self._next(0.0)
        found = self._next(timeout)
        if found is not None:
            count = self.counts.get(found.topic)
            if count is None:
                count = self.counts[found.topic] = Count()
            count.see(found.seq)
        return found

    def drain(self) -> list[Message]:
        """All messages that wait now."""
        found = []
        while (one := self.get()) is not None:
            found.append(one)
        return found

    @property
    def received(self) -> int:
        """Messages received, on all topics."""
        return sum(count.received for count in self.counts.values())

    @property
    def lost(self) -> int:
        """Messages lost between messages received, on all topics."""
        return sum(count.lost for count in self.counts.values())


class Watch(ABC):
    """Tells who joins and who leaves."""

    def __init__(self) -> None:
        self.present: set[tuple[str, str]] = set()
        """(role, name) of everyone here, as of the last `poll`."""

    @abstractmethod
    def _next(self, timeout: float) -> Presence | None: ...

    def poll(self, timeout: float = 0.0) -> list[Presence]:
        """Changes since the last call; waits at most `timeout` seconds for the first."""
        changes: list[Presence] = []
        while (found := self._next(0.0 if changes else timeout)) is not None:
            who = (found.role, found.name)
            if found.here != (who in self.present):
                (self.present.add if found.here else self.present.discard)(who)
                changes.append(found)
        return changes

    def wait_for(self, role: str, name: str, timeout: float) -> bool:
        """Whether `name` in `role` is here, waiting for it at most `timeout` seconds."""
        deadline = time.monotonic() + timeout
        self.poll()
        while (role, name) not in self.present and (left := deadline - time.monotonic()) > 0.0:
            self.poll(left)
        return (role, name) in self.present


class Request(ABC):
    """A question from another process; must be answered or refused, once."""

    body: Any

    @abstractmethod
    def reply(self, text: bytes) -> None:
        """Answer with JSON text."""

    @abstractmethod
    def refuse(self, why: str) -> None:
        """Answer that it cannot be done."""


Answer = Callable[[dict[str, Any]], "dict[str, Any] | bytes"]


class Server(ABC):
    """Answers the questions on one topic, in the thread that calls `poll`."""

    def __init__(self, answer: Answer) -> None:
        self._answer = answer

    @abstractmethod
    def _next(self, timeout: float) -> Request | None: ...

    def poll(self, timeout: float = 0.0) -> int:
        """Answer what has been asked, waiting at most `timeout` seconds for the first; how many were answered.

        A RigError or ValueError of the answering function goes to the asker; any other error to both.
        """
        answered = 0
        while (request := self._next(0.0 if answered else timeout)) is not None:
            answered += 1
            try:
                found = self._answer(request.body)
            except (RigError, ValueError) as fault:
                request.refuse(str(fault))
            except Exception as fault:
                request.refuse(f"{type(fault).__name__}: {fault}")
                raise
            else:
                request.reply(found if isinstance(found, bytes) else json.dumps(found).encode())
        return answered


class Session(ABC):
    """One process's connection to the bus of one run. Use it in a `with` block, or close it."""

    def __init__(self, run: str, role: str, name: str) -> None:
        self.run, self.role, self.name = run, role, name
        topics.of(f"alive/{role}/{name}")
        self._publishers: dict[str, Publisher] = {}
        self._receivers: list[Receiver] = []

    @abstractmethod
    def _publisher(self, topic: str) -> Publisher: ...

    @abstractmethod
    def subscribe(self, pattern: str, depth: int = 4096, *, polled: bool = False, stamped: bool = False) -> Receiver:
        """A receiver of all topics that fit `pattern` ("meas/*", "**"), except for what this session itself says.

        `polled` suits readers of much that are in no hurry: messages wait outside of Python until they are drained.
        `stamped` notes when each message arrived.
        """

    @abstractmethod
    def announce(self) -> None:
        """Tell everyone that this process is ready: after its receivers stand, not before."""

    @abstractmethod
    def watch(self, who: str = "*/*") -> Watch:
        """A watch over everyone whose role/name fits `who`; begins with those already here."""

    @abstractmethod
    def serve(self, topic: str, answer: Answer) -> Server:
        """Answer questions on `topic` with `answer(body)`, a dict or ready JSON text, whenever `poll` is called."""

    @abstractmethod
    def _ask(self, topic: str, text: bytes, timeout: float) -> tuple[bool, bytes] | None:
        """(granted, text) of the answer, or None if nobody answers."""

    @abstractmethod
    def close(self) -> None:
        """Leave. Takes at most two seconds and may be called twice."""

    def publisher(self, topic: str) -> Publisher:
        """The publisher of a concrete topic; one for each topic in a session."""
        if topic not in self._publishers:
            topics.of(topic)
            self._publishers[topic] = self._publisher(topic)
        return self._publishers[topic]

    def ask(self, topic: str, body: dict[str, Any], timeout: float = 1.0, *, patient: bool = False) -> Any:
        """The answer to `body` on `topic`; `patient` waits the whole time for someone who can answer."""
        topics.of(topic)
        text, deadline = json.dumps(body).encode(), time.monotonic() + timeout
        while (left := deadline - time.monotonic()) > 0.0:
            found = self._ask(topic, text, left)
            if found is not None:
                granted, said = found
                if not granted:
                    raise BusError(f"{topic} of {self.run} refuses: {said.decode(errors='replace')}")
                return json.loads(said)
            if not patient:
                break
            time.sleep(0.02)
        raise BusError(f"nobody answers {topic} in run {self.run} within {timeout:g} s")

    def totals(self) -> bytes:
        """A Totals message: what this session has sent and received so far."""
        counts = {topic: count for receiver in self._receivers for topic, count in receiver.counts.items()}
        said = messages.TYPES["Totals"](
            process=self.name,
            sent_topic=list(self._publishers),
            sent=[publisher.sent for publisher in self._publishers.values()],
            heard_topic=list(counts),
            received=[count.received for count in counts.values()],
            lost=[count.lost for count in counts.values()],
        )
        return bytes(said.SerializeToString())

    def __enter__(self) -> Session:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()
