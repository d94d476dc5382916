"""Messages for the faults that pydantic finds in a scene: key, what was given, what is allowed.

load.force = "-3 N": must be at least 0 N
drive.sped: unknown key; did you mean drive.speed?
friction.law = "strbeck": unknown; did you mean stribeck? known: coulomb, exponential, falling, stribeck, table
"""

from __future__ import annotations

import json
import types
from collections.abc import Iterable, Iterator, Mapping, Sequence
from difflib import SequenceMatcher
from inspect import get_annotations
from typing import Annotated, Any, Literal, Union, get_args, get_origin

from pydantic import BaseModel, ValidationError
from pydantic.fields import FieldInfo

from rig.quantities import BOUNDS, Unit, details_of, in_words
from rig.units import brief

TAGS = ("law", "kind", "on", "step", "direction")
_MANY = 24  # names: a longer list is not read
_LONG = 100  # characters: no name has as many, and comparing them is slow
Loc = tuple[int | str, ...]


def lines(error: ValidationError, model: Any, raw: Any, prefix: str = "") -> Iterator[tuple[str, str]]:
    """(dotted key, line) for every fault in `error`, found when `raw` was read as `model`."""
    for fault in details_of(error):
        kind = fault["type"]
        context = fault.get("ctx", {})
        path, owner, annotation, unit = _walk(model, fault["loc"], raw)
        key = dotted(path, prefix)
        given = lookup(raw, path)
        if kind == "extra_forbidden":
            yield key, unknown_key(key, keys(owner))
        elif kind == "missing":
            yield key, f"{key}: is missing{_expected(annotation, unit)}"
        elif kind == "union_tag_invalid":
            tag = context["discriminator"].strip("'")
            yield key, unknown_choice(dotted((*path, tag), prefix), context["tag"], members(annotation, tag))
        elif kind == "union_tag_not_found":
            tag = context["discriminator"].strip("'")
            if isinstance(given, Mapping):
                yield key, f"{dotted((*path, tag), prefix)}: is missing; known: {', '.join(members(annotation, tag))}"
            else:
                yield key, f"{_given(key, given)}: expected a table with {tag} = ..."
        elif kind == "literal_error" and path and path[-1] in TAGS:
            yield key, unknown_choice(key, given, [str(c) for c in get_args(annotation)])
        else:
            text = _reason(kind, context, fault["msg"], given, unit)
            yield key, f"{_given(key, given)}: {text}" if key else text  # no key: it is of the scene as a whole


def _reason(kind: str, context: Mapping[str, Any], message: str, given: Any, unit: str) -> str:
    """What is wrong with a value, in words."""
    suffix = "" if unit in ("", "1") else f" {unit}"
    if kind in BOUNDS:
        words, name = BOUNDS[kind]
        bound = context[name]
        if unit == "s" and isinstance(given, int | float | str) and isinstance(bound, int):
            return f"must be {words} {bound / 1e9:g}{suffix}"  # a duration, counted in nanoseconds
        return f"must be {words} {bound:g}{suffix}"
    if kind == "literal_error":
        return f"unknown; known: {context['expected']}".replace("'", "").replace(" or ", ", ")
    return reworded(in_words(kind, message), given)


def reworded(message: str, given: Any) -> str:
    """The fault of a value as text, for a line that already contains the value."""
    text = message.removeprefix(f"is {brief(given)}").lstrip(";").strip()
    return text[:1].lower() + text[1:]


def unknown_key(key: str, known: Iterable[str]) -> str:
    """The line for an unknown key."""
    parent, _, last = key.rpartition(".")
    names = sorted(known)
    likely = close(last, names)
    key = shortened(key)
    full = [f"{parent}.{name}" if parent else name for name in (likely or names)]
    if likely:
        return f"{key}: unknown key; did you mean {' or '.join(full)}?"
    return f"{key}: unknown key; known: {', '.join(full)}"


