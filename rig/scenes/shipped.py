"""The shipped scenes: names, files, titles. Reads no more of a file than asked for."""

from __future__ import annotations

import os
import re
import tomllib
from functools import cache
from pathlib import Path
from typing import Any

from rig.errors import SceneError

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
    if given.suffix in (".toml", ".mcap") or "/" in text:  # who reads a recording as a scene says what it is
        if given.stem in names() and given.name == text and not os.path.lexists(folder / given):
            raise SceneError(text, [f"there is no such file; the shipped scene is called {given.stem}"])
        return folder / given
    from rig.scenes.faults import near
    from rig.units import brief

    beside = given.with_suffix(".toml")
    hint = f"the file is called {beside}" if os.path.isfile(folder / beside) else near(text, names(), "rig list")
    raise SceneError(brief(text)[1:-1], [f"no scene has this name; {hint}"])


def card(name: str, folder: Path = Path()) -> dict[str, Any]:
    """Title, plant and first line of the description of a scene, and its largest pace where it has one.

    `name`: of a shipped scene, or the path of a file from `folder` on. `based_on` is the scene that it is based on,
    None if it has no base.
    """
    file = path(name, folder)
    head, *tables = _TABLE.split(file.read_text(encoding="utf-8"))
    raw = tomllib.loads(head + "".join(table for table in tables if table.startswith("[clock]")))
    base = raw.get("based_on")
    inherited = card(base, file.parent) if base else {"plant": raw.get("plant"), "pace_limit": None}
    limit = raw.get("clock", {}).get("pace_limit", inherited["pace_limit"])
    return {
        "name": name,
        "based_on": base,
        "plant": raw.get("plant", inherited["plant"]),
        "title": str(raw.get("title", "")),
        "about": str(raw.get("about", "")).strip().split("\n")[0],
        "pace_limit": None if limit in (None, "none") else float(limit[0] if isinstance(limit, list) else limit),
    }


def cards(folder: Path) -> list[dict[str, Any]]:
    """The cards of the scene files in a folder. No part is loaded; a file that is no scene is left out.

    Raises SceneError for what is no folder.
    """
    if not folder.is_dir():
        raise SceneError(str(folder), ["is not a folder; rig explain SCENE shows one scene"])
    found = []
    for file in sorted(folder.glob("*.toml")):
        try:
            found.append(card(str(file)))
        except (SceneError, OSError, ValueError, RecursionError) as error:
            title = f"cannot be read: {' '.join(str(error).split())}"
            found.append(
                {"name": str(file), "based_on": None, "plant": None, "title": title, "about": "", "pace_limit": None}
            )
    return [one for one in found if one["plant"] or one["title"]]


def plant(name: str) -> str:
    """The plant of a shipped scene, without parsing the rest of the file."""
    text = _text(name)
    if found := _PLANT.search(text):
        return found[1]
    base = _BASE.search(text)
    assert base is not None
    return plant(base[1])


def _text(name: str) -> str:
    return (HERE / f"{name}.toml").read_text(encoding="utf-8")
