"""Formats of scene files: how a file of an older format is read, and how it is rewritten to the newest one.

A file states its format at its top: `format = 1`; a file without this line has format 1. `STEPS` holds what was renamed
from each format to the next. To rename a key of scene files, add a step: files and recordings of older formats are
then read with the new name, and `rig migrate` rewrites files. A step renames keys only: the target of a protocol step
is a value and keeps its name. Changes of a scene (-p, studies, Python) need the newest names; a message names the
successor of a former one.
"""

from __future__ import annotations

import re
import tomllib
from collections.abc import Iterable
from typing import Any, NamedTuple

from rig.scenes.places import parts
from rig.units import brief

ROOMS = ("clock", "sensors", "controllers", "protocol", "limits")
"""What a recorded scene holds beside the parameters of its plant."""
_ENTRY = re.compile(r"\[\d+\]")
_NUMBER = re.compile(r"[ \t]*=[ \t]*([^\s#]+)")
_READS = "reads scene files up to format"


class Rename(NamedTuple):
    """A key that is called `to` from the next format on; in `key`, `*` stands for any name: `sensors.*.rate`."""

    key: str
    to: str


STEPS: tuple[tuple[Rename, ...], ...] = ()
"""What was renamed: the first entry leads from format 1 to format 2."""


def newest() -> int:
    """The newest format of scene files, which this version writes."""
    return 1 + len(STEPS)


def written(raw: dict[str, Any]) -> int:
    """The format that a file states, 1 where it states none. Raises ValueError for a format that is not known."""
    stated = raw.get("format", 1)
    if isinstance(stated, bool) or not isinstance(stated, int) or stated < 1:
        raise ValueError(f"format = {brief(stated)}: expected a whole number; this version {_READS} {newest()}")
    if stated > newest():
        raise ValueError(
            f"format = {brief(stated)}: this version of friction-rig {_READS} {newest()}; install a newer version"
        )
    return stated


def called(key: str, since: int) -> str:
    """The newest name of a dotted key of format `since`."""
    names = key.split(".")
    for step in STEPS[since - 1 :]:
        now = [_ENTRY.sub("", name) for name in names]
        for rename in step:
            pattern = rename.key.split(".")
            if len(pattern) <= len(now) and all(p in ("*", name) for p, name in zip(pattern, now)):
                last = len(pattern) - 1
                names[last] = rename.to + names[last][len(now[last]) :]
    return ".".join(names)


def successor(key: str) -> str:
    """The newest name of a dotted key that an older format had; "" for a key that was never renamed."""
    names = (called(key, since) for since in range(1, newest()))
    return next((name for name in names if name != key), "")


def migrated(raw: Any, since: int, key: str = "") -> Any:
    """The tables of a file of format `since`, with the newest names.

    Raises ValueError where the file gives a key by its former name and by its newest one.
    """
    if isinstance(raw, dict):
        tables: dict[str, Any] = {}
        given: dict[str, str] = {}
        for name, value in raw.items():
            inside = f"{key}.{name}" if key else name
            now = _last(called(inside, since))
            if now in tables:
                raise ValueError(f"{given[now]} and {inside} are one key since format {newest()}; remove one of them")
            tables[now], given[now] = migrated(value, since, inside), inside
        return tables
    if isinstance(raw, list):
        return [migrated(entry, since, f"{key}[{i}]") for i, entry in enumerate(raw, 1)]
    return raw


def recorded(raw: dict[str, Any], since: int) -> dict[str, Any]:
    """A scene from a recording, written when scene files had format `since`, with the newest names."""
    tables = migrated({**raw["parameters"], **{room: raw[room] for room in ROOMS}}, since)
    rooms = {room: tables.pop(room) for room in ROOMS}
    origins = {called(key, since): origin for key, origin in raw["origins"].items()}
    return {**raw, **rooms, "parameters": tables, "origins": origins}


def rewritten(text: str) -> tuple[str, list[str]]:
    """The text of a scene file in the newest format, and what was renamed, a line each. All else stays as it is.

    Raises ValueError for a format that is not known, and as `migrated`.
    """
    raw = tomllib.loads(text)
    since = written(raw)
    if since == newest():
        return text, []
    migrated(raw, since)
    key_parts = parts(text)
    edits = [
        (part.begin, part.end, now) for part in key_parts if (now := _last(called(part.key, since))) != _last(part.key)
    ]
    renames = renamed((part.key for part in key_parts), since)
    stated = [_NUMBER.match(text, part.end) for part in key_parts if part.key == "format"]
    edits += [(*number.span(1), str(newest())) for number in stated if number is not None]
    for begin, end, now in sorted(edits, reverse=True):
        text = text[:begin] + now + text[end:]
    line = f"format = {newest()}" + ("\r\n" if "\r\n" in text else "\n")
    return (text if stated else line + text), renames


def renamed(keys: Iterable[str], since: int) -> list[str]:
    """A line for each of these keys of format `since` that has another name now."""
    named = dict.fromkeys(key for key in keys if _last(called(key, since)) != _last(key))
    return [f"{key} is now called {called(key, since)}" for key in named]


def _last(key: str) -> str:
    return _ENTRY.sub("", key.rpartition(".")[2])
