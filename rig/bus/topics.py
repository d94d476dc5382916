"""The table of all topics of the bus, and what arrives on them.

A topic is written relative to its run: `step`, `meas/vibrometer`, `act/normal_force`. Its Zenoh key is
`rig/<run>/<user>/<topic>`. A recording uses the topic itself, so that two runs can be compared.

A topic is transported in one of three ways. LOOP: at once, under the key `loop/<run>/<user>/<topic>`, between plant and
controllers; receivers of all topics read the plant's copy in a batch. BATCH: only in the plant's batches
(`rig.bus.batch`), about 50 times a second. ALONE: at once.

Every message is sent with congestion control DROP: a publisher never waits for a slow or hung reader. No message is
sent "express": an express message occupies one of Zenoh's 16 batches, and at 5 kHz beside two busy processes 2 % were
lost. With batching none was lost and the round trip is the same, because batching begins only under back pressure.

What arrives from other processes is raw data, a message or a presence token; a `Count` counts messages per topic.
"""

from __future__ import annotations

import difflib
import re
import struct
from dataclasses import dataclass
from functools import lru_cache
from typing import Any, NamedTuple

from rig.errors import BusError

HEADER = struct.Struct("<QQ")
FASTEST = 200_000
"""Largest plausible jump of message numbers in a second: messages per second of the fastest topic."""
AT_ONCE = 1_000
"""Largest plausible jump of message numbers at once: messages lost at once."""

ALONE = "alone"
LOOP = "loop"
BATCH = "batch"
ERROR = "error"
WARN = "warn"
LEVELS = {
    **dict.fromkeys(("fault", "diverged", "limit", "emergency", "lost"), ERROR),
    **dict.fromkeys(
        ("missing", "left", "evicted", "safe", "held", "not finite", "refused", "flood", "overruled"), WARN
    ),
    **dict.fromkeys(("never", "timeout", "overrun", "pause", "scheduling", "warning"), WARN),
    **dict.fromkeys(("outdated", "skipped", "device lost", "device reset", "stream lost"), WARN),
}
"""Kind of an event -> how serious it is; all other kinds are news."""
BLOCK_NS = 20_000_000
"""Longest span of a block of samples [ns of simulated time]."""
STATE_NS = 5_000_000
"""Shortest time between two states [ns of simulated time]."""
SPAN_NS = 1_000_000
"""Length of a span of `band`; with a longer step one step [ns of simulated time]."""

_NAME = re.compile(r"[A-Za-z0-9_][A-Za-z0-9_.-]{0,63}")
ROLES = ("plant", "controller", "recorder", "viewer", "operator")


class Refused(BusError):
    """Raised for data that is refused. `kind` is the reason in two or three words."""

    def __init__(self, kind: str, text: str = "") -> None:
        self.kind = kind
        super().__init__(text or kind)


class Message(NamedTuple):
    """One message. `arrived_ns` is the monotonic clock at arrival, or 0 if the receiver does not stamp."""

    topic: str
    payload: bytes
    seq: int
    t_ns: int
    arrived_ns: int = 0
    said: Any = None
    """The decoded payload; None for a `state` message if this session has not fetched the scene."""
    user: str = ""
    """The user that sent it, known from the connection."""


class Presence(NamedTuple):
    """A process joined the run (`here`) or left it."""

    role: str
    name: str
    here: bool


class Arrived(NamedTuple):
    """Raw data as the transport delivers it. `user` publishes on `topic`; `put` is false for a deletion."""

    user: str
    topic: str
    payload: bytes = b""
    header: bytes | None = None
    put: bool = True
    encoding: str = ""
    arrived_ns: int = 0


@dataclass
class Count:
    """Counts of the messages received and lost on one topic."""

    received: int = 0
    lost: int = 0
    """Message numbers missing between the first and the last message received; each publisher counts from 0."""
    first: int = -1
    last: int = -1
    at: float = 0.0
    """Earliest time [s, monotonic clock] at which the last message can have been sent, at the rate `FASTEST`."""

    def see(self, seq: int, now: float) -> None:
        """Count a message; a number that is not above the last one means that the publisher restarted."""
        # `at` advances by the message number, not to `now`: a backlog of messages is read at one instant.
        self.at = min(self.at + self.steps(seq) / FASTEST, now) if self.received else now
        if seq > self.last >= 0:
            self.lost += seq - self.last - 1
        elif self.last < 0:
            self.first = seq
        else:
            self.lost += seq
        self.last = seq
        self.received += 1

    def next(self, seq: int) -> None:
        """Count the direct successor of the last message. No topic is as fast as `FASTEST`: `at` stays in the past."""
        self.at += 1.0 / FASTEST
        self.last = seq
        self.received += 1

    def steps(self, seq: int) -> int:
        """Number of messages sent after the last one, up to and including number `seq`."""
        return seq - self.last if seq > self.last else seq + 1

    def plausible(self, steps: int, now: float) -> bool:
        """Whether the publisher can have sent `steps` messages after the last one by now."""
        return steps <= AT_ONCE + FASTEST * (now - self.at)

    def tail(self, sent: int) -> int:
        """Number of messages lost after the last one received, if `sent` were sent in total."""
        return max(sent - 1 - self.last, 0)


