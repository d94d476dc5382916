"""The scenes that the page offers: those that are shipped, and the scene files of one folder, to which it adds."""

from __future__ import annotations

import json
import math
import os
import re
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from rig.errors import UsageError
from rig.scenes import load, names
from rig.scenes.inherit import cards
from rig.scenes.places import Place
from rig.scenes.scene import Scene
from rig.scenes.shipped import card, groups
from rig.scenes.source import FORMAT
from rig.web.form import as_text

_NAME = re.compile(r"[A-Za-z][A-Za-z0-9_]{0,63}")
"""Name of a file that is saved."""
_PAGE = Place("on the page", 0)
"""Where a value of the page was given, for messages."""


class Catalogue:
    """The shipped scenes and the scene files of `folder`."""

    def __init__(self, folder: Path) -> None:
        self._folder = folder

    def cards(self) -> list[dict[str, Any]]:
        """Name, title, plant and description of every scene; of shipped ones what happens; `own`: a file of the folder.

        The title of a file that cannot be read says why.
        """
        of_folder = [{**shown, "own": True} for shown in cards(self._folder)]
        shipped = [{**card(name), "own": False, "group": group} for name, group in groups().items()]
        return of_folder + shipped

    def scene(self, name: Any, changes: Any = None) -> Scene:
        """The scene with changed values. Raises SceneError with every fault, as the command line does."""
        if not isinstance(name, str) or not (name in names() or self._has(name)):
            raise UsageError(f"no scene is called {name!r:.80}; choose one of the list")
        values = changes or {}
        if not isinstance(values, dict) or not all(isinstance(key, str) for key in values):
            raise UsageError(f'"changes" is {changes!r:.80}; expected values by their keys')
        texts = {key: as_text(value, key) for key, value in values.items()}
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
            with path.open("x", encoding="utf-8") as stream:
                stream.write(text)
        except FileExistsError:
            raise taken from None
        except OSError:  # a full disk: no half of a scene is left
            path.unlink(missing_ok=True)
            raise
        return path


def scene_file(base: str, title: str, changes: Mapping[str, Any]) -> str:
    """The text of a scene file with these changes; its values are those that the user gave."""
    head = [f"format = {FORMAT}", f"based_on = {_toml(base)}", f"title = {_toml(title)}"]
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
