"""The file of numbers of a folder of figures: a figure can be made again while the page keeps the others."""

from __future__ import annotations

import json
import math
from collections.abc import Iterable
from dataclasses import fields
from pathlib import Path
from typing import Any

from rig.papers.entry import Comparison, Result, entries
from rig.user_files import write_file

_FILE = "numbers.json"


def keep(results: Iterable[Result], folder: Path) -> list[Result]:
    """Write `results` into `folder`, replacing older ones of the same figures; return all, in the order of the
    papers.
    """
    found = {one.entry.name: one for one in (*_kept(folder), *results)}
    held = [found[name] for name in entries() if name in found]
    text = json.dumps([{**one.to_json(), "picture": one.picture.name} for one in held], indent=1, allow_nan=False)
    write_file(folder / _FILE, f"{text}\n".encode())
    return held


def _kept(folder: Path) -> list[Result]:
    """The results of earlier calls, for figures that still exist."""
    try:
        stored = json.loads((folder / _FILE).read_text())
    except (OSError, ValueError):
        return []
    return [
        Result(
            entry=entries()[one["name"]],
            comparisons=tuple(map(_compared, one["comparisons"])),
            picture=folder / one["picture"],
            seconds=one["seconds"],
        )
        for one in stored
        if one["name"] in entries()
    ]


def _compared(stored: dict[str, Any]) -> Comparison:
    values = {field.name: stored[field.name] for field in fields(Comparison) if field.name in stored}
    return Comparison(**values | {"ours": math.nan if stored["ours"] is None else stored["ours"]})
