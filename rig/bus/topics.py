"""The one table of everything that is said on the bus.

A topic is written relative to its run: `step`, `meas/vibrometer`, `act/normal_force`. On the wire it is
`rig/<run>/<user>/<topic>`; in a recording it is the topic itself, so that two runs can be laid side by side.

A topic travels in one of three ways. LOOP: at once and as `loop/<run>/<user>/<topic>`, from plant to controllers and
back; who listens to everything reads the plant's copy in a batch. BATCH: only in the plant's batches (`rig.bus.batch`),
about 50 times a second. ALONE: at once.

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
    """One row: what is said, by whom, how urgently, in which way, and whether the recorder keeps it."""

    name: str
    """First part of the topic; `<...>` marks a second part that names a sensor, an output or a process."""
    message: str
    """Type of the message (`rig.bus.messages`); "json" marks a query, "token" a sign of life."""
    sender: str
    priority: str
    way: str
    recorded: bool
    about: str


ALONE, LOOP, BATCH = "alone", "loop", "batch"
TABLE = (
    Topic("step", "Step", "plant", "REAL_TIME", LOOP, True, "one frame: latest sample of every sensor"),
    Topic("act/<controller>", "Act", "controller", "REAL_TIME", LOOP, True, "commands that answer the step of a tick"),
    Topic(
        "applied/<controller>", "Applied", "plant", "DATA", BATCH, True, "commands as they took effect, and the tick"
    ),
    Topic("meas/<sensor>", "Block", "plant", "DATA", BATCH, True, "samples of one sensor, in blocks of 20 ms"),
    Topic("truth/<output>", "Block", "plant", "DATA", BATCH, True, "a plant output at the rate of the steps"),
    Topic("state", "State", "plant", "DATA", BATCH, True, "every plant output at one instant, a named field for each"),
    Topic("batch", "Batch", "plant", "DATA", ALONE, False, "several messages of the plant and of the loop in one"),
    Topic("event/<process>", "Event", "anyone", "INTERACTIVE_LOW", ALONE, True, "what happened: protocol, faults"),
    Topic("health", "Health", "plant", "INTERACTIVE_LOW", ALONE, True, "progress, lateness, drops, energy error; 5 Hz"),
    Topic("total/<process>", "Totals", "anyone", "BACKGROUND", ALONE, True, "last words: what was sent and received"),
    Topic("scene", "json", "plant", "", "", False, "query: `rig.bus.run_setup.Setup`, for whoever joins, whenever"),
    Topic(
        "param/<process>", "json", "anyone", "", "", False, "query: {get: [keys]} or {set: {key: value}} -> {values}"
    ),
    Topic("cmd/<process>", "json", "anyone", "", "", False, "query: {do: what, ...} -> {...}"),
    Topic("alive/<role>/<name>", "token", "anyone", "", "", False, "presence; withdrawn when the process ends or dies"),
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


def way(pattern: str) -> str:
    """How that travels which fits a pattern; "" where it is not of one kind."""
    row = _ROWS.get(pattern.partition("/")[0])
    return row.way if row is not None else ""


def heard(patterns: tuple[str, ...]) -> str:
    """The one pattern to listen to for all that fits `patterns`: what travels in batches comes with these."""
    ways = {way(pattern) for pattern in patterns}
    if ways == {BATCH}:
        return "batch"
    return patterns[0] if len(patterns) == 1 and ways <= {ALONE, LOOP} else "**"


def _known() -> str:
    return f"the topics are {', '.join(row.name for row in TABLE)}"


def matches(pattern: str, topic: str) -> bool:
    """Whether `topic` fits `pattern`: `*` stands for one part, `**` at the end for all that follow."""
    wanted, given = pattern.split("/"), topic.split("/")
    if wanted[-1] == "**":
        wanted, given = wanted[:-1], given[: len(wanted) - 1]
    return len(wanted) == len(given) and all(w in ("*", g) for w, g in zip(wanted, given))
