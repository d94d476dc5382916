"""Reference of the keys of a scene, generated from the sections that plants, effects and other parts declare."""

import inspect
import types
from collections.abc import Iterable, Iterator
from importlib import import_module
from typing import Annotated, Any, Literal, Union, get_args, get_origin

from annotated_types import Ge, Gt, Le, Lt
from generated import code, directive, plain, table
from pydantic import BaseModel
from pydantic.fields import FieldInfo
from sphinx.application import Sphinx

from rig import effects, laws
from rig.about import About
from rig.controllers import KINDS as CONTROLLERS
from rig.effects.noise import Noise
from rig.laws import LAWS, FrictionLaw
from rig.plants import PLANTS
from rig.quantities import Range, Unit
from rig.scenes import protocol
from rig.scenes.explain import ENTRY, TAG, descriptions
from rig.scenes.faults import metadata
from rig.sensors import KINDS as SENSORS

HEADS = ("key", "unit", "range or choices", "default", "meaning")
TAGS = ("law", "kind", "on", "step", "direction", "effect")
"""Keys whose value says which section a table is."""


def _inside(annotation: Any) -> Iterator[Any]:
    """The single types of an annotation: of a union its members, without None."""
    origin = get_origin(annotation)
    if origin is Annotated:
        yield from _inside(get_args(annotation)[0])
    elif origin in (Union, types.UnionType):
        for one in get_args(annotation):
            yield from _inside(one)
    elif annotation is not type(None):
        yield annotation


def sections_of(annotation: Any) -> list[type[BaseModel]]:
    """The sections that a table with this annotation can be."""
    found = [one for one in _inside(annotation) if isinstance(one, type) and issubclass(one, BaseModel)]
    return [LAWS[name] for name in LAWS.shipped] if FrictionLaw in found else found


def _allowed(info: FieldInfo) -> tuple[str, str]:
    """Unit of a value, and its range or its choices, as text."""
    found = list(metadata(info.annotation, info.metadata))
    unit = next((str(one) for one in found if isinstance(one, Unit)), "")
    within = next((one for one in found if isinstance(one, Range)), None)
    if within is not None:
        above = "above " if any(isinstance(one, Gt) and one.gt for one in found) else ""
        below = "below " if any(isinstance(one, Lt) for one in found) else ""
        return unit, f"{above}{within.low:g} to {below}{within.high:g}"
    kinds = list(_inside(info.annotation))
    if unit == "s" and kinds == [int]:  # a duration, which is counted in nanoseconds
        least, most = (1e-9 * bound for bound in _bounds(found))
        return unit, f"{least:g} to {most:g}"
    choices = [str(choice) for one in kinds if get_origin(one) is Literal for choice in get_args(one)]
    words = [f'"{one}"' for one in choices]
    if bool in kinds:
        words += ["true", "false"]
    if int in kinds and not unit:
        bounds = [one for one in found if isinstance(one, Gt | Ge | Lt | Le)]
        low, high = _bounds(bounds)
        words.append(f"whole number, {low:g} to {high:g}" if bounds else "whole number")
    if str in kinds:
        words.append("text")
    if float in kinds:
        words.append("number")
    words += [_many(one) for one in kinds if get_origin(one) in (tuple, list)]
    return unit, " or ".join(words)


def _bounds(found: Iterable[Any]) -> tuple[float, float]:
    low = high = None
    for one in found:
        match one:
            case Gt(gt=bound) | Ge(ge=bound):
                low = bound + isinstance(one, Gt)
            case Lt(lt=bound) | Le(le=bound):
                high = bound - isinstance(one, Lt)
    return float("-inf") if low is None else low, float("inf") if high is None else high


def _many(kind: Any) -> str:
    """A list in words, with the unit and the range of its members."""
    within = next((one for one in metadata(kind) if isinstance(one, Range)), None)
    return f"list, each {within}" if within else "list"


