"""The text of a new scene file: the scene that it is based on, and its most important values as comments."""

from __future__ import annotations

import json
import shlex
from collections.abc import Iterator

from rig.scenes import explain, scene, sections
from rig.scenes.source import FORMAT

FIRST = ("drive", "load", "friction")
"""Tables that come first, because experiments vary them."""
# A longer list is not read.
_TABLES = 5
_VALUES = 5
_HEAD = """\
# A scene based on {base}. It has all values of {base}, except those that this file changes. Next steps:
#   rig explain {file}            every value with its origin, and the file and line it comes from
#   rig simulate {file}           as fast as possible
#   rig run {file} --view         paced by the clock, live in rerun
# To change a value, remove the # of its line. You may state its origin and a note: ["0.1 m/s", "chosen", "why"].
# KEY = "none" removes a value, an effect, a sensor or a controller; [[protocol]] replaces the whole protocol.

format = {format}
based_on = {name}
title = {title}
# about = "What differs from the base, and what one sees."
"""


def draft(base: scene.Scene, based_on: str, file: str) -> str:
    """The text of a scene file called `file`; `based_on`: the value of this key for its base, `base`."""
    name = _text(based_on)
    title = _text(f"{base.title}, changed")
    head = _HEAD.format(base=_plain(based_on), file=shlex.quote(_plain(file)), format=FORMAT, name=name, title=title)
    return "\n".join([head, *(line for table in _tables(base) for line in table)])


def _tables(base: scene.Scene) -> Iterator[list[str]]:
    """The lines of each table."""
    tables: dict[str, list[str]] = {}
    values = base.values()
    inputs = base.assemble().inputs
    for key in dict.fromkeys((*base.origins, *filter(base.place, values))):
        origin = base.origins.get(key, explain.UNSTATED)
        table, _, field = key.rpartition(".")
        value, unit = values.get(key, (None, ""))
        within = sections.range_of(base.parameters, key)
        allowed = None if within is None else str(within)
        if allowed is None or isinstance(value, bool) or not isinstance(value, int | float):
            continue  # of no parameter of the plant, a choice, or a list
        if key in inputs:
            low, high = f"{inputs[key].low:g}", f"{inputs[key].high:g}"
            allowed = f"{low} to {high}" + ("" if unit == "1" else f" {unit}")
        source = _plain(f"{origin.origin}: {origin.note}" if origin.note else origin.origin)
        given = f"{value:g}" if float(f"{value:g}") == value else repr(value)
        given = given if unit == "1" else _text(f"{given} {unit}")
        tables.setdefault(table, []).append(f"# {field} = {given} # {allowed}; {source}")
    place = {"": -1, **{table: i for i, table in enumerate(FIRST)}}  # what is in no table stands above all tables
    order = sorted(tables, key=lambda table: place.get(table, len(FIRST)))
    for table in order[:_TABLES]:
        head = [f"[{table}]"] if table else []
        yield [*head, *tables[table][:_VALUES], ""]


def _plain(text: str) -> str:
    """A text on one line, for a comment."""
    return "".join(letter if letter.isprintable() else "?" for letter in text)


def _text(text: str) -> str:
    """The value in TOML."""
    return json.dumps(text, ensure_ascii=False).replace("\x7f", "\\u007f")
