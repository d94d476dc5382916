"""The shipped scenes: names, files, titles. Reads no more of a file than asked for."""

from __future__ import annotations

import os
import re
import tomllib
from collections.abc import Mapping, Sequence
from functools import cache
from math import isfinite
from pathlib import Path
from typing import Any

from rig.errors import SceneError
from rig.units import brief

HERE = Path(__file__).parent
_PLANT = re.compile(r'^plant\s*=\s*"([^"]*)"', re.MULTILINE)
_BASE = re.compile(r'^based_on\s*=\s*"([^"]*)"', re.MULTILINE)
_TABLE = re.compile(r"^(?=\[[a-z])", re.MULTILINE)


@cache
def names() -> tuple[str, ...]:
    """Names of the shipped scenes."""
    return tuple(sorted(path.stem for path in HERE.glob("*.toml")))


def path(name_or_path: str | Path, folder: Path = Path()) -> Path:
    """The file of a shipped scene, or of a path relative to `folder`. Raises SceneError, with near names."""
    text = str(name_or_path)
    shipped = HERE / f"{text}.toml"
    if text in names():
        return shipped
    given = Path(name_or_path)
    if not given.name:
        raise SceneError(repr(text), ["names no scene; rig list shows the shipped ones"])
    if text.startswith('{"'):  # Run.scene
        raise SceneError(brief(text)[1:-1], ["is the text of a scene; rig.scenes.scene.Scene.from_json reads it"])
    if given.suffix in (".toml", ".mcap") or "/" in text:  # who reads a recording as a scene says what it is
        if given.stem in names() and given.name == text and not os.path.lexists(folder / given):
            raise SceneError(text, [f"there is no such file; the shipped scene is called {given.stem}"])
        return folder / given
    from rig.scenes.faults import near

    beside = given.with_suffix(".toml")
    hint = f"the file is called {beside}" if os.path.isfile(folder / beside) else near(text, names(), "rig list")
    raise SceneError(brief(text)[1:-1], [f"no scene has this name; {hint}"])


def card(name: str) -> dict[str, Any]:
    """Title, plant, description and largest pace of a shipped scene; the scene it is based on."""
    return card_of(name, _tables(name))


def card_of(name: str, chain: Sequence[tuple[str | None, Mapping[str, Any]]]) -> dict[str, Any]:
    """The card of the scene `name` from its files, the last base first: of each, what it is based on, and its tables.

    No part is loaded. Raises SceneError for a value that no scene can have.
    """
    based_on, last = chain[-1]
    plant: Any = None
    limit: Any = None
    for _, raw in chain:
        plant, clock = _plain(raw.get("plant", plant)), raw.get("clock", {})
        if not isinstance(clock, Mapping) and clock != "none":
            raise SceneError(name, [f"clock = {brief(clock)}: expected a table [clock]"])
        limit = _plain(clock.get("pace_limit", limit)) if isinstance(clock, Mapping) else None
    texts = {"plant": plant or "", **{key: _plain(last.get(key, "")) for key in ("title", "about")}}
    for key, text in texts.items():
        if not isinstance(text, str):
            raise SceneError(name, [f"{key} = {brief(text)}: expected a text"])
    try:
        pace_limit = None if limit in (None, "none") else float(limit)
        if isinstance(limit, bool) or not isfinite(pace_limit or 0.0):
            raise ValueError
    except (TypeError, ValueError):
        raise SceneError(name, [f"clock.pace_limit = {brief(limit)}: expected a number or none"]) from None
    return {
        "name": name,
        "based_on": based_on,
        "plant": plant,
        "title": texts["title"],
        "about": texts["about"].strip(),
        "pace_limit": pace_limit,
    }


def _plain(value: Any) -> Any:
    """A value without its origin."""
    return value[0] if isinstance(value, list) and value else value


def _tables(name: str) -> list[tuple[str | None, dict[str, Any]]]:
    """What `card_of` reads of a shipped scene: of each of its files the begin and the clock."""
    head, *tables = _TABLE.split(_text(name))
    raw = tomllib.loads(head + "".join(table for table in tables if table.startswith("[clock]")))
    base = raw.get("based_on")
    return [*(_tables(base) if base else []), (base, raw)]


@cache
def text_of(name: str) -> str:
    """The text of a shipped scene, and behind it that of the scenes that it is based on."""
    text = _text(name)
    base = _BASE.search(text)
    return text + text_of(base[1]) if base else text


def plant(name: str) -> str:
    """The plant of a shipped scene, without parsing the file."""
    stated = _PLANT.search(text_of(name))
    assert stated is not None
    return stated[1]


def _text(name: str) -> str:
    return (HERE / f"{name}.toml").read_text(encoding="utf-8")
