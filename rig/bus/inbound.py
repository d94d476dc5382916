"""Checks of all data from other processes; no other module reads it unchecked.

Messages, queries and presence tokens pass `InboundCheck.let_in`. It refuses data that is malformed, too large, out of
bounds, or sent by a process that does not own the topic, and counts refusals by sender and kind. Code that uses a
checked message need not expect an exception from its content. What the plant sends only has to be readable: Zenoh lets
nobody else send as the plant (`rig.bus.access`).
"""

from __future__ import annotations

import json
import math
import struct
import time
from collections.abc import Callable, Collection, Sequence
from typing import Any, NamedTuple, TypeVar

from google.protobuf.message import DecodeError

from rig.bus import messages, topics
from rig.bus.topics import HEADER, Arrived, Count, Message, Presence, Refused
from rig.errors import BusError

QUESTION = 1 << 16
"""Longest query [bytes]."""
DEEPEST = 32
"""Most levels of lists and objects inside each other."""

PAYLOAD = 1 << 24
"""Longest message [bytes]. From another process the hub accepts at most `rig.bus.access.FROM_LEAVES`."""
TICKS = 1 << 53
"""Bound of a tick."""
TIMES_NS = 1 << 62
"""Bound of a simulated time [ns]."""
SPAN_NS = 1 << 42
"""Bound of a sample interval [ns]."""
TOPICS = 1024
"""Most topics that are counted one by one."""
_BOUNDS = {"tick": TICKS, "t_ns": TIMES_NS, "t0_ns": TIMES_NS, "dt_ns": SPAN_NS}
"""Bounded fields of messages."""

_SENDERS = 32  # most senders that are counted one by one
_OF_A_GUEST = 16  # most topics of a guest that are counted one by one

T = TypeVar("T")
A = TypeVar("A", bound="Arrived")


def read_json(data: bytes, limit: int = QUESTION, *, finite: bool = True) -> dict[str, Any]:
    """Read the JSON object in `data`.

    Raises Refused if it is longer than `limit` bytes, not a JSON object, has more than `DEEPEST` levels, or has (with
    `finite`) a number that is not finite as a double.
    """
    if len(data) > limit:
        raise Refused("too long", f"{len(data)} bytes; at most {limit} are read")
    try:
        checks: dict[str, Any] = (
            {"parse_constant": _finite, "parse_float": _finite, "parse_int": _whole} if finite else {}
        )
        content = json.loads(data, **checks)
        json.dumps(content, ensure_ascii=False).encode()  # raises for half a surrogate pair
    except (ValueError, RecursionError) as fault:
        raise Refused("not JSON", f"{data[:40]!r} is not JSON: {fault}") from None
    if not isinstance(content, dict):
        raise Refused("not JSON", f"{data[:40]!r} is not a JSON object")
    level: list[Any] = [content]
    for _ in range(DEEPEST):
        level = [inner for outer in level for inner in _inside(outer)]
    if level:
        raise Refused("not JSON", f"{data[:40]!r} has more than {DEEPEST} levels")
    return content


def _inside(content: Any) -> Collection[Any]:
    if isinstance(content, dict):
        return content.values()
    return content if isinstance(content, list) else ()


def _whole(text: str) -> int:
    _finite(text)
    return int(text)


def _finite(text: str) -> float:
    if not math.isfinite(number := float(text)):
        raise Refused("not finite", f"{text[:40]} is not a finite number")
    return number


def _check_totals(topic: str, content: Any, counts: dict[str, Count], now: float) -> None:
    """Raise Refused for totals that claim messages of others, or more than can have been sent by `now` [s]."""
    sent = content.sent_topic
    heard = content.heard_topic
    if len(sent) != len(content.sent) or not len(heard) == len(content.received) == len(content.lost):
        raise Refused("wrong length", "Totals whose columns differ in length")
    if max(len(sent), len(heard)) > TOPICS:
        raise Refused("too many topics", f"Totals of more than {TOPICS} topics")
    for claimed in sent if topic != "total/plant" else ():
        if topics.owner(claimed) not in topic.split("/"):
            raise Refused("not its own topic", f"{topic} claims messages on {claimed[:80]}, which it does not own")
    nothing = Count()
    for claimed, number in (*zip(sent, content.sent), *zip(heard, content.received), *zip(heard, content.lost)):
        seen = counts.get(claimed, nothing)
        if number < 0 or not seen.plausible(number - 1 - seen.last, now):
            raise Refused("implausible number", f"Totals of {number} messages on {claimed[:80]}")


def speaks(user: str, topic: str, reserved: frozenset[str]) -> bool:
    """Whether `user` may publish, serve or declare `topic`: one of its own or, for a guest, of a name not reserved."""
    owner = topics.owner(topic)
    return user in ("plant", owner) or (is_guest(user) and owner not in reserved)


