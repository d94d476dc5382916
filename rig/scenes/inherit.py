"""Scene files that are based on one another: each says only in what it differs from its base.

    based_on = "brake"          a shipped scene, or the path of a file, from the folder of this one

Tables are merged. `key = "none"` takes a value, an effect, a sensor or a controller away. Everything else is replaced;
a protocol is replaced as a whole. Title and description are not inherited.
"""

from __future__ import annotations

import os
import re
from collections.abc import Collection, Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any

from rig.errors import SceneError
from rig.scenes import migration, places, shipped, source
from rig.scenes.faults import shown
from rig.scenes.places import Origin, Place

OWN = ("title", "about")
"""What a scene does not inherit."""
_LONGEST = 20
_NAME = re.compile(r"[^.\[\]]+|\[\d+\]")


@dataclass(frozen=True)
class Layer:
    """One file of a scene: its tables with the newest names, and `name`, by which users are told of it."""

    path: Path
    name: str
    text: str
    raw: dict[str, Any]
    format: int

    @cached_property
    def lines(self) -> dict[str, int]:
        """Dotted key -> its line in the file."""
        return {migration.called(key, self.format): line for key, line in places.lines(self.text).items()}

    def place(self, key: str) -> Place:
        """Where the file says something."""
        return Place(self.name, self.lines.get(key, 1))

    @property
    def note(self) -> str:
        """What was renamed as the file was read; "" if nothing."""
        if self.format == migration.newest():
            return ""
        told = migration.renamed((part.key for part in places.parts(self.text)), self.format)
        if not told:
            return ""
        return f"{self.name} is in format {self.format}: {'; '.join(told)} (rig migrate {self.path} rewrites it)"


class Places:
    """Where the values of a scene come from: the files it was read from, its base first, and changes with -p."""

    def __init__(self, layers: Sequence[Layer], changes: Collection[str], raw: Mapping[str, Any]) -> None:
        self.files = tuple(layer.name for layer in layers)
        self._layers, self._changes, self._raw = layers, frozenset(changes), raw

    def of(self, key: str) -> Place | None:
        """Where the value `key` was given; None for a default."""
        if key in self._changes:
            return Place("", 0)
        if not self._there(key):
            return None
        whole = key.partition("[")[0]
        for layer in reversed(self._layers):
            if not layer.lines.keys().isdisjoint((whole, f"{whole}[1]")):
                return layer.place(key) if key in layer.lines else None
        return None

    def near(self, key: str) -> Place | None:
        """Where the value `key` was given, or else the table that should have it."""
        while key:
            found = self.of(key)
            if found is not None:
                return found
            key = key[: max(key.rfind("."), key.rfind("["), 0)]
        return None

    def _there(self, key: str) -> bool:
        value: Any = self._raw
        for name in _NAME.findall(key):
            if isinstance(value, Mapping) and name in value:
                value = value[name]
            elif isinstance(value, list) and name[0] == "[" and 0 < int(name[1:-1]) <= len(value):
                value = value[int(name[1:-1]) - 1]
            else:
                return False
        return True


def layers(path: Path) -> list[Layer]:
    """The files of a scene, the last base first. Raises SceneError where one of them cannot be read."""
    first = found = _layer(path, path.parent)
    chain, seen = [found], [_same(path)]
    while (base := found.raw.pop("based_on", None)) is not None:
        said = f"based_on = {shown(base)}"
        place = found.place("based_on")
        try:
            if not isinstance(base, str):
                raise SceneError("", ["expected the name of a shipped scene, or the path of a scene file"])
            at = shipped.path(base, found.path.parent)
            if _same(at) in seen:
                names = [layer.name for layer in chain[seen.index(_same(at)) :]]
                raise SceneError(
                    "", [f"the files are based on one another in a circle: {', '.join([*names, names[0]])}"]
                )
            if len(chain) == _LONGEST:
                raise SceneError("", [f"more than {_LONGEST} files are based on one another"])
            found = _layer(at, path.parent)
        except SceneError as error:
            raise SceneError(str(first.path), [f"{said}: {fault} ({place})" for fault in error.faults]) from None
        chain.append(found)
        seen.append(_same(at))
    return chain[::-1]


def _layer(path: Path, folder: Path) -> Layer:
    text = source.text(path)
    raw = source.parsed(path, text)
    name = f"scene {path.stem}" if path.parent == shipped.HERE else os.path.relpath(path, folder)
    try:
        since = migration.written(raw)
    except ValueError as fault:
        raise SceneError(str(path), [f"{fault} ({name}, line {places.lines(text)['format']})"]) from None
    raw.pop("format", None)
    return Layer(path, name, text, migration.migrated(raw, since) if since < migration.newest() else raw, since)


def _same(path: Path) -> str:
    """One text for one file, however it is named."""
    return os.path.realpath(path)


def lay(
    over: Mapping[str, Any],
    raw: dict[str, Any],
    origins: dict[str, Origin],
    own: dict[str, Origin],
    recast: dict[str, tuple[str, Any]],
    key: str = "",
) -> Iterator[tuple[str, str]]:
    """Put the tables `over` of a file over those of its base, `raw`; yields (dotted key, line) for every fault.

    `origins` are those of the base, `own` those of the file, which are put over them in the end. `recast` takes up the
    tables of a changed kind: which key says it, what it said.
    """
    for name, value in over.items():
        here = f"{key}.{name}" if key else name
        before = raw.get(name)
        if value == "none":
            if name not in raw:
                yield here, f"{here}: is not in the base, so it cannot be taken away"
            raw.pop(name, None)
            source.forget(origins, here)
        elif isinstance(value, Mapping):
            table = before if isinstance(before, dict) else {}
            if table is not before:
                source.forget(origins, here)
            raw[name] = table
            yield from lay(value, table, origins, own, recast, here)
        else:
            if key and name in source.KIND and name in raw and before != value:
                recast[key] = name, before
            if here not in own or isinstance(before, dict | list):
                source.forget(origins, here)
            raw[name] = value
    if not key:
        origins |= own
