"""What a process sees of the bus: publishers, receivers, signs of life, and the session that has them.

The classes here count. How bytes travel is the business of `rig.bus.session` (Zenoh, between processes); the tests have
another session, within one process. Every message carries 16 bytes before its payload: its number on this topic,
counted from 0 by the publisher, and the simulated time. A receiver that finds a number missing has lost a message;
what was lost after the last one it got shows when the sender tells its totals.
"""

from __future__ import annotations

import json
import time
from abc import ABC, abstractmethod
from collections import deque
from collections.abc import Callable
from typing import Any

from rig.bus import messages, topics
from rig.bus.arrivals import Arrived, Count, Message, Presence, Refused
from rig.bus.batch import Batch
from rig.bus.inbound import PAYLOAD, Door, speaks
from rig.bus.json_text import read_json
from rig.bus.publisher import Batched, Copied, InOrder, Publisher
from rig.bus.queries import Answer, Server
from rig.errors import BusError

_MOST, _TOPICS = 256, 4096
"""Most things that one call takes in, so that a flood cannot hold it."""
DRAINED = 1 << 14
"""Most messages that one call takes out of what waits."""
PRESENCES = 1 << 14
"""Most signs of life that wait."""


class Receiver(ABC):
    """Receives what fits some patterns of topics. What exceeds `depth` waiting messages is dropped, oldest first.

    A batch waits as one message.
    """

    def __init__(self, door: Door, patterns: tuple[str, ...], depth: int, copies: Batch | None = None) -> None:
        self.door, self.patterns, self.depth = door, patterns, depth
        self.heard = topics.heard(patterns)
        """The pattern that it listens to, which may let through more than was asked for."""
        self.counts: dict[str, Count] = {}
        self._wants: dict[str, bool] = {"batch": True}
        self._opened: deque[Arrived] = deque()
        """What is left of the batch that came last."""
        self._copies = copies
        """Where the plant puts what it lets in of the loop."""

    @abstractmethod
    def _next(self, timeout: float) -> Any:
        """The oldest thing that waits, as the transport delivered it, or None after `timeout` seconds."""

    @abstractmethod
    def _arrived(self, found: Any) -> Arrived:
        """What was delivered, unread."""

    def _usual(self, found: Any) -> Message | None:
        """The message, where nothing is unusual about what was delivered: let in with less, counted, copied."""
        return None

    def _wanted(self, topic: str) -> bool:
        """Whether a topic fits."""
        wanted = self._wants.get(topic)
        if wanted is None:
            if len(self._wants) >= _TOPICS:
                self._wants = {"batch": True}
            wanted = self._wants[topic] = any(topics.matches(pattern, topic) for pattern in self.patterns)
        return wanted

    def _message(self, arrived: Arrived) -> Message:
        if not self._wanted(arrived.topic):
            raise Refused("not asked for", f"{arrived.topic[:80]} does not fit {', '.join(self.patterns)}")
        return self.door.message(arrived, self.counts)

    def get(self, timeout: float = 0.0) -> Message | None:
        """The oldest message that is let in, waited for at most `timeout` seconds; None if there is none."""
        deadline = time.monotonic() + timeout if timeout else 0.0
        for _ in range(_MOST):
            if self._opened:
                arrived = self._opened.popleft()
            else:
                found = self._next(timeout)
                if found is None:
                    return None
                if (message := self._usual(found)) is not None:
                    return message
                arrived = self._arrived(found)
            if arrived.topic == "batch":
                inside = self.door.let_in(self.door.opened, arrived) or ()
                self._opened.extend([one for one in inside if self._wanted(one.topic)])
            elif self.heard != "**" or self._wanted(arrived.topic):
                message = self.door.let_in(self._message, arrived)
                if message is not None:
                    if self._copies is not None and arrived.header is not None:
                        self._copies.add(arrived.user, arrived.topic, arrived.header, arrived.payload)
                    return message
            timeout = max(deadline - time.monotonic(), 0.0) if timeout else 0.0
        return None

    def drain(self) -> list[Message]:
        """The messages that wait now, at most `DRAINED`."""
        found: list[Message] = []
        while len(found) < DRAINED and (one := self.get()) is not None:
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

    def __init__(self, door: Door) -> None:
        self.door = door
        self.present: set[tuple[str, str]] = set()
        """(role, name) of everyone here, as of the last `poll`."""
        self._held: dict[str, tuple[str, str]] = {}
        """User -> as whom it is here; operators share one user and do not announce themselves."""

    @abstractmethod
    def _next(self, timeout: float) -> Arrived | None: ...

    def poll(self, timeout: float = 0.0) -> list[Presence]:
        """Changes since the last call; waits at most `timeout` seconds for the first."""
        changes: list[Presence] = []
        for _ in range(_MOST):
            arrived = self._next(0.0 if changes else timeout)
            if arrived is None:
                break
            found = self.door.let_in(self.door.presence, arrived)
            if found is None:
                continue
            who = (found.role, found.name)
            if self._held.get(arrived.user, who) != who:  # a process is here under one name
                self.door.count(arrived.user, Refused("a second name"))
            elif found.here and len(self.present) >= _MOST:
                self.door.count("others", Refused("too many"))
            elif found.here != (who in self.present):
                if found.here:
                    self.present.add(who)
                    self._held[arrived.user] = who
                else:
                    self.present.discard(who)
                    self._held.pop(arrived.user, None)
                changes.append(found)
        return changes

    def all_here(self) -> set[tuple[str, str]]:
        """Everyone here, once all that has arrived is taken in."""
        for _ in range(PRESENCES // _MOST):
            self.poll()
        return self.present

    def wait_for(self, role: str, name: str, timeout: float) -> bool:
        """Whether `name` in `role` is here, waiting for it at most `timeout` seconds."""
        deadline = time.monotonic() + timeout
        self.poll()
        while (role, name) not in self.present and (left := deadline - time.monotonic()) > 0.0:
            self.poll(left)
        return (role, name) in self.present


class Session(ABC):
    """One process's connection to the bus of one run. Use it in a `with` block, or close it."""

    def __init__(self, run: str, role: str, name: str, user: str, reserved: frozenset[str]) -> None:
        self.run, self.role, self.name, self.user = run, role, name, user
        topics.of(f"alive/{role}/{name}")
        self.door = Door(reserved)
        """Through which everything comes in that others say; it counts what it refuses."""
        self._publishers: dict[str, Publisher] = {}
        self._receivers: list[Receiver] = []
        self._stand_ins: list[Session] = []
        self._batch = Batch(self._send_batch) if user == "plant" else None
        self._batches: Publisher | None = None

    @abstractmethod
    def _publisher(self, topic: str) -> Publisher: ...

    @abstractmethod
    def subscribe(self, *patterns: str, depth: int = 4096, polled: bool = False, stamped: bool = False) -> Receiver:
        """A receiver of all topics that fit one of `patterns` ("meas/*", "**"), except for what this session says.

        `polled` suits readers of much that are in no hurry: messages wait outside of Python until they are drained.
        `stamped` notes when each message arrived.
        """

    @abstractmethod
    def announce(self) -> None:
        """Tell everyone that this process is ready: after its receivers stand, not before."""

    @abstractmethod
    def stand_in(self, role: str, name: str) -> Session:
        """A session for somebody of this run whose part this process plays too; of the plant only.

        It ends when it is closed, at the latest with this one. Raises BusError if somebody of the name is here.
        """

    @abstractmethod
    def watch(self, who: str = "*/*") -> Watch:
        """A watch over everyone whose role/name fits `who`; begins with those already here."""

    @abstractmethod
    def present(self, who: str = "*/*", timeout: float = 2.0) -> set[tuple[str, str]]:
        """(role, name) of everyone here whose role/name fits `who`: asked once, and ends with the last answer."""

    @abstractmethod
    def serve(self, topic: str, answer: Answer) -> Server:
        """Answer questions on `topic` with `answer(body)`, a dict or ready JSON text, whenever `poll` is called."""

    @abstractmethod
    def _ask(self, topic: str, text: bytes, timeout: float) -> tuple[bool, bytes] | None:
        """(granted, text) of the answer, or None if nobody answers."""

    @property
    @abstractmethod
    def ended(self) -> bool:
        """Whether the plant of the run has ended; one that hangs or cannot be reached just now has not."""

    @abstractmethod
    def close(self) -> None:
        """Leave. Takes at most two seconds and may be called twice."""

    def publisher(self, topic: str) -> Publisher:
        """The publisher of a concrete topic; one for each topic in a session. BusError for one of somebody else."""
        if topic not in self._publishers:
            self._own(topic)
            way, batch = topics.of(topic).way, self._batch
            if batch is None:
                self._publishers[topic] = self._publisher(topic)
            elif way == topics.BATCH:
                self._publishers[topic] = Batched(topic, batch)
            else:
                made = Copied if way == topics.LOOP else InOrder
                self._publishers[topic] = made(self._publisher(topic), batch)
        return self._publishers[topic]

    def before_batches(self, gather: Callable[[], object]) -> None:
        """Call `gather` before a batch is sent: it puts what a plant has collected until then."""
        if self._batch is not None:
            self._batch.gather = gather

    def flush(self) -> None:
        """Send what waits for its batch."""
        if self._batch is not None:
            self._batch.flush()

    def _send_batch(self, payload: bytes) -> None:
        if self._batches is None:
            self._batches = self._publisher("batch")
        self._batches.put(payload, 0)

    def _copies(self, patterns: tuple[str, ...]) -> Batch | None:
        """Where a receiver of these patterns puts copies: the plant those of what it hears of the loop."""
        return self._batch if topics.way(patterns[0]) == topics.LOOP else None

    def _own(self, topic: str) -> None:
        """Raise BusError for a topic that belongs to another process."""
        if not speaks(self.user, topic, self.door.reserved):
            raise BusError(f"{topic} belongs to {topics.owner(topic)}; {self.role} {self.name} cannot speak there")

    def ask(self, topic: str, body: dict[str, Any], timeout: float = 1.0, *, patient: bool = False) -> Any:
        """The answer to `body` on `topic`; `patient` waits the whole time for someone who can answer."""
        topics.of(topic)
        text, deadline = json.dumps(body).encode(), time.monotonic() + timeout
        while (left := deadline - time.monotonic()) > 0.0:
            found = self._ask(topic, text, left)
            if found is not None:
                granted, said = found
                if not granted:
                    raise BusError(f"{topic} of {self.run} refuses: {said[:4096].decode(errors='replace')}")
                try:
                    return read_json(said, PAYLOAD, finite=False)
                except Refused as fault:
                    raise BusError(f"{topic} of {self.run} answers what cannot be read: {fault}") from None
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
