"""The parts that a scene names: from names and files to sections, and from these to the assembled rig and to JSON."""

from __future__ import annotations

import os
import sys
from collections.abc import Iterable, Iterator, Mapping
from pathlib import Path
from types import ModuleType
from typing import Any

from pydantic import BaseModel

from rig import controllers, sensors
from rig.effects import EFFECTS, extended, on_any_plant
from rig.effects.noise import Noise
from rig.errors import PartError
from rig.laws import LAW, LAWS, FrictionLaw, with_laws
from rig.model import row_checks
from rig.model.assembly import Assembly, Output
from rig.parts import Parts, Room, calling, carried, code_of, file_of, is_file, require
from rig.plants import PLANTS
from rig.quantities import Section

CONTROLLERS = controllers.KINDS
SENSORS = sensors.KINDS
ROOMS: dict[str, Room[Any]] = {room.what: room for room in (PLANTS, EFFECTS, LAWS, SENSORS, CONTROLLERS)}
FILE = "file"
"""Key of a controller or sensor that names a file it is made of."""
EFFECT = "effect"
"""Key of a table that names an effect the plant does not know."""


def effects_in(tables: Mapping[str, Any], model: type[Section]) -> dict[str, Any]:
    """Tables of a scene that name an effect which its plant, with parameters `model`, does not know -> its name."""
    strange = {key: table for key, table in tables.items() if key not in model.model_fields}
    return {key: table[EFFECT] for key, table in strange.items() if isinstance(table, Mapping) and EFFECT in table}


def with_effects(model: type[Section], effects: Mapping[str, type[Section]]) -> type[Section]:
    """The parameters of a plant with the effects of a scene; every plant may have process noise."""
    return extended(model, {"noise": Noise, **effects})


def name_of(text: str) -> str:
    """The name of a part as a scene names it: of a file its base name."""
    return Path(text).name if is_file(text) else text


def anchor(tables: dict[str, Any], folder: Path) -> None:
    """Turn the files that `tables` of a scene name, relative to `folder`, into absolute ones: parts and "./data"."""
    named = [(tables, "plant")]
    for key, table in tables.items():
        if isinstance(table, dict):
            named.append((table, EFFECT))
            for section in table.values() if key in (SENSORS.what, CONTROLLERS.what) else ():
                if isinstance(section, dict):
                    named += [(section, "kind"), (section, FILE)]
    for table, key in named:
        text = table.get(key)
        if isinstance(text, str) and (is_file(text) or key == FILE):
            table[key] = os.path.abspath(folder / text)
    steps = tables.get("protocol")
    for step in _tables(steps):
        if step.get("step") == "follow" and isinstance(step.get(FILE), str):
            step[FILE] = os.path.abspath(folder / step[FILE])
    tables |= {key: _anchored(table, folder) for key, table in tables.items() if isinstance(table, dict)}


def _tables(steps: Any) -> Iterator[dict[str, Any]]:
    """The tables of the steps of a protocol, of those inside of repetitions too."""
    for step in steps if isinstance(steps, list) else ():
        if isinstance(step, dict):
            yield step
            yield from _tables(step.get("steps"))


def _anchored(value: Any, folder: Path) -> Any:
    if isinstance(value, dict):
        law = value.get(LAW)
        if isinstance(law, str) and is_file(law):
            value = value | {LAW: os.path.abspath(folder / law)}
        return {key: inner if key in ("kind", EFFECT) else _anchored(inner, folder) for key, inner in value.items()}
    if isinstance(value, list):
        return [_anchored(inner, folder) for inner in value]
    relative = isinstance(value, str) and value.startswith(("./", "../"))
    return os.path.abspath(folder / value) if relative else value


def laws_in(tables: Mapping[str, Any], prefix: str = "") -> Iterator[tuple[str, str]]:
    """(dotted key, name) of each friction law from elsewhere that the tables of a scene name."""
    for key, value in tables.items():
        here = f"{prefix}{key}"
        if isinstance(value, Mapping):
            yield from laws_in(value, f"{here}.")
        elif prefix and key == LAW and isinstance(value, str) and value not in LAWS.shipped:
            if value in LAWS:
                yield here, value