def unknown_choice(key: str, given: Any, known: Iterable[str]) -> str:
    """The line for an unknown choice."""
    names = sorted(known)
    likely = close(str(given), names)
    hint = f"did you mean {likely[0]}? " if likely else ""
    return f"{_given(key, given)}: unknown; {hint}known: {', '.join(names)}"


def near(what: str, known: Iterable[str], lists: str = "rig explain SCENE --all") -> str:
    """The end of a message: the near names, or all of them, or the command that `lists` them."""
    names = sorted(known)
    likely = close(what, names)
    if likely:
        return f"did you mean {' or '.join(likely)}?"
    if len(names) > _MANY:
        return f"none of the {len(names)} known names is like it; {lists} lists them"
    return f"known: {', '.join(names)}" if names else "there is none in this scene"


def close(what: str, names: Iterable[str]) -> list[str]:
    """The names that are like `what`, the most similar first, without those much less similar than the first."""
    if len(what) > _LONG:
        return []
    score = {name: SequenceMatcher(None, what, name).ratio() for name in names}
    best = max(score.values(), default=0.0)
    return sorted((n for n in score if score[n] >= max(0.6, best - 0.15)), key=lambda n: -score[n])[:3]


def _given(key: str, given: Any) -> str:
    return key if given is None or isinstance(given, Mapping) else f"{key} = {shown(given)}"


def shown(value: Any) -> str:
    """A value as a scene file contains it, shortened if it is long."""
    return shortened(json.dumps(value, ensure_ascii=False, default=str))


def shortened(text: str) -> str:
    """A text of at most 60 characters."""
    return text if len(text) <= 60 else f"{text[:57]}..."


def _expected(annotation: Any, unit: str) -> str:
    models = list(_models(annotation))
    if len(models) == 1:
        return f"; expected a table with {', '.join(_required(models[0]))}"
    if models:
        return "; expected a table"
    if unit:
        return "; expected a number" if unit == "1" else f"; expected a value in {unit}"
    choices = [str(c) for c in get_args(annotation)] if get_origin(annotation) is Literal else []
    return f"; known: {', '.join(choices)}" if choices else ""


def _required(model: type[BaseModel]) -> list[str]:
    return [name for name, f in model.model_fields.items() if f.is_required()] or list(model.model_fields)


def dotted(path: Iterable[int | str], prefix: str = "") -> str:
    """A key as the user writes it: tables by dots, list entries counted from one."""
    out = prefix
    for part in path:
        if isinstance(part, int):
            out += f"[{part + 1}]"
        else:
            out += f".{part}" if out else part
    return out


def inner(annotation: Any, path: Iterable[str]) -> Any:
    """The annotation at a dotted path of a section; None if it does not exist."""
    for part in path:
        if get_origin(annotation) is dict:
            annotation = get_args(annotation)[1]
            continue
        holder = next((model for model in _models(annotation) if part in model.model_fields), None)
        annotation = None if holder is None else holder.model_fields[part].annotation
    return annotation


def shared(first: type[BaseModel], second: type[BaseModel]) -> set[str]:
    """Fields that mean the same in two sections: inherited from a common base, or declared with the same title."""
    fields = first.model_fields
    other = second.model_fields
    alike = {
        name for name in fields.keys() & other.keys() if fields[name].title and fields[name].title == other[name].title
    }
    bases = [base for base in first.__mro__ if base in second.__mro__ and issubclass(base, BaseModel)]
    common = {name for base in bases for name in base.model_fields}
    own = [name for model in (first, second) for name in _declared(model, bases)]
    return common.difference(own) | alike


def _declared(model: type[BaseModel], bases: Sequence[type]) -> Iterator[str]:
    for owner in model.__mro__:
        if owner not in bases:
            yield from get_annotations(owner)


def keys(model: Any) -> list[str]:
    """The names of the fields of a section, or of all sections of a union."""
    return sorted({name for member in _models(model) for name in member.model_fields})


