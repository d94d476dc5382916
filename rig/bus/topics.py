"""The one table of everything that is said on the bus.

A topic is written relative to its run: `step`, `meas/vibrometer`, `act/normal_force`. On the wire it is
`rig/<run>/<user>/<topic>`; in a recording it is the topic itself, so that two runs can be laid side by side.

Every message is sent with congestion control DROP: a publisher never waits for a slow or hung reader. None is sent
"express": an express message takes one of 16 batches for itself, and at 5 kHz beside two busy processes 2 % were lost;
batched, none was, and the round trip is the same, for batching begins only under back pressure.
"""

from __future__ import annotations

import difflib
import re
from functools import lru_cache
from typing import NamedTuple

from rig.errors import BusError


class Topic(NamedTuple):
    """One row: what is said, by whom, how urgently, and whether the recorder keeps it."""

    name: str
    """First part of the topic; `<...>` marks a second part that names a sensor, an output or a process."""
    message: str
    """Type of the message (`rig.bus.messages`); "json" marks a query, "token" a sign of life."""
    sender: str
    priority: str
    recorded: bool
    about: str


TABLE = (
    Topic("step", "Step", "plant", "REAL_TIME", True, "one frame: latest sample of every sensor, for the controllers"),
    Topic("act/<controller>", "Act", "controller", "REAL_TIME", True, "commands that answer the step of a tick"),
    Topic(
        "applied/<controller>", "Applied", "plant", "DATA", True, "commands as they took effect, and the tick at which"
    ),
    Topic("meas/<sensor>", "Block", "plant", "DATA", True, "samples of one sensor: singly to 1 kHz, in blocks above"),
    Topic("truth/<output>", "Block", "plant", "DATA_LOW", True, "a plant output at the rate of the integrator's steps"),
    Topic("state", "State", "plant", "DATA_LOW", True, "every plant output at one instant, a named field for each"),
    Topic("event/<process>", "Event", "anyone", "INTERACTIVE_LOW", True, "what happened: protocol, parameters, faults"),
    Topic("health", "Health", "plant", "INTERACTIVE_LOW", True, "progress, lateness, drops, energy error; 5 to 10 Hz"),
    Topic("total/<process>", "Totals", "anyone", "BACKGROUND", True, "last words: what was sent, received and lost"),
    Topic("scene", "json", "plant", "", False, "query: `rig.bus.setup.Setup`, for whoever joins, whenever"),
    Topic("param/<process>", "json", "anyone", "", False, "query: {get: [keys]} or {set: {key: value}} -> {values}"),
    Topic("cmd/<process>", "json", "anyone", "", False, "query: {do: what, ...} -> {...}"),
    Topic("alive/<role>/<name>", "token", "anyone", "", False, "presence; withdrawn when the process ends or dies"),
)

_ROWS = {row.name.partition("/")[0]: row for row in TABLE}
_NAME = re.compile(r"[A-Za-z0-9_][A-Za-z0-9_.-]{0,63}")
ROLES = ("plant", "controller", "recorder", "viewer", "operator")


def is_name(text: object) -> bool:
    """Whether `text` can name a process, a sensor or an output: 1 to 64 letters, digits, '_', '.', '-'."""
    return isinstance(text, str) and _NAME.fullmatch(text) is not None


@lru_cache(4096)  # bounded: names arrive from outside
def of(topic: str) -> Topic:
    """The row of a concrete topic such as `meas/vibrometer`; raises BusError for one that is not in the table."""
    first, *rest = topic.split("/")
    row = _ROWS.get(first)
    if row is None:
        near = difflib.get_close_matches(first, _ROWS, n=3)
        raise BusError(f"no topic is called {topic!r}; " + (f"near: {', '.join(near)}" if near else _known()))
    if len(rest) != row.name.count("/") or not all(map(is_name, rest)):
        raise BusError(
            f"the topic {topic!r} is not of the form {row.name}; names are letters, digits, '_', '.', '-', at most 64"
        )
    return row


@lru_cache(4096)
def owner(topic: str) -> str:
    """Name of the only process that may publish, serve or declare `topic`; raises BusError as `of` does."""
    return "plant" if of(topic).sender == "plant" else topic.rpartition("/")[2]


def speaker(pattern: str) -> str:
    """Name of the only process that speaks on the topics that fit `pattern`; "*" where several may."""
    first, _, name = pattern.partition("/")
    if first in _ROWS and _ROWS[first].sender == "plant":
        return "plant"
    return name if first in _ROWS and is_name(name) else "*"


def _known() -> str:
    return f"the topics are {', '.join(row.name for row in TABLE)}"


def matches(pattern: str, topic: str) -> bool:
    """Whether `topic` fits `pattern`: `*` stands for one part, `**` at the end for all that follow."""
    wanted, given = pattern.split("/"), topic.split("/")
    if wanted[-1] == "**":
        wanted, given = wanted[:-1], given[: len(wanted) - 1]
    return len(wanted) == len(given) and all(w in ("*", g) for w, g in zip(wanted, given))