def is_guest(user: str) -> bool:
    """Whether a user is a guest: one of those for processes that the run does not know beforehand."""
    return user.startswith("guest-")


class _Granted(NamedTuple):
    """How to read and check the messages of one user on one topic; determined once."""

    kind: str
    read: Callable[[bytes], Any] | None
    bounds: tuple[tuple[str, int], ...]


class Row(NamedTuple):
    """How to read, check and count further messages of one user on one topic, after a receiver accepted the first."""

    user: str
    topic: str
    granted: _Granted
    counted: Count
    granted_by: object
    """`InboundCheck.granted` when this row was made; another object means that another scene was learned since."""


class InboundCheck:
    """Checks what one session receives. `reserved`: names under which only the user of that name may publish."""

    def __init__(self, reserved: frozenset[str] = frozenset()) -> None:
        self.reserved = reserved
        self.refused: dict[tuple[str, str], int] = {}
        """(sender, kind) -> number of refusals."""
        self.last: Refused = Refused("nothing")
        """The latest refusal."""
        self._reported: dict[tuple[str, str], int] = {}
        self.granted: dict[tuple[str, str], _Granted] = {}
        """(user, topic) -> how to read and check its messages; filled when the first message is accepted."""
        self._state: Callable[[bytes], Any] | None = None

    def learn(self, outputs: Sequence[str]) -> None:
        """Learn the outputs of the scene: from now on decode `state`."""
        self._state = messages.state_type(outputs).FromString
        self.granted = {}

    def let_in(self, read: Callable[[A], T], arrived: A) -> T | None:
        """Return `read(arrived)`, or None if it is refused: `read` raised any exception."""
        try:
            return read(arrived)
        except Refused as fault:
            self._refuse(arrived, fault)
        except BusError as fault:
            self._refuse(arrived, Refused("unreadable", str(fault)))
        except Exception as fault:  # data from outside never ends a process
            self._refuse(arrived, Refused("unreadable", f"{type(fault).__name__}: {fault}"))
        return None

    def _refuse(self, arrived: Arrived, fault: Refused) -> None:
        try:
            topics.of(arrived.topic)
            topic = arrived.topic
        except BusError:
            topic = "an unknown topic"
        sender = f"{arrived.user} on {topic}" if topics.is_name(arrived.user) else f"somebody on {topic}"
        self.count(sender, fault)

    def count(self, sender: str, fault: Refused) -> None:
        """Count a refusal; once the list of senders is full, new ones are counted as "others"."""
        key = (sender, fault.kind)
        if key not in self.refused and len(self.refused) >= _SENDERS:
            key = ("others", fault.kind)
        self.refused[key] = self.refused.get(key, 0) + 1
        self.last = fault

    @property
    def total(self) -> int:
        """Number of all refusals."""
        return sum(self.refused.values())

    def refusals(self) -> dict[str, int]:
        """Refusals by sender and kind, for a summary."""
        return {f"{sender}: {kind}": count for (sender, kind), count in list(self.refused.items())}

    def news(self) -> list[str]:
        """New refusals since the last call: one line for each sender and kind."""
        lines = []
        for (sender, kind), count in self.refused.items():
            if count > self._reported.get((sender, kind), 0):
                lines.append(f"{sender}: {kind}")
        self._reported = dict(self.refused)
        return lines

    def message(self, arrived: Arrived, counts: dict[str, Count]) -> Message:
        """Check, decode and count (in `counts`) a message. Raises Refused if anything is wrong with it."""
        user, topic, payload, header, put, encoding, arrived_ns = arrived
        granted = self.granted.get((user, topic)) or self._grant(user, topic, encoding)
        if not put:
            raise Refused("a deletion")
        if header is None or len(header) != 16:
            raise Refused("no number", f"a message on {topic} carries no sequence number of {HEADER.size} bytes")
        if len(payload) > PAYLOAD:
            raise Refused("too long", f"{len(payload)} bytes; at most {PAYLOAD} are read")
        seq, t_ns = HEADER.unpack(header)
        count = counts.get(topic)
        now = time.monotonic()
        if count is None:
            if len(counts) >= TOPICS:
                raise Refused("too many topics", f"more than {TOPICS} topics")
            count = Count()
        if seq != count.last + 1 or t_ns >= TIMES_NS:
            if t_ns >= TIMES_NS or not count.plausible(count.steps(seq), now):
                raise Refused("implausible number", f"number {seq}, t = {t_ns} ns after number {count.last} on {topic}")
        content = None
        if granted.read is not None:
            try:
                content = granted.read(payload)
            except DecodeError as fault:
                raise Refused(
                    "unreadable", f"{len(payload)} bytes on {topic} are not a {granted.kind}: {fault}"
                ) from None
            for name, limit in granted.bounds:
                if not 0 <= getattr(content, name) < limit:
                    raise Refused("out of bounds", f"{name} = {getattr(content, name)} of a {granted.kind}")
            if granted.kind == "Event":
                read_json(content.data.encode() or b"{}", PAYLOAD, finite=user != "plant")  # it tells what diverged
            elif granted.kind == "Totals":
                _check_totals(topic, content, counts, now)
        if not count.received:
            counts[topic] = count
        if (user, topic) not in self.granted:  # only now: refused messages must not fill the table
            self.granted[user, topic] = granted
        count.see(seq, now)
        return Message(topic, payload, seq, t_ns, arrived_ns, content, user)

    def row(self, user: str, topic: str, counts: dict[str, Count]) -> Row | None:
        """How to read further messages of a user on a topic; None before the first one is accepted and counted."""
        granted = self.granted.get((user, topic))
        count = counts.get(topic)
        if granted is None or granted.read is None or count is None or granted.kind in ("Event", "Totals"):
            return None
        return Row(user, topic, granted, count, self.granted)

    def usual(self, row: Row, data: bytes, arrived_ns: int) -> Message | None:
        """Decode and count the message in `data` (header and payload), if it is the next one of its row and valid.

        None means that `message` has to decide.
        """
        user, topic, granted, count, _ = row
        try:
            seq, t_ns = HEADER.unpack_from(data)  # a deletion has no data
            if seq != count.last + 1 or t_ns >= TIMES_NS or len(data) > PAYLOAD:
                return None
            payload = data[HEADER.size :]
            content = granted.read(payload)  # type: ignore[misc]  # see `row`
            for name, limit in granted.bounds:
                if not 0 <= getattr(content, name) < limit:
                    return None
        except (struct.error, DecodeError):
            return None
        count.next(seq)
        return Message(topic, payload, seq, t_ns, arrived_ns, content, user)

    def opened(self, arrived: Arrived) -> list[Arrived]:
        """Unpack the messages of a batch, without decoding them. Raises Refused."""
        if arrived.user != "plant" or not arrived.put:
            raise Refused("not its own topic", "only the plant sends batches")
        if arrived.encoding != messages.encoding("batch"):
            raise _another_version("batch", arrived.encoding)
        if len(arrived.payload) > PAYLOAD:
            raise Refused("too long", f"{len(arrived.payload)} bytes; at most {PAYLOAD} are read")
        batch = messages.TYPES["Batch"].FromString(arrived.payload)
        senders = []
        for user, topic in zip(batch.user, batch.topic):
            encoding = "" if (user, topic) in self.granted else messages.encoding(topic)
            senders.append((user, topic, encoding))
        inner = []
        for place, header, content in zip(batch.place, batch.header, batch.said, strict=True):
            user, topic, encoding = senders[place]
            inner.append(Arrived(user, topic, content, header, True, encoding))
        return inner

    def _grant(self, user: str, topic: str, encoding: str) -> _Granted:
        row = topics.of(topic)
        if not row.way or topic == "batch":
            raise Refused("not a message", f"{topic} is not a topic for messages")
        if not speaks(user, topic, self.reserved):
            raise Refused("not its own topic", f"{user} published on {topic}, which belongs to {topics.owner(topic)}")
        if encoding != messages.encoding(topic):
            raise _another_version(topic, encoding)
        if is_guest(user) and sum(known == user for known, _ in self.granted) >= _OF_A_GUEST:
            raise Refused("too many topics", f"more than {_OF_A_GUEST} topics of one guest")
        kind = row.message
        read = self._state if kind == "State" else messages.TYPES[kind].FromString
        return _Granted(kind, read, _bounded(kind))

    def presence(self, arrived: Arrived) -> Presence:
        """Check and read a presence token. Raises Refused."""
        if topics.of(arrived.topic).message != "token":
            raise Refused("no sign of life", f"{arrived.topic} is not a presence token")
        _, role, name = arrived.topic.split("/")
        if role not in topics.ROLES:
            raise Refused("no such role", f"{role!r:.80} is not a role; the roles are {', '.join(topics.ROLES)}")
        own = speaks(arrived.user, arrived.topic, self.reserved)
        if not own or (role == "plant" and arrived.user != "plant"):
            raise Refused("not its own name", f"{arrived.user} cannot be {role} {name}")
        return Presence(role, name, arrived.put)

    def question(self, arrived: Arrived) -> dict[str, Any]:
        """Read the body of a query. Raises Refused."""
        return read_json(arrived.payload or b"{}")


def _bounded(kind: str) -> tuple[tuple[str, int], ...]:
    """The bounded fields of a kind of message and the bound of each."""
    if kind not in messages.TYPES:
        return ()
    blank = messages.TYPES[kind]()
    return tuple((name, limit) for name, limit in _BOUNDS.items() if isinstance(getattr(blank, name, None), int))


def _another_version(topic: str, encoding: str) -> Refused:
    return Refused(
        "another version",
        f"messages on {topic} are {encoding[:80]}, this process expects {messages.encoding(topic)}: "
        "start all processes of a run from the same installation",
    )
