"""The interface of the bus that a process uses: its session, and what it receives of others: messages and presence.

A session owns publishers (`rig.bus.publishers`), receivers and servers of queries (`rig.bus.queries`); it numbers and
counts messages. `rig.bus.session` transports them between processes with Zenoh; the tests have another session, within
one process.

Every message has a header of 16 bytes before its payload: its number on this topic, counted from 0 by the publisher,
and the simulated time. A missing number shows the receiver that a message was lost. Messages lost after the last one
received show when the sender publishes its totals.
"""

from __future__ import annotations

import json
import time
from abc import ABC, abstractmethod
from collections import deque
from collections.abc import Callable, Mapping
from functools import partial
from pathlib import Path
from typing import Any

from rig.bus import messages, topics
from rig.bus.batch import Batch, Row, encoded_batches
from rig.bus.inbound import PAYLOAD, InboundCheck, read_json, speaks
from rig.bus.publishers import Batched, Copied, InOrder, Publisher
from rig.bus.queries import Answer, Server, check_parameters
from rig.bus.topics import Arrived, Count, Message, Presence, Refused
from rig.errors import BusError
from rig.units import converts

_MOST = 256
"""Most items that one call processes, so that a flood of messages cannot block it."""
_TOPICS = 4096  # most topics for which a receiver keeps whether it wants them. chosen
DRAINED = 1 << 14
"""Most messages that one call of `Receiver.drain` returns."""
PRESENCES = 1 << 14
"""Most presence tokens that wait to be read."""


class Receiver(ABC):
    """Receives messages whose topic matches one of some patterns.

    At most `depth` messages wait; beyond that the oldest are dropped. A batch counts as one waiting message.
    """

    def __init__(
        self, inbound: InboundCheck, patterns: tuple[str, ...], depth: int, copies: Batch | None = None
    ) -> None:
        self.inbound = inbound
        self.patterns = patterns
        self.depth = depth
        self.heard = topics.heard(patterns)
        """The pattern to which it is subscribed; it may match more topics than `patterns`."""
        self.counts: dict[str, Count] = {}
        self._wants: dict[str, bool] = {"batch": True}
        self._opened: deque[Arrived] = deque()
        """Messages of the last batch that are not read yet."""
        self._copies = copies
        """The batch to which the plant adds copies of the commands it accepts."""

    @abstractmethod
    def _next(self, timeout: float) -> Any:
        """The oldest waiting item as the transport delivered it, or None after `timeout` seconds."""

    @abstractmethod
    def _arrived(self, delivered: Any) -> Arrived:
        """Convert what the transport delivered to raw data; nothing is checked."""

    def _usual(self, delivered: Any) -> Message | None:
        """Short path for the next message of a known topic: check, count and copy it. None: take the long path."""
        return None

    def _wanted(self, topic: str) -> bool:
        """Whether a topic matches one of the patterns."""
        wanted = self._wants.get(topic)
        if wanted is None:
            if len(self._wants) >= _TOPICS:
                self._wants = {"batch": True}
            wanted = self._wants[topic] = any(topics.matches(pattern, topic) for pattern in self.patterns)
        return wanted

    def _message(self, arrived: Arrived) -> Message:
        if not self._wanted(arrived.topic):
            raise Refused("not asked for", f"{arrived.topic[:80]} does not match {', '.join(self.patterns)}")
        return self.inbound.message(arrived, self.counts)

    def get(self, timeout: float = 0.0) -> Message | None:
        """The oldest accepted message; wait for it at most `timeout` seconds. None if there is none."""
        deadline = time.monotonic() + timeout if timeout else 0.0
        for _ in range(_MOST):
            if self._opened:
                arrived = self._opened.popleft()
            else:
                delivered = self._next(timeout)
                if delivered is None:
                    return None
                if (message := self._usual(delivered)) is not None:
                    return message
                arrived = self._arrived(delivered)
            if arrived.topic == "batch":
                inside = self.inbound.let_in(self.inbound.opened, arrived) or ()
                self._opened.extend([inner for inner in inside if self._wanted(inner.topic)])
            elif self.heard != "**" or self._wanted(arrived.topic):
                message = self.inbound.let_in(self._message, arrived)
                if message is not None:
                    if self._copies is not None and arrived.header is not None:
                        self._copies.add(arrived.user, arrived.topic, arrived.header, arrived.payload)
                    return message
            timeout = max(deadline - time.monotonic(), 0.0) if timeout else 0.0
        return None

    def drain(self) -> list[Message]:
        """All messages that wait now, at most `DRAINED`."""
        drained: list[Message] = []
        while len(drained) < DRAINED:
            message = self.get()
            if message is None:
                break
            drained.append(message)
        return drained

    @property
    def received(self) -> int:
        """Number of messages received on all topics."""
        return sum(count.received for count in self.counts.values())

    @property
    def lost(self) -> int:
        """Number of messages lost between the first and the last one received, on all topics."""
        return sum(count.lost for count in self.counts.values())


