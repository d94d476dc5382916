"""The text of a new scene file, ready to edit: what it is based on, and the values most worth changing as comments."""

from __future__ import annotations

import json
import shlex
from collections.abc import Iterator
from typing import Annotated, Any, get_args, get_origin

from pydantic import BaseModel

from rig.quantities import Range, Unit
from rig.scenes import migration
from rig.scenes.scene import Scene

FIRST = ("drive", "load", "friction")
"""Tables that come first: what an experiment varies."""
_TABLES, _VALUES = 5, 5  # as many as a reader looks through
_HEAD = """\
# A scene based on {base}. It has all values of {base}, except those that this file changes. Next steps:
#   rig explain {file}            every value with its origin, and the file and line it comes from
#   rig simulate {file}           as fast as possible
#   rig run {file} --view         paced by the clock, live in rerun
# To change a value, remove the # of its line. You may state its origin and a note: ["0.1 m/s", "chosen", "why"].
# KEY = "none" takes a value away, or an effect, a sensor, a controller; [[protocol]] replaces the whole protocol.

format = {format}
based_on = {name}
title = {title}
# about = "What differs from the base, and what one sees."
"""


def draft(base: Scene, based_on: str, file: str) -> str:
    """The text of a scene file called `file`; `based_on`: what it says of its base, `base`."""
    name, title = _text(based_on), _text(f"{base.title}, changed")
    head = _HEAD.format(
        base=_plain(based_on), file=shlex.quote(_plain(file)), format=migration.newest(), name=name, title=title
    )
    return "\n".join([head, *(line for table in _tables(base) for line in table)])


def _tables(base: Scene) -> Iterator[list[str]]:
    """The lines of each table."""
    found: dict[str, list[str]] = {}
    values = base.values()
    inputs = base.assemble().inputs
    for key, origin in base.origins.items():
        table, _, field = key.rpartition(".")
        value, unit = values.get(key, (None, ""))
        allowed = _allowed(base.parameters, key)
        if allowed is None or isinstance(value, bool) or not isinstance(value, int | float):
            continue  # of no parameter of the plant, a choice, or a list
        if key in inputs:
            low, high = f"{inputs[key].low:g}", f"{inputs[key].high:g}"
            allowed = f"{low} to {high}" + ("" if unit == "1" else f" {unit}")
        told = f"{origin.origin}: {origin.note}" if origin.note else origin.origin
        given = f"{value:g}" if float(f"{value:g}") == value else repr(value)
        given = given if unit == "1" else _text(f"{given} {unit}")
        found.setdefault(table, []).append(f"# {field} = {given} # {allowed}; {told}")
    order = sorted(found, key=lambda table: FIRST.index(table) if table in FIRST else len(FIRST))
    for table in order[:_TABLES]:
        yield [f"[{table}]", *found[table][:_VALUES], ""]


def _allowed(section: Any, key: str) -> str | None:
    """The range of a quantity, in words; None for what is no quantity."""
    *path, last = key.split(".")
    for name in path:
        section = section.get(name) if isinstance(section, dict) else getattr(section, name, None)
    if not isinstance(section, BaseModel) or last not in type(section).model_fields:
        return None
    info = type(section).model_fields[last]
    found = list(_metadata(info.annotation, info.metadata))
    if not any(isinstance(one, Unit) for one in found):
        return None
    return next((str(one) for one in found if isinstance(one, Range)), None)


def _metadata(annotation: Any, own: Any = ()) -> Iterator[Any]:
    """What an annotation says beside its type, also inside of a choice."""
    yield from own
    inside = get_args(annotation)
    if get_origin(annotation) is Annotated:
        yield from inside[1:]
        inside = inside[:1]
    for one in inside:
        yield from _metadata(one)


def _plain(text: str) -> str:
    """Text for a comment, on one line."""
    return "".join(letter if letter.isprintable() else "?" for letter in text)


def _text(text: str) -> str:
    """As TOML writes it."""
    return json.dumps(text, ensure_ascii=False)
