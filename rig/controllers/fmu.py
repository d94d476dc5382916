"""A controller from another tool: an FMU for co-simulation, FMI 2.0 or 3.0.

At each update the inputs are set, a step of one period is done, and the outputs are the commands. Inputs and outputs
are real scalars; others keep their start values. Parameters of the FMU are keys of the scene, in SI. An FMU keeps its
state itself. If it can return and take back its state, an update can be tried, and parameters can be tuned while it
runs. An FMU that cannot is not repeatable: what it answers may depend on what it was asked before.
"""

from __future__ import annotations

import re
from collections.abc import Iterable, Iterator, Sequence
from typing import Any, ClassVar, Literal, NamedTuple

from rig.controllers.blocks.base import Numbers, Values
from rig.controllers.blocks.compiled import CompiledSection, Parameter, Signal
from rig.controllers.runtime import fmi
from rig.controllers.runtime.fmi import Unit
from rig.errors import ControllerLost, PartError, UsageError
from rig.parts import Binary


class Fmu(CompiledSection):
    """Parameters: those of the FMU that are real scalars.

    inputs    names of the inputs that are connected to `reads`, in that order; by default all real ones
    outputs   names of the outputs that are connected to `drives`, in that order; by default all real ones
    """

    fixed: ClassVar[frozenset[str]] = CompiledSection.fixed | {"inputs", "outputs"}
    files: ClassVar[tuple[str, ...]] = (".fmu",)

    kind: Literal["fmu"]
    inputs: tuple[str, ...] = ()
    outputs: tuple[str, ...] = ()

    @classmethod
    def describe(cls, file: Binary) -> dict[str, Any]:
        """See `CompiledSection.describe`."""
        try:
            return fmi.described(file)
        except PartError as fault:
            raise PartError(f"{file}: {fault}") from None
        except UsageError as fault:  # fmpy is missing
            raise PartError(str(fault)) from None

    @classmethod
    def keys(cls, file: Binary) -> tuple[Sequence[Signal], Sequence[Signal], Sequence[Parameter], int | None]:
        """See `CompiledSection.keys`."""
        about = file.about
        inputs = [Signal(row["name"], row["unit"]) for row in about["inputs"]]
        names = tuple(signal.name for signal in inputs)
        outputs = [
            Signal(o["name"], o["unit"], names if o["direct"] is None else (*o["direct"],)) for o in about["outputs"]
        ]
        parameters = [
            Parameter(
                _key(p["name"]), p["unit"], p["value"], p["low"], p["high"], not (p["tunable"] and about["repeatable"])
            )
            for p in about["parameters"]
        ]
        return inputs, outputs, parameters, None

    @property
    def used_inputs(self) -> tuple[Signal, ...]:
        """See `CompiledSection.used_inputs`."""
        return _chosen(self.all_inputs, self.inputs)

    @property
    def used_outputs(self) -> tuple[Signal, ...]:
        """See `CompiledSection.used_outputs`."""
        return _chosen(self.all_outputs, self.outputs)

    def faults(self) -> list[str]:
        """See `CompiledSection.faults`."""
        faults = []
        for key, signals in (("inputs", self.all_inputs), ("outputs", self.all_outputs)):
            known = [signal.name for signal in signals]
            faults += [f"{key}: {self.file} has no real {key[:-1]} {name:.80}; it has {', '.join(known) or 'none'}"
                       for name in getattr(self, key) if name not in known]  # fmt: skip
        faults = faults or super().faults()
        step, period = self.file.about["step"], self.period * 1e-9
        if step is not None and (step <= 0.0 or abs(period / step - round(period / step)) > 1e-9 or period < step):
            faults.append(f"period: {period:g} s is not a multiple of {step:g} s, the fixed step of {self.file}")
        return faults

    def notes(self) -> Iterator[str]:
        """What its user must know before a run."""
        if not self.file.about["repeatable"]:
            yield (
                f"{self.file} cannot return and take back its state (canGetAndSetFMUstate), so it is not repeatable, "
                "and its parameters are fixed while it runs; rig verify plays the recorded commands and needs no FMU"
            )


def _key(name: str) -> str:
    """The name of a variable as a key of a scene: controller.gain[1] is controller_gain_1."""
    return re.sub(r"\W+", "_", name).strip("_")