def parameters_of(plant: str, tables: Mapping[str, Any], parts: Parts) -> type[Section]:
    """The model of a recorded scene's parameters: those of its plant, its effects and its friction laws."""
    model = PLANTS.get_from(plant, parts).Parameters
    effects = effects_in(tables, model).items()
    model = with_effects(model, {key: EFFECTS.get_from(name, parts) for key, name in effects})
    return with_laws(model, {name: LAWS.get_from(name, parts) for what, name in parts if what == LAWS.what})


def plant_of(parameters: Section) -> ModuleType:
    """The module of the plant whose parameters these are."""
    return sys.modules[type(parameters).__module__]


def assembled(
    parameters: Section,
    frame_ns: int,
    moved: Mapping[str, str] | None = None,
    random: bool = True,
    limits: Mapping[str, float] | None = None,
) -> Assembly:
    """The plant with these parameters, and the effects that act on any plant.

    `moved`: see `Scene.moved`; None: what the plant assumes. `random`: with the effects that are random. `limits`:
    of outputs, as a scene states them.
    Raises PartError for a foreign plant or effect that fails or does not describe a rig.
    """
    plant = plant_of(parameters)
    with calling(plant):
        made = plant.assemble(parameters) if moved is None else plant.assemble(parameters, moved)
    if not isinstance(made, Assembly):
        fault = f"assemble gives {type(made).__name__}; expected a rig.model.assembly.Assembly"
        raise PartError(f"{file_of(plant)}: {fault}")
    made.add_memory()
    _sound(plant, made, {})
    for section, add in on_any_plant(parameters):
        if random or not section.declares.random:
            effect = sys.modules[type(section).__module__]
            before = dict(made.outputs)
            with calling(effect):
                add(made, section, frame_ns * 1e-9, moved or {})
            _sound(effect, made, before)
    made.bounds = limits or {}
    return made


def _sound(part: ModuleType, made: Assembly, outputs: Mapping[str, Output]) -> None:
    """Raise PartError for a rig that a foreign part describes wrongly. `outputs`: those that were there before."""
    if code_of(part) is None:
        return
    lines = [f"the rig has an output {name!r} already" for name in outputs if made.outputs.get(name) != outputs[name]]
    if lines := [*lines, *row_checks.faults(made)]:
        raise PartError(f"{file_of(part)}: {'; '.join(lines)}")


def foreign(
    plant: str, parameters: Section, sensors: Iterable[Any], controllers: Iterable[Any]
) -> list[dict[str, str]]:
    """The foreign parts of a scene as JSON values: kind of part, name, file, hash, source."""
    rows = [(PLANTS.what, plant, parameters)]
    rows += [(EFFECTS.what, getattr(section, EFFECT, ""), section) for section, _ in on_any_plant(parameters)]
    rows += [(LAWS.what, law.law, law) for law in _laws(parameters)]
    rows += [(SENSORS.what, section.kind, section) for section in sensors]
    rows += [(CONTROLLERS.what, section.kind, section) for section in controllers]
    codes = {(what, name): code for what, name, section in rows if (code := code_of(type(section))) is not None}
    return [{"part": what, "name": name, **code.to_json()} for (what, name), code in codes.items()]


def _laws(value: Any) -> Iterator[Any]:
    """The friction laws among the values of a section."""
    if isinstance(value, FrictionLaw):
        yield value
    elif isinstance(value, BaseModel):
        for name in type(value).model_fields:
            yield from _laws(getattr(value, name))
    elif isinstance(value, Mapping | tuple | list):
        for inner in value.values() if isinstance(value, Mapping) else value:
            yield from _laws(inner)


def foreign_parts(raw: Mapping[str, Any]) -> Parts:
    """The foreign parts in the JSON of a scene.

    Raises Untrusted, with all their names, if some of them may not be run, PartError if they are damaged.
    """
    parts = carried(raw.get("parts", []))
    require(code for (what, name), code in parts.items() if not (what in ROOMS and ROOMS[what].trusted(name, code)))
    return parts
