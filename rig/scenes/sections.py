"""The sections of a scene: their values by dotted key, and what controllers read and drive.

Beside the sections a scene has texts, a seed and limits (`text`, `seed`, `limits`; faults are reported to its tables),
and the steps of a protocol, whose number and duration follow with repeats unrolled. `changes` adds controllers in
files that a user names.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Mapping
from functools import partial
from itertools import count
from pathlib import Path
from typing import Any

from annotated_types import Gt
from pydantic import BaseModel, ValidationError
from pydantic.fields import FieldInfo

from rig.about import SetPoint
from rig.controllers import controller_class, controller_reads, kind_of_file
from rig.controllers.blocks.base import gets_every_sample
from rig.errors import SceneError, UsageError
from rig.parts import is_file
from rig.quantities import Range, Section, Unit, finite
from rig.scenes import faults, merged, protocol

PARTS = ("sensors", "controllers")
"""The tables of a scene whose entries are parts with values of their own: sensors.NAME.KEY."""


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
                    yield f"{key}.{entry}", (plain[name][entry], faults.unit_of(info))
        elif value is not None and name in plain:  # not a flaw that an ideal instrument is free of
            yield key, (value if isinstance(value, str) else plain[name], faults.unit_of(info))  # of a file its name


def parted(key: str) -> tuple[str, str, str]:
    """Table, name and key of a value of a part, such as sensors.laser.noise; ("", "", key) for a value of the rig."""
    room, _, rest = key.partition(".")
    name, _, inner = rest.partition(".")
    return (room, name, inner) if room in PARTS and name else ("", "", key)


def with_values(section: Any, changes: Mapping[str, Any]) -> Any:
    """A copy of a section with changed values of dotted keys, validated. Raises SceneError with all faults."""
    raw = section.model_dump()
    for key, value in changes.items():
        *path, last = key.split(".")
        at = faults.lookup(raw, path)
        if not isinstance(at, dict) or last not in at:
            raise SceneError(key, ["is not a parameter of this rig"])
        at[last] = value
    try:
        return type(section).model_validate(raw)
    except ValidationError as error:
        raise SceneError(", ".join(changes), [line for _, line in faults.lines(error, type(section), raw)]) from None


def field_of(section: Any, key: str) -> FieldInfo | None:
    """The declaration of the value with this dotted key in a section; None if it has none."""
    *path, last = key.split(".")
    for name in path:
        section = section.get(name) if isinstance(section, dict) else getattr(section, name, None)
    return type(section).model_fields.get(last) if isinstance(section, BaseModel) else None


def is_set_point(section: Any, key: str) -> bool:
    """Whether the value with this dotted key is one that an operator sets: a speed, a load (rig.about.SetPoint)."""
    info = field_of(section, key)
    return info is not None and any(isinstance(entry, SetPoint) for entry in info.metadata)


def range_of(section: Any, key: str) -> Range | None:
    """The range of the quantity with this dotted key in a section; None if it is not a quantity."""
    info = field_of(section, key)
    declared = list(faults.metadata(info.annotation, info.metadata)) if info is not None else []
    if not any(isinstance(entry, Unit) for entry in declared):
        return None
    return next((entry for entry in declared if isinstance(entry, Range)), None)


def sensors_in_full(controllers: Mapping[str, Any]) -> set[str]:
    """Sensors of which at least one controller needs every sample."""
    hearing = [section for section in controllers.values() if gets_every_sample(controller_class(section))]
    return {sensor for section in hearing for sensor in controller_reads(section).values()}


def known(
    assembly: Any, parameters: Section, sensors: Mapping[str, Any], controllers: Mapping[str, Any]
) -> protocol.Known:
    """The names that a protocol of this rig may use."""
    settable = {k: unit for k, (v, unit) in values_of(parameters) if unit and not k.startswith("start.")}
    for name, section in controllers.items():
        fixed: frozenset[str] = getattr(section, "fixed", frozenset())
        values = values_of(section, f"controllers.{name}")
        settable |= {key: unit for key, (_, unit) in values if unit and key.rpartition(".")[2] not in fixed}
    return protocol.Known(
        inputs={name: i.unit for name, i in assembly.inputs.items()},
        settable=settable,
        sensors={name: s.unit for name, s in sensors.items()},
        controllers=frozenset(controllers),
    )


def text(tables: merged.Merged, key: str, default: str) -> str:
    """The title, or the description."""
    value = tables.raw.get(key, default)
    if isinstance(value, str):
        return value
    tables.report([(key, f"{key} = {faults.shown(value)}: expected a text")])
    return ""


def seed(tables: merged.Merged) -> int:
    """The seed of noise; 0 by default."""
    value = tables.raw.get("seed", 0)
    if isinstance(value, int) and not isinstance(value, bool) and value >= 0:
        return value
    tables.report([("seed", f"seed = {faults.shown(value)}: expected a whole number, at least 0")])
    return 0


def limits(tables: merged.Merged, assembly: Any) -> dict[str, float]:
    """The limits of outputs beyond which a run goes to its safe state: name -> largest absolute value [SI]."""
    raw = tables.raw.get("limits", {})
    if not isinstance(raw, dict):
        tables.report([("limits", f"limits = {faults.shown(raw)}: expected a table of outputs")])
        return {}
    if assembly is None:
        return {}

    def limit(key: str, name: str, given: Any) -> float:
        if name not in assembly.outputs:
            raise merged.Wrong((key, f"{key}: this rig has no such output; {faults.near(name, assembly.outputs)}"))
        try:
            return finite(given, assembly.outputs[name].unit, Gt(0.0))
        except ValueError as error:
            line = f"{key} = {faults.shown(given)}: {faults.reworded(str(error), given)}"
            raise merged.Wrong((key, line)) from None

    return {name: tables.read(partial(limit, f"limits.{name}", name, given), 0.0) for name, given in raw.items()}


def unrolled(steps: Iterable[Any]) -> Iterator[Any]:
    """The steps in order, with repeats unrolled; endless if a step repeats for ever."""
    for step in steps:
        if isinstance(step, protocol.Repeat):
            for _ in count() if step.times == "forever" else range(step.times):
                yield from unrolled(step.steps)
        else:
            yield step


def number(steps: Iterable[Any]) -> int | None:
    """Number of steps with repeats unrolled; None if they never end."""
    return _total(steps, lambda _: 1)


def least_ns(steps: Iterable[Any]) -> int | None:
    """Least duration of the steps [ns], waits without any time; None if they never end."""
    return _total(steps, protocol.duration_ns)


def longest_ns(steps: Iterable[Any]) -> int | None:
    """Longest duration of the steps [ns], waits with their timeout; None if they never end."""
    return _total(steps, partial(protocol.duration_ns, waits=True))


def _total(steps: Iterable[Any], of: Callable[[Any], int]) -> int | None:
    """The sum of `of` over the steps with repeats unrolled; None if they never end."""
    total = 0
    for step in steps:
        if not isinstance(step, protocol.Repeat):
            total += of(step)
            continue
        inner = _total(step.steps, of)
        if inner is None or step.times == "forever":
            return None
        total += inner * step.times
    return total


def changes(files: Mapping[str, str | Path]) -> dict[str, object]:
    """The changes (dotted key -> value) that add controllers to a scene; `files`: name -> file.

    A Python file is a kind of its own; the suffix of any other file selects the kind that reads it. A controller of the
    scene with the same name is replaced. Raises UsageError for a file that is not there or that no kind reads.
    """
    added: dict[str, object] = {}
    for name, file in files.items():
        if not Path(file).is_file():
            raise UsageError(f"controller {name}: there is no file {file}")
        if is_file(str(file)):
            added[f"controllers.{name}.kind"] = str(file)
        else:
            added |= {f"controllers.{name}.kind": kind_of_file(Path(file)), f"controllers.{name}.file": str(file)}
    return added
