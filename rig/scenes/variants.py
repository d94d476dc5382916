"""A scene with one effect less or one more, for paired runs and the audit of a run.

The parameters of a plant declare which effects are optional (rig.about).
"""

from __future__ import annotations

import types
from collections.abc import Iterator, Sequence
from dataclasses import replace
from functools import cache
from typing import Any, NamedTuple, Union, get_args, get_origin

from pydantic import BaseModel, ValidationError

from rig.about import About, Bound
from rig.controllers import controller_drives
from rig.errors import RigError, SceneError
from rig.quantities import Section, faults_of
from rig.scenes import loader, protocol
from rig.scenes.faults import lookup
from rig.scenes.scene import Scene
from rig.scenes.shipped import names, plant, text_of

Keys = list[str]
SWITCHED = 0.5
"""Value of a switch from which on it is closed."""


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
    return {effect.name: effect.about for effect in optional(section)}


def switches(section: BaseModel) -> list[str]:
    """Inputs that switch the effects of a plant with these parameters on and off: `shunt.connected`."""
    return [
        f"{effect.key}.{effect.about.switch}" for effect in optional(section) if effect.given and effect.about.switch
    ]


@cache
def _fields(section: Any) -> dict[str, tuple[About | None, bool]]:
    """Of each field: what it declares, whether it may be left out."""
    fields = {}
    for name, info in section.model_fields.items():
        own = next((declaration for declaration in info.metadata if isinstance(declaration, About)), None)
        kinds = (kind.declares for kind in _sections(info.annotation))
        annotation = info.annotation
        absent = get_origin(annotation) in (Union, types.UnionType) and type(None) in get_args(annotation)
        fields[name] = own or next(kinds, None), absent
    return fields


def _sections(annotation: Any) -> Iterator[Any]:
    """Sections that a field may hold."""
    if isinstance(annotation, type) and hasattr(annotation, "declares"):
        yield annotation
    for part in get_args(annotation):
        yield from _sections(part)


def dropped(scene: Scene) -> dict[str, Keys]:
    """Effects that the scene names and its plant may be without -> the keys to take away."""
    return _named(scene, on=True)


def absent(scene: Scene) -> dict[str, Keys]:
    """Effects that its plant supports and the scene does not name -> their keys."""
    on = dropped(scene)
    return {name: keys for name, keys in _named(scene, on=False).items() if name not in on}


def _named(scene: Scene, on: bool) -> dict[str, Keys]:
    keys: dict[str, Keys] = {}
    for effect in optional(scene.parameters):
        if effect.given == on:
            keys.setdefault(effect.name, []).append(effect.key)
    return keys


def opened(scene: Scene) -> dict[str, str]:
    """Switches of its effects that are open at the start (`shunt.connected`) -> who closes them, in words."""
    inputs = scene.assemble().inputs
    keys = [key for key in switches(scene.parameters) if key in inputs and inputs[key].value < SWITCHED]
    return {key: _closes(scene, key) for key in keys}


def _closes(scene: Scene, key: str) -> str:
    who = [f"controller {name}" for name, section in scene.controllers.items() if key in controller_drives(section)]
    for step in protocol.flat(scene.protocol):
        if isinstance(step, protocol.Set) and step.target == key and step.to >= SWITCHED:
            who.insert(0, "the protocol")
            break
    return (
        f"is closed by {' and '.join(who)}" if who else f"nothing in the scene closes it (rig live tune {key}=1 does)"
    )


def without(scene: Scene, keys: Keys, at_its_states: bool = False) -> Scene:
    """The scene without some tables or values, and what reads them. Raises SceneError where the plant needs them.

    `at_its_states`: to be judged at the states of `scene`; raises SceneError where they would mean other motions too.
    """
    return _changed(scene, dict.fromkeys(keys), at_its_states)


def added(scene: Scene, keys: Keys, of_others: bool = False, at_its_states: bool = False) -> tuple[Scene, str]:
    """The scene with tables or values that it lacks, and where these are from.

    That is a shipped scene of the same plant, or "" for an effect that has no numbers of its own. `of_others`: or a
    scene of another plant; limits that no scene has are put at twice the value that they limit (""). Raises SceneError
    where there are none, or none that go with this scene. `at_its_states`: as for `without`.
    """
    fault = SceneError(scene.name, [f"no shipped scene {'' if of_others else 'of this plant '}has it"])
    for values, like in _offered(scene, keys, of_others):
        try:
            return _changed(scene, values, at_its_states), like
        except SceneError as error:
            fault = fault if like == "" else error
    raise fault


def _offered(scene: Scene, keys: Keys, of_others: bool) -> Iterator[tuple[dict[str, Any], str]]:
    """Values for `keys`, and the scene they are from."""
    yield {key: {} for key in keys}, ""
    words = [key.rpartition(".")[2] for key in keys]  # no other scene is read
    having = []
    for name in names():
        text = text_of(name)
        if any(word in text for word in words):
            having.append(name)
    plants = dict.fromkeys([scene.plant, *(map(plant, having) if of_others else ())])
    for name in (name for wanted in plants for name in having if plant(name) == wanted):
        other = _parameters(name)
        raw = other.model_dump()
        closing = switches(other)
        values = {}
        for key in keys:
            value = lookup(raw, key.split("."))
            if value is not None:
                values[key] = _at_work(key, value, closing)
        if values:
            yield values, name
    bounds = {effect.key: effect.about for effect in optional(scene.parameters) if isinstance(effect.about, Bound)}
    if of_others and bounds.keys() >= set(keys):
        raw = scene.parameters.model_dump()
        values = {}
        for key in keys:
            table = key.rpartition(".")[0]
            limited = lookup(raw, f"{table}.{bounds[key].of}".split(".")) or 0.0
            values[key] = bounds[key].sign * 2.0 * abs(limited)
        yield values, ""


_parameters = cache(loader.parameters)


def _changed(scene: Scene, values: dict[str, Any], at_its_states: bool) -> Scene:
    raw = scene.parameters.model_dump()
    for key, value in values.items():
        *path, last = key.split(".")
        lookup(raw, path)[last] = value
    try:
        parameters: Section = type(scene.parameters).model_validate(without_none(raw))
        if at_its_states and not parameters.comparable(scene.parameters):
            raise SceneError(scene.name, ["states of the same name would mean other motions"])
        changed = replace(scene, parameters=parameters)
        outputs = changed.assemble().outputs
    except ValidationError as error:
        wrong = [f"{key}: {fault}" if key else fault for key, fault, _ in faults_of(error)]
        raise SceneError(scene.name, wrong) from None
    except RigError as error:
        raise SceneError(scene.name, [" ".join(str(error).split())]) from None
    sensors = {name: section for name, section in scene.sensors.items() if section.reads in outputs}
    limits = {name: limit for name, limit in scene.limits.items() if name in outputs}
    return replace(changed, sensors=sensors, limits=limits)


def _at_work(key: str, value: Any, closing: Sequence[str]) -> Any:
    """The table of `key`, that its scene switches on later by one of `closing`, switched on."""
    off = []
    for dotted in closing:
        table, _, switch = dotted.rpartition(".")
        if table == key and value.get(switch) is False:
            off.append(switch)
    return {**value, **dict.fromkeys(off, True)} if off else value


def without_none(raw: dict[str, Any]) -> dict[str, Any]:
    """Tables without what is left out."""
    tables = {key: without_none(value) if isinstance(value, dict) else value for key, value in raw.items()}
    return {key: value for key, value in tables.items() if value is not None}
