"""The parts of a scene for a reader: effects, on or absent, with their states; values with their origins."""

from __future__ import annotations

import inspect
import re
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from functools import cache
from typing import Any

from pydantic import BaseModel

from rig.about import Bound
from rig.model.assembly import add_film_states
from rig.parts import Binary, code_of
from rig.quantities import ORIGINS
from rig.scenes import part_faults, places, sections
from rig.scenes.scene import Scene
from rig.scenes.variants import about, optional
from rig.structure.stated import Stated

DEFAULT = places.Origin("default")
UNSTATED = places.Origin("not stated")
_ROW = 5  # largest number of numbered states that are listed one by one
_NUMBER = re.compile(r"\d+")

_SINGLE = 8  # contacts that are listed one by one

ENTRY = re.compile(r"(?P<names>[a-z_0-9]+(?:, [a-z_0-9]+)*)  +(?P<text>\S.*)")
TAG = re.compile(rf"\[({'|'.join(ORIGINS)})\b")


@dataclass(frozen=True)
class Effect:
    """One physical effect of a rig. An absent one has no states, no rows and no branch in the kernel."""

    name: str
    on: bool
    states: tuple[str, ...]
    about: str

    @property
    def states_text(self) -> str:
        """Its states; of a long row of numbered ones the first and the last."""
        rows: list[list[str]] = []
        for state in self.states:
            if rows and _successor(rows[-1][-1]) == state:
                rows[-1].append(state)
            else:
                rows.append([state])
        return ", ".join(f"{row[0]} .. {row[-1]}" if len(row) > _ROW else ", ".join(row) for row in rows)


def _successor(name: str) -> str:
    """The name with its first number increased by one."""
    return _NUMBER.sub(lambda number: str(int(number[0]) + 1), name, count=1)


@dataclass(frozen=True)
class Value:
    """One value of a scene in SI, with its origin, and where it is given; no place for a default."""

    key: str
    value: Any
    unit: str
    origin: places.Origin
    place: places.Place | None = None


@dataclass(frozen=True)
class Actuator:
    """One actuator: the range that it can be commanded in, its value at the start, and the one it has if left alone."""

    name: str
    unit: str
    low: float
    high: float
    start: float
    safe: float


@dataclass(frozen=True)
class Explanation:
    """A scene taken apart. `stated`: mass and contacts of a meshed structure."""

    scene: Scene
    effects: tuple[Effect, ...]
    actuators: tuple[Actuator, ...]
    values: tuple[Value, ...]
    stated: Stated | None = None

    @property
    def states(self) -> int:
        """States of the rig, the constant one not counted."""
        return sum(len(effect.states) for effect in self.effects)


def explain(scene: Scene) -> Explanation:
    """Take a scene apart."""
    inputs = scene.assemble().inputs
    actuators = [Actuator(name, i.unit, i.low, i.high, i.value, i.safe) for name, i in inputs.items()]
    values = [_placed(scene, value) for value in _values(scene)]
    return Explanation(scene, tuple(_effects(scene)), tuple(actuators), tuple(values), scene.stated)


def _placed(scene: Scene, value: Value) -> Value:
    """A value with its place. One that a file gives without an origin does not have that of the default."""
    place = scene.place(value.key)
    origin = UNSTATED if place and value.key not in scene.origins else value.origin
    return replace(value, place=place, origin=origin)


def _effects(scene: Scene) -> Iterator[Effect]:
    assembly = scene.assemble()
    if assembly.film is not None:
        add_film_states(assembly, assembly.film)
    names = [name for name in assembly.names if name != "one"]
    owned: dict[str, list[str]] = {}
    for name in names:
        owned.setdefault(assembly.owners.get(name, "structure"), []).append(name)
    yield Effect("structure", True, tuple(owned.pop("structure", ())), "mass, damping, stiffness")
    patches = [name for name, *_ in assembly.patches]
    contacts = getattr(scene.parameters, "contacts", {})
    for patch in patches if len(patches) <= _SINGLE else [*contacts] or [f"{len(patches)} points"]:
        contact = contacts.get(patch, contacts.get(patch.rpartition("_")[0]))
        law = getattr(contact, "friction", None) or getattr(scene.parameters, "friction", None)
        code = code_of(type(law))
        source = f" (SHA-256 {code.short}...)" if code is not None else ""
        motion = "stick and slip" if getattr(law, "sticks", True) else "it deflects before it slips, without true stick"
        text = f"law {getattr(law, 'law', '')}{source}; {motion}"
        name = f"friction at {patch}"
        yield Effect(name, True, (), text + assembly.about.get(name, ""))
    opening = [name for name, *_, opens in assembly.normals if opens]
    for where in opening if len(opening) <= _SINGLE else [f"{len(opening)} points"]:
        yield Effect(f"lift-off at {where}", True, (), "a contact opens where its normal force becomes zero")
    for name, _, low, high, *_ in assembly.limiters:
        yield Effect(f"{name} limits", True, (), f"clamped to {low:g} .. {high:g} {_unit(assembly, name)}")
    for owner, states in owned.items():
        text = assembly.about.get(owner) or about(scene.parameters, owner)
        yield Effect(owner, True, tuple(states), text)
    clamps = {f"{name} limits" for name, *_ in assembly.limiters}
    lacking = {}
    for effect in optional(scene.parameters):
        if isinstance(effect.about, Bound):
            if effect.name not in clamps:
                lacking[effect.name] = effect.about.text
        elif effect.name not in owned:
            yield Effect(effect.name, effect.given, (), effect.about.text)
    for name, text in sorted(lacking.items()):
        yield Effect(name, False, (), text)