class Watch(ABC):
    """Observes which processes join and leave the run."""

    def __init__(self, inbound: InboundCheck) -> None:
        self.inbound = inbound
        self.present: set[tuple[str, str]] = set()
        """(role, name) of every process that is present, as of the last `poll`."""
        self._held: dict[str, tuple[str, str]] = {}
        """User -> its (role, name). Operators share one user and do not announce themselves."""

    @abstractmethod
    def _next(self, timeout: float) -> Arrived | None: ...

    def poll(self, timeout: float = 0.0) -> list[Presence]:
        """Processes that joined or left since the last call; wait at most `timeout` seconds for the first change."""
        changes: list[Presence] = []
        for _ in range(_MOST):
            arrived = self._next(0.0 if changes else timeout)
            if arrived is None:
                break
            presence = self.inbound.let_in(self.inbound.presence, arrived)
            if presence is None:
                continue
            who = (presence.role, presence.name)
            if self._held.get(arrived.user, who) != who:  # a process has one name only
                self.inbound.count(arrived.user, Refused("a second name"))
            elif presence.here and len(self.present) >= _MOST:
                self.inbound.count("others", Refused("too many"))
            elif presence.here != (who in self.present):
                if presence.here:
                    self.present.add(who)
                    self._held[arrived.user] = who
                else:
                    self.present.discard(who)
                    self._held.pop(arrived.user, None)
                changes.append(presence)
        return changes

    def all_here(self) -> set[tuple[str, str]]:
        """(role, name) of every process that is present, after all waiting changes are processed."""
        for _ in range(PRESENCES // _MOST):
            self.poll()
        return self.present

    def wait_for(self, role: str, name: str, timeout: float) -> bool:
        """Whether the process `name` in `role` is present; wait for it at most `timeout` seconds."""
        deadline = time.monotonic() + timeout
        self.poll()
        while (role, name) not in self.present:
            left = deadline - time.monotonic()
            if left <= 0.0:
                return False
            self.poll(left)
        return True


class Session(ABC):
    """The connection of one process to the bus of one run. Use it in a `with` block, or call `close`."""

    def __init__(self, run: str, role: str, name: str, user: str, reserved: frozenset[str]) -> None:
        self.run = run
        self.role = role
        self.name = name
        self.user = user
        topics.of(f"alive/{role}/{name}")
        self.inbound = InboundCheck(reserved)
        """Checks everything that other processes send, and counts refusals."""
        self._publishers: dict[str, Publisher] = {}
        self._receivers: list[Receiver] = []
        self._stand_ins: list[Session] = []
        self._batch = Batch(lambda rows: self._post(partial(self._put_batch, rows))) if user == "plant" else None
        self._batches: Publisher | None = None
        self.tickets: Mapping[str, Path] = {}
        """Of the plant: seat -> its ticket (rig.bus.tickets)."""
        self.lost = False
        """On another host than the plant's: whether the connection was lost. It may be back, but the seat is not."""

    @property
    def holds(self) -> dict[str, str]:
        """On another host than the plant's, what the plant is told with the query `scene`: who takes a seat."""
        return {}

    @property
    def gone(self) -> str:
        """Why the connection to a plant on another host was lost; "" while it holds and after an orderly end."""
        return ""

    def seat(self, user: str, holder: str) -> None:
        """Give `holder` the seat of a ticket; for the plant only. Raises BusError while another one has it."""
        return  # within one process there are no tickets

    @abstractmethod
    def _publisher(self, topic: str) -> Publisher: ...

    @abstractmethod
    def subscribe(self, *patterns: str, depth: int = 4096, polled: bool = False, stamped: bool = False) -> Receiver:
        """A receiver of all topics that match one of `patterns` ("meas/*", "**"), without this session's own messages.

        With `polled` messages wait outside Python until they are drained: for readers of many messages without a
        deadline. With `stamped` each message has its time of arrival.
        """

    @abstractmethod
    def announce(self) -> None:
        """Announce to all other processes that this one is ready. Create the receivers first."""

    @abstractmethod
    def stand_in(self, role: str, name: str) -> Session:
        """A second session with another role and name over the same connection; for the plant only.

        It ends when it is closed, or with this session. Raises BusError if a process of this name is present.
        """

    @abstractmethod
    def watch(self, who: str = "*/*") -> Watch:
        """A watch of all processes whose role/name matches `who`; it starts with those already present."""

    @abstractmethod
    def present(self, who: str = "*/*", timeout: float = 2.0) -> set[tuple[str, str]]:
        """(role, name) of all present processes whose role/name matches `who`: one query, at most `timeout` seconds."""

    @abstractmethod
    def serve(self, topic: str, answer: Answer) -> Server:
        """A server that answers queries on `topic` with `answer(body)`, a dict or JSON text, when `poll` is called."""

    @abstractmethod
    def _ask(self, topic: str, text: bytes, timeout: float) -> tuple[bool, bytes] | None:
        """(granted, text) of the answer, or None if no process answers."""

    @property
    @abstractmethod
    def ended(self) -> bool:
        """Whether the plant process of the run has ended. A plant that hangs or is unreachable has not ended."""

    def goes_on(self, plant: Watch) -> bool:
        """Whether the run goes on, as far as its processes can know; `plant`: a watch of the plant, which may hang."""
        plant.poll()
        return not self.lost and (bool(plant.present) or not self.ended)

    @abstractmethod
    def close(self) -> None:
        """Leave the run. Takes at most two seconds; a second call does nothing."""

    def publisher(self, topic: str) -> Publisher:
        """The publisher of a concrete topic; a session has one for each topic.

        Raises BusError if the topic belongs to another process.
        """
        if topic not in self._publishers:
            self._own(topic)
            way = topics.of(topic).way
            batch = self._batch
            if batch is None:
                self._publishers[topic] = self._publisher(topic)
            elif way == topics.BATCH:
                self._publishers[topic] = Batched(topic, batch)
            elif way == topics.LOOP:
                self._publishers[topic] = Copied(self._publisher(topic), batch)
            else:
                self._publishers[topic] = InOrder(self._publisher(topic), batch, self._post)
        return self._publishers[topic]

    def before_batches(self, gather: Callable[[], object]) -> None:
        """Have `gather` called before each batch is sent, so that it can add messages; for the plant only."""
        if self._batch is not None:
            self._batch.gather = gather

    def flush(self) -> None:
        """Send the messages that wait in the batch."""
        if self._batch is not None:
            self._batch.flush()

    @property
    def batches(self) -> int:
        """Number of batches sent so far."""
        return 0 if self._batches is None else self._batches.sent

    def _post(self, send: Callable[[], None]) -> None:
        """Send what has no deadline, in this order."""
        send()

    def _put_batch(self, rows: list[Row]) -> None:
        if self._batches is None:
            self._batches = self._publisher("batch")
        for piece in encoded_batches(rows):
            self._batches.put(piece, 0)

    def _copies(self, patterns: tuple[str, ...]) -> Batch | None:
        """The batch to which a receiver of these patterns adds copies: the plant copies the commands it receives."""
        return self._batch if topics.way(patterns[0]) == topics.LOOP else None

    def _own(self, topic: str) -> None:
        """Raise BusError for a topic that belongs to another process."""
        if not speaks(self.user, topic, self.inbound.reserved):
            raise BusError(f"{topic} belongs to {topics.owner(topic)}; {self.role} {self.name} cannot publish there")

    def ask(self, topic: str, body: dict[str, Any], timeout: float = 1.0, *, patient: bool = False) -> Any:
        """Send the query `body` on `topic` and return the answer.

        With `patient` repeat it until a process answers, at most `timeout` seconds. Values to set that have a unit are
        converted here, because the process that is asked has no time for it. Raises BusError for a refusal, an
        unreadable answer, or none.
        """
        topics.of(topic)
        changes = body.get("set") if topic.startswith("param/") else None
        if isinstance(changes, dict):
            body = {**body, "set": self._in_si(topic, changes, timeout)}
        text = json.dumps(body).encode()
        deadline = time.monotonic() + timeout
        while (left := deadline - time.monotonic()) > 0.0:
            reply = self._ask(topic, text, left)
            if reply is not None:
                granted, answer = reply
                if not granted:
                    raise BusError(f"{topic} of run {self.run} refused: {answer[:4096].decode(errors='replace')}")
                try:
                    read = read_json(answer, PAYLOAD, finite=False)
                    if topic.startswith("param/"):
                        check_parameters(read, "list" in body)
                    return read
                except Refused as fault:
                    raise BusError(f"the answer of {topic} in run {self.run} cannot be read: {fault}") from None
            if not patient:
                break
            time.sleep(0.02)
        waited = f" within {timeout:g} s" if time.monotonic() >= deadline else ""  # else there is none to wait for
        raise BusError(f"no process answered {topic} in run {self.run}{waited}")

    def _in_si(self, topic: str, changes: dict[str, Any], timeout: float) -> dict[str, Any]:
        """`changes` with numbers in place of texts in other units than those that the owner of `topic` lists."""
        if not any(converts(value, "") for value in changes.values()):
            return changes
        from rig.quantities import finite  # with pydantic, which most processes of a run do not need

        try:
            units = self.ask(topic, {"list": True}, timeout)["units"]
            given = [(key, value, units.get(key)) for key, value in changes.items()]
        except (BusError, AttributeError, LookupError, TypeError):  # the owner refuses the change itself
            return changes
        faults = []
        numbers = dict(changes)
        for key, value, unit in given:
            if unit and converts(value, unit):
                try:
                    numbers[key] = finite(value, unit)
                except ValueError as fault:
                    faults.append(f"{key}: {fault}")
        if faults:
            raise BusError(f"{topic} of run {self.run} refused: " + "\n".join(faults))
        return numbers

    def totals(self) -> bytes:
        """Encode a Totals message: numbers of messages sent, received and lost by this session so far.

        What is not recorded is not among those sent: nobody relies on all of it.
        """
        counts = {topic: count for receiver in self._receivers for topic, count in receiver.counts.items()}
        sent = {topic: publisher.sent for topic, publisher in self._publishers.items() if topics.of(topic).recorded}
        message = messages.TYPES["Totals"](
            process=self.name,
            sent_topic=list(sent),
            sent=list(sent.values()),
            heard_topic=list(counts),
            received=[count.received for count in counts.values()],
            lost=[count.lost for count in counts.values()],
        )
        return bytes(message.SerializeToString())

    def __enter__(self) -> Session:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()
