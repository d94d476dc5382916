"""Formats of scene files: how a file of an older format is read, and how it is rewritten to the newest one.

A file states its format at its top: `format = 1`; a file without this line has format 1. `STEPS` holds what was renamed
from each format to the next. To rename a key of scene files, add a step: files and recordings of older formats are
then read with the new name, and `rig migrate` rewrites files. A step renames keys only: the target of a protocol step
is a value and keeps its name.
"""

from __future__ import annotations

import re
import tomllib
from collections.abc import Iterable
from typing import Any, NamedTuple

from rig.scenes.faults import shown
from rig.scenes.places import parts

ROOMS = ("clock", "sensors", "controllers", "protocol", "limits")
"""What a recorded scene holds beside the parameters of its plant."""
_ENTRY = re.compile(r"\[\d+\]")
_FORMAT = re.compile(r"^(format\s*=\s*)\d+", re.MULTILINE)


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
    found = raw.get("format", 1)
    if isinstance(found, bool) or not isinstance(found, int) or found < 1:
        raise ValueError(f"format = {shown(found)}: expected a whole number from 1 to {newest()}")
    if found > newest():
        raise ValueError(
            f"format = {shown(found)}: this version of friction-rig reads scene files up to format {newest()}; "
            "install a newer version"
        )
    return found


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


def migrated(raw: Any, since: int, key: str = "") -> Any:
    """The tables of a file of format `since`, with the newest names."""
    if isinstance(raw, dict):
        inside = {name: f"{key}.{name}" if key else name for name in raw}
        return {_last(called(inside[name], since)): migrated(raw[name], since, inside[name]) for name in raw}
    if isinstance(raw, list):
        return [migrated(one, since, f"{key}[{i}]") for i, one in enumerate(raw, 1)]
    return raw


def recorded(raw: dict[str, Any], since: int) -> dict[str, Any]:
    """A scene from a recording, written when scene files had format `since`, with the newest names."""
    tables = migrated({**raw["parameters"], **{room: raw[room] for room in ROOMS}}, since)
    rooms = {room: tables.pop(room) for room in ROOMS}
    origins = {called(key, since): origin for key, origin in raw["origins"].items()}
    return {**raw, **rooms, "parameters": tables, "origins": origins}


def rewritten(text: str) -> tuple[str, list[str]]:
    """The text of a scene file in the newest format, and what was renamed, a line each. All else stays as it is.

    Raises ValueError for a format that is not known.
    """
    since = written(tomllib.loads(text))
    if since == newest():
        return text, []
    edits = [(part, now) for part in parts(text) if (now := _last(called(part.key, since))) != _last(part.key)]
    told = renamed((part.key for part, _ in edits), since)
    for part, now in reversed(edits):
        text = text[: part.begin] + now + text[part.end :]
    text, count = _FORMAT.subn(rf"\g<1>{newest()}", text, count=1)
    return (text if count else f"format = {newest()}\n{text}"), told


def renamed(keys: Iterable[str], since: int) -> list[str]:
    """A line for each of these keys of format `since` that has another name now."""
    named = dict.fromkeys(key for key in keys if _last(called(key, since)) != _last(key))
    return [f"{key} is now called {called(key, since)}" for key in named]


def _last(key: str) -> str:
    return _ENTRY.sub("", key.rpartition(".")[2])
