"""Types of what arrives from other processes (raw data, messages, presence tokens), and counts per topic."""

from __future__ import annotations

import struct
from dataclasses import dataclass
from typing import Any, NamedTuple

from rig.errors import BusError

HEADER = struct.Struct("<QQ")
FASTEST, AT_ONCE = 200_000, 1_000
"""Largest plausible jump of message numbers: messages per second of the fastest topic, and messages lost at once."""


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
    tick: int = -1
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
