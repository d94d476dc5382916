"""Physical effects, one per file. An effect that the scene does not name adds no state, no row and no branch.

drive      speed of the belt or disc; its lag and its limits
load       the normal force; lag and limits of the magnet that holds it
sector     a part of the disc with its own friction law
inhomogeneity  a structure whose stiffness varies with the angle of the disc
tuned_mass a tilted absorber on the body; its inertia enters the normal force
dither     a fast vibration of the belt, of the mass or of the normal force
separation  a contact spring that lifts off and meets the surface again
disc_modes  the vibration modes of a free flexible disc, and a contact that moves over it
piezo      a linear piezo stack in the load path; an amplifier that commands its voltage
shunt      the electrical network on it: resonant, with negative capacitance, switched
noise      a random force along the sliding direction
knock      the force of a hammer: a half sine

Each file declares its parameters (a `Section`, with units) and adds its rows to a `rig.model.assembly.Assembly`.

An effect that acts on any plant has a section derived from `Effect` and a function

    add(assembly, section, frame, moved)

`frame`: loop period [s]; `moved`: actuators that the scene moves -> "held" or "ramped". The plant does not have to
know the effect: the scene has a table of any name, such as `[wobble]`, with `effect = "NAME"`, and `EFFECTS` finds it.
"""

from __future__ import annotations

import sys
from collections.abc import Iterator, Mapping
from dataclasses import replace
from types import ModuleType
from typing import Any

from pydantic import BaseModel, create_model

from rig.about import About
from rig.errors import PartError
from rig.parts import Room, code_of, file_of, named, one_class
from rig.quantities import Section
from rig.units import brief

_EXTENDED: dict[tuple[Any, ...], type[Section]] = {}


class Effect(Section):
    """The table of an effect that acts on any plant."""


def _section(module: ModuleType, name: str) -> type[Effect]:
    """The section of an effect that acts on any plant, with the key `effect`."""
    foreign = code_of(module) is not None
    what = "class derived from rig.effects.Effect" if foreign else ""
    own = one_class(module, lambda kind: issubclass(kind, Effect), "Parameters", what)
    if own is None:
        raise PartError(
            f"{name} does not act on any plant; plants that have this effect have a table of their own for it"
        )
    if not callable(getattr(module, "add", None)):
        raise PartError(f"{file_of(module)}: defines no function add(assembly, section, frame, moved)")
    declares = own.declares
    if not isinstance(declares, About):
        raise PartError(f"{file_of(module)}: declares is {brief(declares)}; expected a rig.about.About")
    for key in ("random", "switch"):
        value = getattr(declares, key)
        if value and value not in own.model_fields:
            raise PartError(
                f"{file_of(module)}: {key} = {brief(value)} in declares; expected one of its values: "
                f"{', '.join(own.model_fields)}"
            )
    section: type[Effect] = named(module, (own,), "effect", name)
    if not section.declares.text:
        section.declares = replace(section.declares, text=(own.__doc__ or "").strip().partition("\n")[0].rstrip("."))
    return section


EFFECTS: Room[type[Effect]] = Room("effects", __name__, __path__, _section)
"""Sections of effects that act on any plant, by name. Raises PartError for one that only some plants have."""


def extended(model: type[Section], tables: Mapping[str, type[Section]]) -> type[Section]:
    """The section class of a plant with additional optional tables; tables that the plant declares itself stay."""
    new = {name: table for name, table in tables.items() if name not in model.model_fields}
    if not new:
        return model
    which = model, tuple(new.items())
    if which not in _EXTENDED:
        fields: dict[str, Any] = {name: (table | None, None) for name, table in new.items()}
        made = create_model(
            model.__name__, __base__=model, __module__=model.__module__, __doc__=model.__doc__, **fields
        )
        _EXTENDED[which] = made
    return _EXTENDED[which]


def on_any_plant(parameters: BaseModel) -> Iterator[tuple[Effect, Any]]:
    """Yield the effects in a plant's parameters that act on any plant, each with its function `add`."""
    for name in type(parameters).model_fields:
        section = getattr(parameters, name)
        if isinstance(section, Effect):
            yield section, sys.modules[type(section).__module__].add
