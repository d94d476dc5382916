"""What arrives from other processes: unread, as a message or a sign of life, and how it is counted."""

from __future__ import annotations

import struct
from dataclasses import dataclass
from typing import Any, NamedTuple

from rig.errors import BusError

HEADER = struct.Struct("<QQ")
FASTEST, AT_ONCE = 200_000, 1_000
"""Messages per second of the fastest topic, and messages lost at one instant, that a jump of numbers may stand for."""


class Refused(BusError):
    """Something that is not let in. `kind` is the reason in two or three words."""

    def __init__(self, kind: str, text: str = "") -> None:
        self.kind = kind
        super().__init__(text or kind)


class Message(NamedTuple):
    """One message as it arrived. `arrived_ns` is the monotonic clock at arrival, 0 unless the receiver stamps."""

    topic: str
    payload: bytes
    seq: int
    t_ns: int
    arrived_ns: int = 0
    said: Any = None
    """The payload, decoded; None for a `state` of a scene that this session has not asked for."""
    user: str = ""
    """The user of the connection that it came over."""


class Presence(NamedTuple):
    """Someone joined (`here`) or left."""

    role: str
    name: str
    here: bool


class Arrived(NamedTuple):
    """What a transport delivers, unread. `user` speaks on `topic`; `put` is false for a deletion."""

    user: str
    topic: str
    payload: bytes = b""
    header: bytes | None = None
    put: bool = True
    encoding: str = ""
    arrived_ns: int = 0


@dataclass
class Count:
    """What has been seen of one topic."""

    received: int = 0
    lost: int = 0
    """Numbers missing between the first and the last message received; each publisher counts from 0."""
    first: int = -1
    last: int = -1
    tick: int = -1
    at: float = 0.0
    """When the last message was sent at the earliest [s on the monotonic clock]: at `FASTEST` since the first one."""

    def see(self, seq: int, now: float) -> None:
        """Count a message; a number that is not above the last one means that the publisher started anew."""
        # The time since the last message is not used up by reading one: a backlog is read at one instant.
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
        """Count the message after the last one. Nobody sends as fast as `FASTEST`, so that `at` stays in the past."""
        self.at += 1.0 / FASTEST
        self.last = seq
        self.received += 1

    def steps(self, seq: int) -> int:
        """Messages that the publisher has sent after the last one, up to number `seq`."""
        return seq - self.last if seq > self.last else seq + 1

    def plausible(self, steps: int, now: float) -> bool:
        """Whether the publisher can have sent `steps` messages after the last one by now."""
        return steps <= AT_ONCE + FASTEST * (now - self.at)

    def tail(self, sent: int) -> int:
        """Messages lost after the last one received, once it is known that `sent` were sent."""
        return max(sent - 1 - self.last, 0)
