"""The interface of the bus that a process uses: the session that owns publishers and receivers.

The session numbers and counts messages. `rig.bus.session` transports them between processes with Zenoh; the tests have
another session, within one process.
"""

from __future__ import annotations

import json
import time
from abc import ABC, abstractmethod
from collections.abc import Callable
from typing import Any

from rig.bus import messages, topics
from rig.bus.arrivals import Refused
from rig.bus.batch import Batch, Row, encoded_batches
from rig.bus.content_checks import PAYLOAD
from rig.bus.inbound import InboundCheck, speaks
from rig.bus.json_text import read_json
from rig.bus.publisher import Batched, Copied, InOrder, Publisher
from rig.bus.queries import Answer, Server
from rig.bus.receivers import Receiver, Watch
from rig.errors import BusError
from rig.units import converts


class Session(ABC):
    """The connection of one process to the bus of one run. Use it in a `with` block, or call `close`."""

    def __init__(self, run: str, role: str, name: str, user: str, reserved: frozenset[str]) -> None:
        self.run, self.role, self.name, self.user = run, role, name, user
        topics.of(f"alive/{role}/{name}")
        self.inbound = InboundCheck(reserved)
        """Checks everything that other processes send, and counts refusals."""
        self._publishers: dict[str, Publisher] = {}
        self._receivers: list[Receiver] = []
        self._stand_ins: list[Session] = []
        self._batch = Batch(self._post_batch) if user == "plant" else None
        self._batches: Publisher | None = None

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

    @abstractmethod
    def close(self) -> None:
        """Leave the run. Takes at most two seconds; a second call does nothing."""

    def publisher(self, topic: str) -> Publisher:
        """The publisher of a concrete topic; a session has one for each topic.

        Raises BusError if the topic belongs to another process.
        """
        if topic not in self._publishers:
            self._own(topic)
            way, batch = topics.of(topic).way, self._batch
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

    def _post_batch(self, rows: list[Row]) -> None:
        self._post(lambda: self._put_batch(rows))

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
        if topic.startswith("param/") and isinstance(changes := body.get("set"), dict):
            body = {**body, "set": self._in_si(topic, changes, timeout)}
        text, deadline = json.dumps(body).encode(), time.monotonic() + timeout
        while (left := deadline - time.monotonic()) > 0.0:
            found = self._ask(topic, text, left)
            if found is not None:
                granted, answer = found
                if not granted:
                    raise BusError(f"{topic} of run {self.run} refused: {answer[:4096].decode(errors='replace')}")
                try:
                    return read_json(answer, PAYLOAD, finite=False)
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
            found = [(key, value, units.get(key)) for key, value in changes.items()]
        except (BusError, AttributeError, LookupError, TypeError):  # the owner refuses the change itself
            return changes
        faults, numbers = [], dict(changes)
        for key, value, unit in found:
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
        sent = {topic: one.sent for topic, one in self._publishers.items() if topics.of(topic).recorded}
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