def _chosen(signals: tuple[Signal, ...], names: tuple[str, ...]) -> tuple[Signal, ...]:
    known = {signal.name: signal for signal in signals}
    return tuple(known[name] for name in names if name in known) if names else signals


class Moment(NamedTuple):
    """The state of an FMU: its instance, the number of steps that it has done, and the time of the next one [ns]."""

    unit: Any
    steps: int
    next_ns: int


class _Instance(Unit):
    """An instance with the number of steps that it has done, and the state that was kept last."""

    def __init__(self, *arguments: Any) -> None:
        super().__init__(*arguments)
        self.owner: FmuController | None = None
        self.steps = 0
        self._kept: tuple[int, Any] | None = None

    def turn_to(self, owner: FmuController, steps: int) -> None:
        """Continue from `steps` with the parameters of `owner`. Raises ControllerLost if it cannot return there."""
        if steps != self.steps:
            if self._kept is None or self._kept[0] != steps:
                raise ControllerLost(f"{owner.section.file} cannot return to an earlier state")
            self.back(self._kept[1])
            self.steps = steps
        if self.owner is not None and owner.section.file.about["repeatable"]:
            if self._kept is None or self._kept[0] != steps:
                if self._kept is not None:
                    self.drop(self._kept[1])
                self._kept = steps, self.keep()
            self.assign(*owner.tunable)
        self.owner = owner


class FmuController:
    """The controller."""

    def __init__(self, section: Fmu, numbers: Numbers) -> None:
        if faults := section.faults():
            raise UsageError("; ".join(faults))
        self.section, self.numbers = section, numbers
        self.reads, self.drives = section.connected_sensors, section.connected_actuators
        self.period_ns = section.period
        self._h = section.period * 1e-9
        about = section.file.about
        self._inputs = _rows(about["inputs"], section.used_inputs)
        self._outputs = _rows(about["outputs"], section.used_outputs)
        self._scaled = any((row["factor"], row["offset"]) != (1.0, 0.0) for row in (*self._inputs, *self._outputs))
        self._values = [_to_fmu(row, value) for row, value in zip(about["parameters"], section.values())]
        pairs = [(p["vr"], value) for p, value in zip(about["parameters"], self._values) if p["tunable"]]
        self.tunable = [vr for vr, _ in pairs], [value for _, value in pairs]
        self._unit: Unit | None = None

    def start(self) -> Moment:
        """A new instance, which is initialised at the time of its first step."""
        rows = (self._inputs, self._outputs, self.section.file.about["parameters"])
        self._unit = unit = _Instance(
            self.section.file, *([row["vr"] for row in signals] for signals in rows), self._values
        )
        return Moment(unit, 0, -1)

    def update(self, state: Moment, t_ns: int, values: Values) -> tuple[Moment, Values]:
        """The next state, and the outputs after a step of one period [unit of each actuator].

        Steps that were left out, because a measurement was missing, are done first with the inputs of the last one.
        """
        unit, steps, next_ns = state
        if unit.owner is not self or unit.steps != steps:
            unit.turn_to(self, steps)
            self._unit = unit
        if next_ns < 0:
            unit.begin(t_ns * 1e-9)
            next_ns = t_ns
        while next_ns < t_ns:
            unit.step(next_ns * 1e-9, self._h, None)
            next_ns += self.period_ns
        given: Sequence[float] = list(map(_to_fmu, self._inputs, values)) if self._scaled else values
        answer = unit.step(t_ns * 1e-9, self._h, given)
        commands = tuple(map(_from_fmu, self._outputs, answer) if self._scaled else answer)
        unit.steps = steps + 1
        return Moment(unit, steps + 1, next_ns + self.period_ns), commands

    def take_messages(self) -> list[str]:
        """Warnings and errors in the log of the FMU since the last call."""
        return [] if self._unit is None else self._unit.take_messages()


def _rows(variables: Iterable[dict[str, Any]], signals: Iterable[Signal]) -> list[dict[str, Any]]:
    by_name = {row["name"]: row for row in variables}
    return [by_name[signal.name] for signal in signals]


def _to_fmu(row: dict[str, Any], value: float) -> float:
    return float((value - row["offset"]) / row["factor"])


def _from_fmu(row: dict[str, Any], value: float) -> float:
    return float(value * row["factor"] + row["offset"])
