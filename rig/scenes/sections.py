"""The sections of a scene: their values by dotted key, and what controllers read and drive."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import Annotated, Any, get_args, get_origin

from pydantic import BaseModel
from pydantic.fields import FieldInfo

from rig.controllers import controller_class, controller_reads
from rig.controllers.blocks.base import gets_every_sample
from rig.quantities import Range, Section, Unit
from rig.scenes.faults import unit_of
from rig.scenes.protocol import Known


def dump(section: Section) -> dict[str, Any]:
    """A section as plain JSON values in SI units."""
    return section.model_dump(mode="json", exclude_none=True)


def values_of(section: BaseModel, prefix: str = "") -> Iterator[tuple[str, tuple[Any, str]]]:
    """(dotted key, (value, unit)) of a section and the sections in it."""
    plain = section.model_dump(mode="json", exclude_none=True)
    for name, info in type(section).model_fields.items():
        value = getattr(section, name)
        key = f"{prefix}.{name}" if prefix else name
        if isinstance(value, BaseModel):
            yield from values_of(value, key)
        elif isinstance(value, dict):
            for entry, part in value.items():
                if isinstance(part, BaseModel):
                    yield from values_of(part, f"{key}.{entry}")
                else:
                    yield f"{key}.{entry}", (plain[name][entry], unit_of(info))
        elif value is not None and name in plain:  # not a flaw that an ideal instrument is free of
            yield key, (value if isinstance(value, str) else plain[name], unit_of(info))  # of a file its name


def field_of(section: Any, key: str) -> FieldInfo | None:
    """The declaration of the value with this dotted key in a section; None if it has none."""
    *path, last = key.split(".")
    for name in path:
        section = section.get(name) if isinstance(section, dict) else getattr(section, name, None)
    return type(section).model_fields.get(last) if isinstance(section, BaseModel) else None


def range_of(section: Any, key: str) -> Range | None:
    """The range of the quantity with this dotted key in a section; None if it is not a quantity."""
    info = field_of(section, key)
    found = list(metadata(info.annotation, info.metadata)) if info is not None else []
    if not any(isinstance(one, Unit) for one in found):
        return None
    return next((one for one in found if isinstance(one, Range)), None)


def metadata(annotation: Any, own: Any = ()) -> Iterator[Any]:
    """The metadata of an annotation, also inside of a union. `own`: what the field itself has."""
    yield from own
    inside = get_args(annotation)
    if get_origin(annotation) is Annotated:
        yield from inside[1:]
        inside = inside[:1]
    for one in inside:
        yield from metadata(one)


def sensors_in_full(controllers: Mapping[str, Any]) -> set[str]:
    """Sensors of which at least one controller needs every sample."""
    hearing = [section for section in controllers.values() if gets_every_sample(controller_class(section))]
    return {sensor for section in hearing for sensor in controller_reads(section).values()}


def known(assembly: Any, parameters: Section, sensors: Mapping[str, Any], controllers: Mapping[str, Any]) -> Known:
    """The names that a protocol of this rig may use."""
    settable = {k: unit for k, (v, unit) in values_of(parameters) if unit and not k.startswith("start.")}
    for name, section in controllers.items():
        fixed: frozenset[str] = getattr(section, "fixed", frozenset())
        values = values_of(section, f"controllers.{name}")
        settable |= {key: unit for key, (_, unit) in values if unit and key.rpartition(".")[2] not in fixed}
    return Known(
        inputs={name: i.unit for name, i in assembly.inputs.items()},
        settable=settable,
        sensors={name: s.unit for name, s in sensors.items()},
        controllers=frozenset(controllers),
    )