def _default(info: FieldInfo) -> str:
    if info.is_required():
        return "required"
    value = info.get_default(call_default_factory=True)
    if value is None:
        return "absent"
    if isinstance(value, BaseModel):
        return "as below"
    unit, _ = _allowed(info)
    if unit == "s" and int in _inside(info.annotation):
        return code(f"{value * 1e-9:g}")
    if isinstance(value, bool):
        return code(str(value).lower())
    if isinstance(value, int | float):
        return code(f"{value:g}" if float(f"{value:g}") == value else repr(value))
    return code(f'"{value}"' if isinstance(value, str) else str(value))


def _meaning(section: type[BaseModel], name: str, info: FieldInfo) -> str:
    found = [*descriptions(section, name)]
    declared = [one.text for one in info.metadata if isinstance(one, About) and one.text]
    return plain((found or declared or [""])[-1])


def rows(section: type[BaseModel], prefix: str = "", told: tuple[str, ...] = ()) -> Iterator[tuple[str, ...]]:
    """A row for each key of a section and of the sections in it that have no section of this reference of their own.

    `told`: keys that are left out, because the text beside the table states them.
    """
    for name, info in section.model_fields.items():
        if name in told:
            continue
        key, meaning = f"{prefix}{name}", _meaning(section, name, info)
        kinds, entries = sections_of(info.annotation), _entries(info.annotation)
        if kinds and any(_shared(one) for one in kinds):
            links = ", ".join(f"[{_title(one)}](#{_label(one)})" for one in kinds)
            yield code(key), "", f"table: {links}", _default(info), meaning
        elif kinds:
            for one in kinds:
                chosen, tags = _choice(one) if len(kinds) > 1 else ("", ())
                yield f"`[{key}]`{chosen}", "", "table", _default(info), meaning or _first(one)
                yield from rows(one, f"{key}.", tags)
        elif entries:
            for one in entries:
                chosen, tags = _choice(one) if len(entries) > 1 else ("", ())
                yield f"`[{key}.NAME]`{chosen}", "", "one table for each name", _default(info), _first(one)
                yield from rows(one, f"{key}.NAME.", tags)
        else:
            unit, allowed = _allowed(info)
            yield code(key), code(unit), plain(allowed), _default(info), meaning


def _entries(annotation: Any) -> list[type[BaseModel]]:
    """The sections that the entries of a table of tables can be."""
    return [found for one in _inside(annotation) if get_origin(one) is dict for found in sections_of(get_args(one)[1])]


def _choice(section: type[BaseModel]) -> tuple[str, tuple[str, ...]]:
    """The key and value that choose this section of several, as text: ` with law = "coulomb"`; and this key."""
    for tag in TAGS:
        info = section.model_fields.get(tag)
        if info is not None and get_origin(info.annotation) is Literal:
            values = " or ".join(f'"{one}"' for one in get_args(info.annotation))
            return f" with `{tag} = {values}`", (tag,)
    return "", ()


def _shared(section: type[BaseModel]) -> bool:
    """Whether a section is one of an effect or a friction law, which several plants use."""
    return section.__module__.startswith((effects.__name__, laws.__name__))


def _label(section: type[BaseModel]) -> str:
    return f"scene-{section.__module__.rpartition('.')[2]}-{section.__name__}".lower().replace("_", "-")


def _title(section: type[BaseModel]) -> str:
    effect = section.__module__.rpartition(".")[2].replace("_", " ")
    if issubclass(section, FrictionLaw):
        return f"friction: {effect}"
    choice = next(
        (get_args(section.model_fields[tag].annotation)[0] for tag in TAGS if tag in section.model_fields), ""
    )
    if choice:
        return f"{effect}: {choice}"
    words = "".join(f" {letter.lower()}" if letter.isupper() else letter for letter in section.__name__).strip()
    return effect if words == effect else f"{effect}: {words}"


def _first(thing: Any) -> str:
    """First paragraph of a docstring."""
    return plain(inspect.cleandoc(thing.__doc__ or "").partition("\n\n")[0])


