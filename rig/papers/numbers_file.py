"""The file of numbers of a folder of figures: a figure can be made again while the page keeps the others."""

from __future__ import annotations

import json
import math
from collections.abc import Iterable
from dataclasses import fields
from pathlib import Path
from typing import Any

from rig.papers.entry import Comparison, Result, entries
from rig.user_files import DATA, contents, write_file

_FILE = "numbers.json"


def keep(results: Iterable[Result], folder: Path) -> list[Result]:
    """Write `results` into `folder`, replacing older ones of the same figures; return all, in the order of the
    papers.
    """
    found = {one.entry.name: one for one in (*_kept(folder), *results)}
    held = [found[name] for name in entries() if name in found]
    text = json.dumps([stored(one) for one in held], indent=1, allow_nan=False)
    write_file(folder / _FILE, f"{text}\n".encode())
    return held


def stored(result: Result) -> dict[str, Any]:
    """Return a result as JSON values, its picture without the folder."""
    return {**result.to_json(), "picture": result.picture.name}


def restored(raw: dict[str, Any], folder: Path) -> Result:
    """Return the result of `stored`, whose picture is in `folder`."""
    compared = tuple(map(_compared, raw["comparisons"]))
    return Result(entries()[raw["name"]], compared, folder / raw["picture"], raw["seconds"])


def _kept(folder: Path) -> list[Result]:
    """The results of earlier calls, for figures that still exist."""
    try:
        read = json.loads(contents(folder / _FILE, DATA))
    except (OSError, ValueError):
        return []
    return [restored(one, folder) for one in read if one["name"] in entries()]


def _compared(raw: dict[str, Any]) -> Comparison:
    values = {field.name: raw[field.name] for field in fields(Comparison) if field.name in raw}
    return Comparison(**values | {name: math.nan for name in ("ours", "expected") if raw[name] is None})
