"""The section of a controller from a compiled file: keys that follow from what the file says of itself."""

from __future__ import annotations

import re
from collections.abc import Iterable, Iterator, Mapping, Sequence
from math import isfinite
from typing import Any, ClassVar, NamedTuple, Self

from annotated_types import Ge, Le
from pydantic import create_model

from rig.controllers.blocks.base import ControllerSection
from rig.errors import PartError
from rig.parts import Binary
from rig.quantities import Nanoseconds, Section, quantity
from rig.units import unit_fault

_KEY = re.compile(r"[A-Za-z][A-Za-z0-9_]{0,60}")

_MADE: dict[tuple[type, str], type[CompiledSection]] = {}


class Signal(NamedTuple):
    """An input or output of a compiled controller: name, unit [SI; "" if it states none].

    `direct`: inputs on which an output depends at the same instant; None: nothing is known of it.
    """

    name: str
    unit: str
    direct: tuple[str, ...] | None = None


class Parameter(NamedTuple):
    """A parameter of a compiled controller, in SI; it is a key of the scene."""

    key: str
    unit: str
    value: float
    low: float
    high: float
    fixed: bool = False


class CompiledSection(ControllerSection):
    """The keys of every controller from a compiled file; subclasses say how such a file is read.

    file      the library or FMU, from the folder of the scene; a recording contains it
    reads     sensors in the order of the inputs, by default those named like the inputs
    drives    actuators in the order of the outputs, by default those named like the outputs
    """

    fixed: ClassVar[frozenset[str]] = ControllerSection.fixed | {"file", "reads", "drives"}
    all_inputs: ClassVar[tuple[Signal, ...]] = ()
    all_outputs: ClassVar[tuple[Signal, ...]] = ()
    parameters: ClassVar[tuple[Parameter, ...]] = ()

    file: Binary
    reads: tuple[str, ...] = ()
    drives: tuple[str, ...] = ()

    @classmethod
    def describe(cls, file: Binary) -> dict[str, Any]:
        """What the file says of itself, as plain JSON values. Raises PartError if it cannot be used."""
        raise NotImplementedError

    @classmethod
    def keys(cls, file: Binary) -> tuple[Sequence[Signal], Sequence[Signal], Sequence[Parameter], int | None]:
        """Inputs, outputs, parameters and period [ns] (None: it states none) of a file from its `about`."""
        raise NotImplementedError

    @classmethod
    def of_table(cls, table: Mapping[str, Any]) -> type[Self]:
        """The section class for a table of a scene or of a recording. Raises PartError for a file that is no use."""
        given = table.get("file")
        if not isinstance(given, Mapping | str) or not given:
            raise PartError("is missing; expected the name of a compiled file")
        if isinstance(given, Mapping):
            given = Binary.from_json(given)
        file = given if isinstance(given, Binary) else Binary.read(given, cls.describe)
        return _with_keys(cls, file)  # type: ignore[return-value]

    @property
    def used_inputs(self) -> tuple[Signal, ...]:
        """The inputs that sensors are connected to, in the order of `reads`."""
        return self.all_inputs

    @property
    def used_outputs(self) -> tuple[Signal, ...]:
        """The outputs that drive actuators, in the order of `drives`."""
        return self.all_outputs

    @property
    def connected_sensors(self) -> tuple[str, ...]:
        """The sensors that it reads."""
        return self.reads or tuple(signal.name for signal in self.used_inputs)

    @property
    def connected_actuators(self) -> tuple[str, ...]:
        """The actuators that it drives."""
        return self.drives or tuple(signal.name for signal in self.used_outputs)

    def faults(self) -> list[str]:
        """What is wrong with the numbers of sensors and actuators, one line each."""
        faults = []
        for key, what, names, signals in (
            ("reads", "inputs", self.connected_sensors, self.used_inputs),
            ("drives", "outputs", self.connected_actuators, self.used_outputs),
        ):
            if len(names) != len(signals):
                listed = ", ".join(f"{s.name} [{s.unit}]" if s.unit else s.name for s in signals) or "none"
                faults.append(f"{key}: names {len(names)}, but {self.file} has {len(signals)} {what}: {listed}")
        return faults

    def notes(self) -> Iterator[str]:
        """What its user must know before a run, one line each."""
        yield from ()

    def values(self) -> tuple[float, ...]:
        """The values of its parameters [SI], in the order of the file."""
        return tuple([getattr(self, parameter.key) for parameter in self.parameters])


def checked(file: Binary, signals: Iterable[Signal], parameters: Iterable[Parameter]) -> None:
    """Raise PartError, with all faults, for units and names that no scene can have."""
    faults = [f"{s.name}: the unit {fault}" for s in signals if s.unit and (fault := unit_fault(s.unit))]
    seen: set[str] = set()
    for p in parameters:
        if fault := unit_fault(p.unit):
            faults.append(f"{p.key}: the unit {fault}")
        if not _KEY.fullmatch(p.key) or hasattr(Section, p.key) or p.key in CompiledSection.model_fields:
            rule = "it is letters, digits and _, and no key that every controller has"
            faults.append(f"{p.key!r:.80}: no parameter can have this name; {rule}")
        elif p.key in seen:
            faults.append(f"{p.key}: two parameters have this name")
        elif not (all(map(isfinite, (p.value, p.low, p.high))) and p.low <= p.value <= p.high):
            faults.append(f"{p.key}: its value {p.value:g} is not within {p.low:g} to {p.high:g}")
        seen.add(p.key)
    if faults:
        raise PartError("\n".join(f"{file}: {fault}" for fault in faults))


def _with_keys(cls: type[CompiledSection], file: Binary) -> type[CompiledSection]:
    """The class of the sections of this file, one for equal files."""
    which = cls, file.sha256
    if which not in _MADE:
        inputs, outputs, parameters, period = cls.keys(file)
        checked(file, (*inputs, *outputs), parameters)
        fields: dict[str, Any] = {"file": (Binary, file)}
        for p in parameters:
            fields[p.key] = quantity(p.unit, Ge(p.low), Le(p.high)), p.value
        if period is not None:
            fields["period"] = Nanoseconds, period
        made = create_model(cls.__name__, __base__=cls, __module__=cls.__module__, __doc__=cls.__doc__, **fields)
        made.all_inputs = tuple(inputs)
        made.all_outputs = tuple(outputs)
        made.parameters = tuple(parameters)
        made.fixed = cls.fixed | {p.key for p in parameters if p.fixed}
        _MADE[which] = made
    return _MADE[which]