def prose(thing: Any) -> Iterator[str]:
    """The paragraphs of a docstring, formulas as code; without its rows `key   text`, which the table of keys has."""
    for paragraph in inspect.cleandoc(thing.__doc__ or "").split("\n\n"):
        lines = paragraph.splitlines()
        if ENTRY.match(lines[0] if lines else "") and TAG.search(paragraph):
            continue
        if all(line.startswith("    ") for line in lines):
            yield from ("```text", inspect.cleandoc(f"\n{paragraph}"), "```", "")
        else:
            kept = [line for line in lines if not (ENTRY.match(line) and isinstance(thing, type))]
            text, _, source = " ".join(kept).partition("Source: ")
            yield from (plain(text), "")
            yield from (plain(f"Source: {source}"), "") if source else ()


def section(where: str) -> Iterable[str]:
    """The keys of one section, `module:Class`."""
    module, _, name = where.partition(":")
    return table(HEADS, rows(getattr(import_module(module), name)))


def plants() -> Iterator[str]:
    """Every plant with its tables."""
    for name in PLANTS:
        module = PLANTS[name]
        yield from (f"## {name}", "", f'`plant = "{name}"`', "", *prose(module))
        yield from table(HEADS, rows(module.Parameters))


def shared() -> Iterator[str]:
    """Every table of an effect that a plant can have."""
    found: dict[type[BaseModel], set[str]] = {Noise: set(PLANTS)}
    for name in PLANTS:
        for info in PLANTS[name].Parameters.model_fields.values():
            for one in sections_of(info.annotation):
                if _shared(one):
                    found.setdefault(one, set()).add(name)
    modules = sorted({one.__module__ for one in found})
    for module in modules:
        tables = [one for one in found if one.__module__ == module]
        law = issubclass(tables[0], FrictionLaw)
        head = _title(tables[0]) if law else module.rpartition(".")[2].replace("_", " ")
        alone = [_title(one) for one in tables] == [head]
        yield from (f"({_label(tables[0])})=",) if alone else ()
        yield from (f"## {head}", "", *prose(import_module(module)))
        for one in tables:
            yield from () if alone else (f"({_label(one)})=", f"### {_title(one)}", "")
            yield from prose(one)
            yield from (f"In the plants {', '.join(code(plant) for plant in sorted(found[one]))}.", "")
            yield from table(HEADS, rows(one))


def instruments() -> Iterator[str]:
    """Every instrument."""
    for kind in SENSORS:
        one = SENSORS[kind]
        units = "" if one.given else f" Reads {code(one.accepts)}, delivers {code(one.delivers)}."
        yield from (f"## {kind}", "", f'`kind = "{kind}"`.{units}', "", *prose(one))
        yield from table(HEADS, rows(one, told=("kind",)))


def controllers() -> Iterator[str]:
    """Every controller."""
    for kind in CONTROLLERS:
        module = import_module(CONTROLLERS[kind].__module__)
        yield from (f"## {kind}", "", f'`kind = "{kind}"`', "", *prose(module))
        yield from table(HEADS, rows(CONTROLLERS[kind], told=("kind",)))


def steps() -> Iterator[str]:
    """Every step of a protocol."""
    for one in sections_of(protocol.Step):
        (name,) = get_args(one.model_fields["step"].annotation)
        yield from (f"### {name}", "", *prose(one), *table(HEADS, rows(one, told=("step",))))


def setup(app: Sphinx) -> dict[str, bool]:
    """Register the directives of this module."""
    directive(app, "scene-section", section, arguments=1)
    directive(app, "scene-plants", plants)
    directive(app, "scene-effects", shared)
    directive(app, "scene-instruments", instruments)
    directive(app, "scene-controllers", controllers)
    directive(app, "scene-steps", steps)
    return {"parallel_read_safe": True, "parallel_write_safe": True}
