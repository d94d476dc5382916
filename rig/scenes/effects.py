"""The optional effects of a plant, as its parameters declare them (rig.about)."""

from __future__ import annotations

import types
from collections.abc import Iterator
from functools import cache
from typing import Any, NamedTuple, Union, get_args, get_origin

from pydantic import BaseModel

from rig.about import About, Bound


class Choice(NamedTuple):
    """A table or a value that a scene may leave out.

    `name`: the effect, `dither`, `drive lag`; the bounds of a table are one, `drive limits`. `key`: of the scene.
    `given`: the scene names it.
    """

    name: str
    key: str
    given: bool
    about: About


def optional(section: BaseModel) -> Iterator[Choice]:
    """What a plant with these parameters may be with or without."""
    for name, (entry, absent) in _fields(type(section)).items():
        value = getattr(section, name)
        if absent:
            yield Choice(name, name, value is not None, entry or About())
        elif isinstance(value, BaseModel):
            for inner, (entry, absent) in _fields(type(value)).items():
                if absent and entry is not None:
                    what = "limits" if isinstance(entry, Bound) else inner
                    given = getattr(value, inner) is not None
                    yield Choice(f"{name} {what}", f"{name}.{inner}", given, entry)


def about(section: BaseModel, effect: str) -> str:
    """The description of an effect, `dither` or `drive lag`, of a plant with these parameters; "" where it has none."""
    table, _, inner = effect.partition(" ")
    holder: Any = getattr(section, table, None) if inner else section
    if holder is None or (inner or table) not in type(holder).model_fields:
        return ""
    kind: Any = type(holder)
    entry, _ = _fields(kind)[inner or table]
    return entry.text if entry else ""


def declared(section: BaseModel) -> dict[str, About]:
    """What each effect that a plant with these parameters may be with or without declares."""
    return {one.name: one.about for one in optional(section)}


def switches(section: BaseModel) -> list[str]:
    """Inputs that switch the effects of a plant with these parameters on and off: `shunt.connected`."""
    return [f"{one.key}.{one.about.switch}" for one in optional(section) if one.given and one.about.switch]


@cache
def _fields(section: Any) -> dict[str, tuple[About | None, bool]]:
    """Of each field: what it declares, whether it may be left out."""
    found = {}
    for name, info in section.model_fields.items():
        own = next((one for one in info.metadata if isinstance(one, About)), None)
        kinds = (kind.declares for kind in _sections(info.annotation))
        found[name] = own or next(kinds, None), _may_be_none(info.annotation)
    return found


def _sections(annotation: Any) -> Iterator[Any]:
    """Sections that a field may hold."""
    if isinstance(annotation, type) and hasattr(annotation, "declares"):
        yield annotation
    for part in get_args(annotation):
        yield from _sections(part)


def _may_be_none(annotation: Any) -> bool:
    return get_origin(annotation) in (Union, types.UnionType) and type(None) in get_args(annotation)