class Topic(NamedTuple):
    """One row of the table: message type, sender, priority, transport, and whether the recorder keeps it."""

    name: str
    """First part of the topic; `<...>` marks a second part that names a sensor, an output or a process."""
    message: str
    """Type of the message (`rig.bus.messages`); "json" marks a query, "token" a presence token."""
    sender: str
    priority: str
    way: str
    recorded: bool
    about: str


TABLE = (
    Topic("step", "Step", "plant", "REAL_TIME", LOOP, True, "one frame: latest sample of every sensor"),
    Topic("act/<controller>", "Act", "controller", "REAL_TIME", LOOP, True, "commands for the step of a tick"),
    Topic(
        "applied/<controller>", "Applied", "plant", "DATA", BATCH, True, "commands as they took effect, and the tick"
    ),
    Topic("meas/<sensor>", "Block", "plant", "DATA", BATCH, True, "samples of one sensor, in blocks of 20 ms"),
    Topic("truth/<output>", "Block", "plant", "DATA", BATCH, True, "a plant output at the rate of the steps"),
    Topic("state", "State", "plant", "DATA", BATCH, True, "all plant outputs at one instant, a named field for each"),
    Topic("band", "Band", "plant", "DATA", BATCH, False, "extremes of all outputs, for viewers; while one is present"),
    Topic(
        "checkpoint", "Checkpoint", "plant", "DATA", BATCH, True, "where a run can be continued; every 100 000 steps"
    ),
    Topic("batch", "Batch", "plant", "DATA", ALONE, False, "several messages of plant and controllers in one"),
    Topic("event/<process>", "Event", "anyone", "INTERACTIVE_LOW", ALONE, True, "events of the protocol, faults"),
    Topic("health", "Health", "plant", "INTERACTIVE_LOW", ALONE, True, "progress, lateness, drops, energy error; 5 Hz"),
    Topic("total/<process>", "Totals", "anyone", "BACKGROUND", ALONE, True, "last message: numbers sent and received"),
    Topic("scene", "json", "plant", "", "", False, "query: `rig.bus.run_setup.Setup`, at any time of the run"),
    Topic(
        "param/<process>", "json", "anyone", "", "", False, "query: {get: [keys]} or {set: {key: value}} -> {values}"
    ),
    Topic("cmd/<process>", "json", "anyone", "", "", False, "query: {do: what, ...} -> {...}"),
    Topic("alive/<role>/<name>", "token", "anyone", "", "", False, "presence; withdrawn when the process ends"),
)

RECORDED = tuple(re.sub("<.*>", "*", row.name) for row in TABLE if row.recorded)
"""Patterns of all topics that the recorder keeps."""
_ROWS = {row.name.partition("/")[0]: row for row in TABLE}


def is_name(text: object) -> bool:
    """Whether `text` can name a process, a sensor or an output: 1 to 64 letters, digits, '_', '.', '-'."""
    return isinstance(text, str) and _NAME.fullmatch(text) is not None


@lru_cache(4096)  # bounded, because names come from other processes
def of(topic: str) -> Topic:
    """The row of a concrete topic such as `meas/vibrometer`. Raises BusError if it is not in the table."""
    first, *rest = topic.split("/")
    row = _ROWS.get(first)
    if row is None:
        near = difflib.get_close_matches(first, _ROWS, n=3)
        listed = f"near: {', '.join(near)}" if near else f"the topics are {', '.join(row.name for row in TABLE)}"
        raise BusError(f"no topic is called {topic!r}; {listed}")
    if len(rest) != row.name.count("/") or not all(map(is_name, rest)):
        raise BusError(
            f"the topic {topic!r} is not of the form {row.name}; names are letters, digits, '_', '.', '-', at most 64"
        )
    return row


@lru_cache(4096)
def owner(topic: str) -> str:
    """Name of the only process that may publish, serve or declare `topic`. Raises BusError as `of` does."""
    return "plant" if of(topic).sender == "plant" else topic.rpartition("/")[2]


@lru_cache(4096)
def of_plant(topic: str) -> bool:
    """Whether the plant sends `topic`: only its simulated times are those of the run. False for unknown topics."""
    try:
        return owner(topic) == "plant"
    except BusError:
        return False


def speaker(pattern: str) -> str:
    """Name of the only process that may publish on topics of `pattern`; "*" if several may."""
    first, _, name = pattern.partition("/")
    if first in _ROWS and _ROWS[first].sender == "plant":
        return "plant"
    return name if first in _ROWS and is_name(name) else "*"


def way(pattern: str) -> str:
    """Transport (LOOP, BATCH, ALONE) of the topics that match `pattern`; "" for patterns of several kinds of topics."""
    row = _ROWS.get(pattern.partition("/")[0])
    return row.way if row is not None else ""


def heard(patterns: tuple[str, ...]) -> str:
    """The one pattern to subscribe to, in order to receive all topics of `patterns`; "batch" if all are batched."""
    ways = {way(pattern) for pattern in patterns}
    if ways == {BATCH}:
        return "batch"
    return patterns[0] if len(patterns) == 1 and ways <= {ALONE, LOOP} else "**"


def matches(pattern: str, topic: str) -> bool:
    """Whether `topic` matches `pattern`: `*` stands for one part, `**` at the end for all following parts."""
    wanted = pattern.split("/")
    given = topic.split("/")
    if wanted[-1] == "**":
        wanted.pop()
        given = given[: len(wanted)]
    return len(wanted) == len(given) and all(w in ("*", g) for w, g in zip(wanted, given))