def _unit(assembly: Any, table: str) -> str:
    return next((str(i.unit) for name, i in assembly.inputs.items() if name.startswith(f"{table}.")), "")


def _values(scene: Scene) -> Iterator[Value]:
    assembly = scene.assemble()
    names = sections.known(assembly, scene.parameters, scene.sensors, scene.controllers)
    rates = {
        f"faults.{name}.rate": part_faults.per_second(names.sensors.get(fault.part, ""))
        for name, fault in scene.faults.items()
    }
    heights = {f"faults.{name}.height": names.sensors.get(fault.part, "") for name, fault in scene.faults.items()}
    for prefix, section in scene.sections():
        for key, (value, unit) in sections.values_of(section, prefix):
            name = key.rpartition(".")[2]
            entries = {f"{key}[{i}]": entry for i, entry in enumerate(value if isinstance(value, list) else (), 1)}
            if entries.keys() & scene.origins.keys():
                yield from (Value(of, entry, unit, scene.origins.get(of, UNSTATED)) for of, entry in entries.items())
            elif name not in ("law", "kind", "effect", "on", "ideal", "enable"):
                origin = scene.origins.get(key) or (_documented(type(section), name) if prefix else None)
                if origin is not None or isinstance(value, Binary) or not isinstance(value, str):
                    yield Value(key, value, unit or rates.get(key, heights.get(key, "")), origin or DEFAULT)
    units = {**names.settable, **names.inputs, **names.sensors}
    for key, step in _steps(scene.protocol, "protocol"):
        named = units.get(getattr(step, "target", getattr(step, "sensor", "")), "")
        for inner, (value, unit) in sections.values_of(step, key):
            if inner in scene.origins:
                yield Value(inner, value, unit or named, scene.origins[inner])
    for name, limit in scene.limits.items():
        unit = assembly.outputs[name].unit
        yield Value(f"limits.{name}", limit, unit, scene.origins.get(f"limits.{name}", DEFAULT))
    yield Value("seed", scene.seed, "", scene.origins.get("seed", DEFAULT))


def _steps(steps: Sequence[Any], prefix: str) -> Iterator[tuple[str, Any]]:
    """(key, step) of a protocol, steps inside of repetitions too."""
    for i, step in enumerate(steps, 1):
        yield f"{prefix}[{i}]", step
        yield from _steps(getattr(step, "steps", ()), f"{prefix}[{i}].steps")


@cache
def _documented(section: type[BaseModel], field: str) -> places.Origin | None:
    """Origin of a default, from the docstring that describes it: the last tag, e.g. `[public: source]`.

    Where a value rests on a source and on a choice, the choice stands last.
    """
    for text in descriptions(section, field):
        tags = TAG.findall(text)
        if tags:
            return places.Origin(tags[-1], text)
    return None


def descriptions(section: type[BaseModel], field: str) -> Iterator[str]:
    """The line `field   text` of the docstring of each class that the section derives from, the first class first."""
    for owner in reversed(section.__mro__):
        lines = inspect.cleandoc(owner.__doc__ or "").splitlines()  # from Python 3.13 on it comes without indentation
        for i, line in enumerate(lines):
            entry = ENTRY.match(line)
            if entry is None or field not in entry["names"].replace(",", " ").split():
                continue
            text = entry["text"]
            for more in lines[i + 1 :]:
                if not more.startswith(" " * 4) or ENTRY.match(more):
                    break
                text += f" {more.strip()}"
            yield " ".join(text.split())