def members(annotation: Any, tag: str) -> Mapping[str, type[BaseModel]]:
    """Tag value -> section, for a discriminated union, and for a friction law."""
    from rig.laws import LAW, LAWS, FrictionLaw  # loads numba, which a recorder does not need

    if tag == LAW and FrictionLaw in _models(annotation):
        return LAWS
    sections: dict[str, type[BaseModel]] = {}
    for model in _models(annotation):
        if tag in model.model_fields:
            sections.update({str(c): model for c in get_args(model.model_fields[tag].annotation)})
    return sections


def _models(annotation: Any) -> Iterator[type[BaseModel]]:
    """Every section that an annotation admits."""
    origin = get_origin(annotation)
    if isinstance(annotation, type) and origin is None:
        if issubclass(annotation, BaseModel):
            yield annotation
    elif origin is Annotated:
        yield from _models(get_args(annotation)[0])
    elif origin in (Union, types.UnionType):
        for member in get_args(annotation):
            yield from _models(member)


def _walk(model: Any, loc: Loc, raw: Any) -> tuple[Loc, Any, Any, str]:
    """Follow pydantic's location: path as the user wrote it, section that holds the key, its annotation and unit."""
    from rig.laws import FrictionLaw, class_of, laws_of

    path: list[int | str] = []
    owner = model
    annotation = model
    unit = ""
    for part in loc:
        if FrictionLaw in _models(annotation):
            table = lookup(raw, tuple(path))
            if isinstance(table, Mapping):
                annotation = class_of(table, laws_of(model)) or annotation
        origin = get_origin(annotation)
        if origin in (tuple, list, Sequence) and isinstance(part, int):
            annotation = get_args(annotation)[0]
            unit = _unit(annotation) or unit
            path.append(part)
            continue
        if origin is dict and not isinstance(part, int):
            annotation = get_args(annotation)[1]
            unit = _unit(annotation)
            path.append(part)
            continue
        candidates = list(_models(annotation))
        tagged = next((c for tag in TAGS for name, c in members(annotation, tag).items() if name == part), None)
        if tagged is not None and (len(candidates) > 1 or part not in tagged.model_fields):
            annotation = tagged
            continue
        holder = next((c for c in candidates if part in c.model_fields), None)
        if holder is None:
            owner = annotation
            if candidates or not path:  # an unknown key; anything else is an inner part of a value
                path.append(part)
            annotation = Any
            continue
        if not holder.__pydantic_complete__:  # its fields name sections that are defined after it
            holder.model_rebuild()
        owner = holder
        info = holder.model_fields[str(part)]
        annotation = info.annotation
        unit = unit_of(info)
        path.append(part)
    return tuple(path), owner, annotation, unit


def unit_of(info: FieldInfo) -> str:
    """The SI unit of a field, also of an optional one; "" if it has none."""
    return _unit(info.annotation, info.metadata)


def _unit(annotation: Any, own: Iterable[Any] = ()) -> str:
    return next((str(entry) for entry in metadata(annotation, own, lists=False) if isinstance(entry, Unit)), "")


def metadata(annotation: Any, own: Iterable[Any] = (), lists: bool = True) -> Iterator[Any]:
    """The metadata of an annotation, also inside of a union or a dict. `own`: what the field itself has; `lists`: with
    those of the entries of lists.
    """
    yield from own
    origin = get_origin(annotation)
    inside = get_args(annotation)
    if origin is Annotated:
        yield from metadata(inside[0], inside[1:], lists)
    elif lists or origin in (Union, types.UnionType, dict):
        for member in inside:
            yield from metadata(member, (), lists)


def lookup(raw: Any, path: Iterable[int | str]) -> Any:
    """The value in tables and lists at `path`; None if there is none."""
    for part in path:
        if isinstance(raw, Mapping) and part in raw:
            raw = raw[part]
        elif isinstance(raw, list | tuple) and isinstance(part, int) and 0 <= part < len(raw):
            raw = raw[part]
        else:
            return None
    return raw
