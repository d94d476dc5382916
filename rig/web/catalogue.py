"""The scenes that the page offers: those that are shipped, and the scene files of one folder."""

from __future__ import annotations

import json
import math
import os
import re
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from rig.bench.job import keeps_up
from rig.errors import UsageError
from rig.quantities import finite
from rig.scenes import load, migration, names
from rig.scenes.inherit import cards
from rig.scenes.places import Place
from rig.scenes.scene import Scene
from rig.scenes.shipped import card
from rig.units import with_point

_NAME = re.compile(r"[A-Za-z][A-Za-z0-9_]{0,63}")
_PAGE = Place("on the page", 0)
PACES = (1e-3, 1e6)
"""Slowest and fastest pace."""
LONGEST = 1e6
"""Longest duration of a run [s]."""


class Catalogue:
    """The shipped scenes and the scene files of `folder`."""

    def __init__(self, folder: Path) -> None:
        self._folder = folder

    def cards(self) -> list[dict[str, Any]]:
        """Name, title, plant and first line of the description of every scene; `own`: it is a file of the folder.

        The title of a file that cannot be read says why.
        """
        return [{**one, "own": True} for one in cards(self._folder)] + [
            {**card(name), "own": False} for name in names()
        ]

    def scene(self, name: Any, changes: Any = None) -> Scene:
        """The scene with changed values. Raises SceneError with every fault, as the command line does."""
        if not isinstance(name, str) or not (name in names() or self._has(name)):
            raise UsageError(f"no scene is called {name!r:.80}; choose one of the list")
        if not isinstance(changes or {}, dict) or not all(isinstance(key, str) for key in changes or {}):
            raise UsageError(f'"changes" is {changes!r:.80}; expected values by their keys')
        texts = {key: as_text(value, key) for key, value in (changes or {}).items()}
        return load(name, texts, dict.fromkeys(texts, _PAGE))

    def _has(self, name: str) -> bool:
        """Whether a text is the name that the list has for a file of the folder. No file is read."""
        file = Path(name)
        return file.suffix == ".toml" and name == str(self._folder / file.name) and os.path.lexists(file)

    def save(self, file: Any, based_on: str, changes: Mapping[str, Any]) -> Path:
        """Write a scene file that is based on another scene and contains the changed values; returns its path.

        Raises SceneError for values that cannot be used, UsageError for a name that cannot be used or exists.
        """
        if not isinstance(file, str) or not _NAME.fullmatch(file):
            raise UsageError(
                f"{file!r:.80} cannot name a scene: expected letters, digits and '_', at most 64, a letter first"
            )
        path = self._folder / f"{file}.toml"
        taken = UsageError(f"a scene {file} exists already; choose another name")
        if path.exists() or file in names():
            raise taken
        scene = self.scene(based_on, changes)
        base = based_on if based_on in names() else str(Path(based_on).relative_to(self._folder))
        text = scene_file(base, f"{scene.title}, changed", changes)
        try:
            with path.open("x", encoding="utf-8") as made:
                made.write(text)
        except FileExistsError:
            raise taken from None
        except OSError:  # a full disk: no half of a scene is left
            path.unlink(missing_ok=True)
            raise
        return path


def scene_file(base: str, title: str, changes: Mapping[str, Any]) -> str:
    """The text of a scene file with these changes; its values are those that the user gave."""
    head = [f"format = {migration.newest()}", f"based_on = {_toml(base)}", f"title = {_toml(title)}"]
    tables: dict[str, list[str]] = {}
    for key, value in changes.items():
        table, _, name = key.rpartition(".")
        tables.setdefault(table, []).append(f'{name} = [{_toml(value)}, "user", "saved on the page"]')
    lines = [*head, *tables.pop("", [])]
    for table, entries in tables.items():
        lines += ["", f"[{table}]", *entries]
    return "\n".join([*lines, ""])


def _toml(value: Any) -> str:
    """A number, a truth value or a text in TOML; a text that is a number is a number."""
    if isinstance(value, bool):
        return str(value).lower()
    try:
        number = float(value)
    except (TypeError, ValueError):
        number = math.nan
    if math.isfinite(number):
        return str(int(number)) if number.is_integer() and abs(number) < 1e15 else repr(number)
    return json.dumps(str(value), ensure_ascii=False).replace("\x7f", "\\u007f")


def as_text(value: Any, key: str) -> str:
    """The value of `key` on the page as the command line would give it. Raises UsageError for what is no value."""
    if isinstance(value, bool):
        return str(value).lower()
    if isinstance(value, float):
        return repr(value)
    if isinstance(value, str):
        return with_point(value, key)
    if isinstance(value, int):
        return str(value)
    raise UsageError(f"{key} {value!r:.80} is not a value; expected a number, a truth value or a text such as '2 rpm'")


def timing(scene: Scene, pace: Any, duration: Any) -> tuple[float | None, float | None]:
    """Pace (None: as fast as possible) and duration [s] (None: that of the protocol) of a run. Raises UsageError."""
    try:
        factor = None if pace == "max" else 1.0 if pace in (None, "") else finite(pace, "1")
        if factor is not None and not PACES[0] <= factor <= PACES[1]:
            raise ValueError(f"is {factor:g}; must be {PACES[0]:g} to {PACES[1]:g}, or max")
    except ValueError as fault:
        raise UsageError(f"the pace {fault}") from None
    try:
        length = None if duration in (None, "") else finite(duration, "s")
        if length is not None and not 1e-9 <= length <= LONGEST:
            raise ValueError(f"is {length:g} s; must be 1e-09 to {LONGEST:g} s")
    except ValueError as fault:
        raise UsageError(f"the duration {fault}") from None
    keeps_up(scene, factor)
    return factor, length
