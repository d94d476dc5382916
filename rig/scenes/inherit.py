"""Inheritance of scene files: a file states only what differs from the scene that it is based on.

    based_on = "brake"          a shipped scene, or the path of a file, from the folder of this one

Tables are merged. `key = "none"` removes a value, an effect, a sensor or a controller. Everything else is replaced; a
protocol is replaced as a whole. Title and description are not inherited.
"""

from __future__ import annotations

import os
import re
import time
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any

from rig.errors import SceneError
from rig.scenes import places, shipped, source
from rig.scenes.faults import lookup, shown

OWN = ("title", "about")
"""Keys that a scene does not inherit."""
_LONGEST = 20  # files that are based on one another. chosen
LONGEST_S = 5.0
"""Longest time [s] in which the files of a folder are read for their cards; the others are listed without. # chosen"""
_NAME = re.compile(r"[^.\[\]]+|\[\d+\]")


@dataclass(frozen=True)
class Layer:
    """One file of a scene: its tables, and `name`, which messages use."""

    path: Path
    name: str
    text: str
    raw: dict[str, Any]
    based_on: Any = None

    @cached_property
    def lines(self) -> dict[str, int]:
        """Dotted key -> its line in the file."""
        return places.lines(self.text)

    def place(self, key: str) -> places.Place:
        """The place in the file."""
        return places.Place(self.name, self.lines.get(key, 1))


class Places:
    """The places of the values of a scene: its files, the base first, and `changes` by the caller."""

    def __init__(self, layers: Sequence[Layer], changes: Mapping[str, places.Place], raw: Mapping[str, Any]) -> None:
        self.files = tuple(layer.name for layer in layers)
        self._layers = layers
        self._changes = changes
        self._raw = raw

    def of(self, key: str) -> places.Place | None:
        """The place that gave the value `key`; None for a default."""
        if key in self._changes:
            return self._changes[key]
        if lookup(self._raw, _path(key)) is None:
            return None
        whole = key.partition("[")[0]
        for layer in reversed(self._layers):
            if not layer.lines.keys().isdisjoint((whole, f"{whole}[1]")):
                return next((layer.place(stated) for stated in (key, f"{key}[1]") if stated in layer.lines), None)
        return None

    def near(self, key: str) -> places.Place | None:
        """The place that gave or removed the value `key`, or else the table that should contain it.

        For a table of the scene that is nowhere: the place of its plant, which needs the table.
        """
        inside = key
        while inside:
            place = self.of(inside) or self._made(inside) or self._taken(inside)
            if place is not None:
                return place
            inside = inside[: max(inside.rfind("."), inside.rfind("["), 0)]
        return None if "." in key else self.of("plant")

    def _made(self, table: str) -> places.Place | None:
        """The place of a change in a table that no file has."""
        return next((place for change, place in self._changes.items() if change.startswith(f"{table}.")), None)

    def _taken(self, key: str) -> places.Place | None:
        """The place of the "none" that removed the value `key`."""
        taking = (layer for layer in reversed(self._layers) if lookup(layer.raw, _path(key)) == "none")
        return next((layer.place(key) for layer in taking), None)


def _path(key: str) -> list[int | str]:
    """A dotted key as names of tables and places in lists, which it counts from one."""
    return [int(name[1:-1]) - 1 if name[0] == "[" else name for name in _NAME.findall(key)]


def layers(path: Path) -> list[Layer]:
    """The files of a scene, the last base first. Raises SceneError if one of them cannot be read."""
    first = last = _layer(path, path.parent)
    chain = [last]
    seen = [_same(path)]
    while (base := last.based_on) is not None:
        text = f"based_on = {shown(base)}"
        place = last.place("based_on")
        try:
            if not isinstance(base, str):
                raise SceneError("", ["expected the name of a shipped scene, or the path of a scene file"])
            at = shipped.path(base, last.path.parent)
            if _same(at) in seen:
                names = [layer.name for layer in chain[seen.index(_same(at)) :]]
                raise SceneError(
                    "", [f"the files are based on one another in a circle: {', '.join([*names, names[0]])}"]
                )
            if len(chain) == _LONGEST:
                raise SceneError("", [f"more than {_LONGEST} files are based on one another"])
            last = _layer(at, path.parent)
        except SceneError as error:
            raise SceneError(str(first.path), [f"{text}: {fault} ({place})" for fault in error.faults]) from None
        chain.append(last)
        seen.append(_same(at))
    return chain[::-1]


def cards(folder: Path) -> list[dict[str, Any]]:
    """The cards (`shipped.card_of`) of the scene files in a folder. A file that is no scene is left out.

    The title of a file that cannot be read says why. Raises SceneError for what is no folder.
    """
    if not folder.is_dir():
        raise SceneError(str(folder), ["is not a folder; rig explain SCENE shows one scene"])
    rows = []
    until = time.monotonic() + LONGEST_S
    for file in sorted(folder.glob("*.toml")):
        try:
            if time.monotonic() > until:
                raise SceneError(str(file), [f"reading this folder took longer than {LONGEST_S:g} s"])
            rows.append(shipped.card_of(str(file), [(layer.based_on, layer.raw) for layer in layers(file)]))
        except Exception as error:  # of whatever is in the file: the other rows do not depend on it
            faults = error.faults if isinstance(error, SceneError) else [str(error)]
            title = f"cannot be read: {' '.join('; '.join(faults).split()).removeprefix('cannot be read: ')}"
            row = {"name": str(file), "based_on": None, "plant": None, "title": title, "about": "", "pace_limit": None}
            rows.append(row)
    return [row for row in rows if row["plant"] or row["title"]]


def _layer(path: Path, folder: Path) -> Layer:
    text = source.text(path)
    raw = source.parsed(path, text)
    name = f"scene {path.stem}" if path.parent == shipped.HERE else os.path.relpath(path, folder)
    try:
        source.check_format(raw.pop("format", source.FORMAT))
    except ValueError as fault:
        raise SceneError(str(path), [f"{fault} ({name}, line {places.lines(text)['format']})"]) from None
    return Layer(path, name, text, raw, raw.pop("based_on", None))


def _same(path: Path) -> str:
    """One text for each file, whatever its path."""
    return str(path) if "\0" in str(path) else os.path.realpath(path)  # the system knows no such name
