"""Faults of sensors and actuators at stated times, in the section [faults.NAME] of a scene.

    [faults.frozen]
    sensor = "vibrometer"
    kind = "freeze"
    at = "5 s"
    duration = "1 s"          without it the fault lasts to the end

    freeze      the sensor repeats its last sample
    drift       its zero drifts away with `rate`, from zero on
    spike       it reads `height` more: one sample, or all within `duration`
    dropout     it reads zero, as with a broken cable
    wrong_sign  it reads minus the value
    jam         the actuator keeps its value for any command
    authority   the actuator reaches `factor` times the command, within its range

Only one fault acts on a sensor or an actuator at a time. Times are whole numbers of frames. A sample is faulty from
time `at` on; an actuator is faulty from the frame that begins at `at` on.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Mapping
from itertools import combinations
from typing import Annotated, Any, Literal

from annotated_types import Ge, Le
from pydantic import BeforeValidator, ConfigDict, Field, TypeAdapter, ValidationError

from rig.quantities import Nanoseconds, Section, quantity
from rig.scenes import merged, protocol, source
from rig.scenes.checks import whole_frames
from rig.scenes.faults import lines, lookup, near, shown
from rig.sensors.stream import Stream

Factor: Any = quantity("1", Ge(0.0), Le(1.0))


class _Timed(Section):
    """What all faults have: the time at which they begin, and how long they last (None: to the end)."""

    at: protocol.Length
    duration: Nanoseconds | None = None

    @property
    def part(self) -> str:
        """The sensor or actuator that it acts on."""
        return str(getattr(self, "sensor", "") or getattr(self, "actuator", ""))

    @property
    def end(self) -> int | None:
        """The time from which on it does not act any more [ns]; None: it acts to the end."""
        return None if self.duration is None else self.at + self.duration


def per_second(unit: str) -> str:
    """The unit of a rate of a quantity."""
    if unit in ("", "1"):
        return "1/s"
    return f"{unit}^2" if unit.endswith("/s") else f"{unit}/s"


class _OfSensor(_Timed):
    sensor: str


def _in_unit(of: Callable[[str], str]) -> BeforeValidator:
    """Reads a value in the unit `of` that of the sensor."""
    return BeforeValidator(lambda value, info: protocol.read_in_unit_of(value, "sensor", info, of, "sensors"))


class Failure(_OfSensor):
    """The sensor repeats its last sample, reads zero, or minus the value."""

    kind: Literal["freeze", "dropout", "wrong_sign"]


class Drift(_OfSensor):
    """The zero of the sensor drifts with `rate`, in the unit of the measurement per second."""

    kind: Literal["drift"]
    rate: Annotated[float, _in_unit(per_second)]


class Spike(_OfSensor):
    """The sensor reads `height` more, in its unit: one sample, or all within `duration`."""

    kind: Literal["spike"]
    height: Annotated[float, _in_unit(str)]


class _OfActuator(_Timed):
    actuator: str


class Jam(_OfActuator):
    """The actuator stays where it is."""

    kind: Literal["jam"]


class Authority(_OfActuator):
    """The actuator reaches `factor` times the command."""

    kind: Literal["authority"]
    factor: Factor


SensorFault = Failure | Drift | Spike
ActuatorFault = Jam | Authority
PartFault = Annotated[SensorFault | ActuatorFault, Field(discriminator="kind")]
PART_FAULTS: TypeAdapter[dict[str, PartFault]] = TypeAdapter(dict[str, PartFault], config=ConfigDict(defer_build=True))


def faults_of(tables: merged.Merged, names: protocol.Known) -> dict[str, PartFault]:
    """The faults of sensors and actuators by name; those that are right if others are not."""
    raw = tables.raw.get("faults", {})
    faults: dict[str, PartFault] = {}
    if not isinstance(raw, dict):
        tables.report([("faults", f"faults = {shown(raw)}: expected tables [faults.NAME]")])
        return {}
    for name, table in raw.items():
        try:
            faults |= PART_FAULTS.validate_python({name: table}, context=names)
        except ValidationError as error:
            tables.report(lines(error, dict[str, PartFault], {name: table}, "faults"))
    return faults


def described(fault: Any, unit: str) -> str:
    """A fault in words, without its times. `unit`: of the sensor or actuator."""
    unit = "" if unit == "1" else f" {unit}"
    if isinstance(fault, Drift):
        return f"{fault.sensor} drifts with {fault.rate:g} {per_second(unit.strip())}"
    if isinstance(fault, Spike):
        return f"{fault.sensor} reads {abs(fault.height):g}{unit} too {'much' if fault.height >= 0.0 else 'little'}"
    if isinstance(fault, Authority):
        return f"{fault.actuator} reaches only {fault.factor:g} of its command"
    words = {"freeze": "is frozen", "dropout": "drops out", "wrong_sign": "has the wrong sign", "jam": "jams"}
    return f"{fault.part} {words[fault.kind]}"


def checks(
    part_faults: Mapping[str, Any],
    sensors: Mapping[str, Any],
    inputs: Mapping[str, Any],
    plant: str,
    frame_ns: int,
    raw: Any,
) -> Iterator[source.Fault]:
    """(dotted key, line) for unknown parts, times between frames, actuators without a state, contradictions.

    `inputs`: the actuators of the rig with the states that faulty ones need. `raw`: the table as it was given.
    """
    for name, fault in part_faults.items():
        key = f"faults.{name}"
        if isinstance(fault, SensorFault):
            if fault.sensor not in sensors:
                line = f"{key}.sensor = {shown(fault.sensor)}: unknown sensor; {near(fault.sensor, sensors)}"
                yield f"{key}.sensor", line
            elif isinstance(sensors[fault.sensor], Stream):
                line = (
                    f"{key}.sensor = {fault.sensor}: is measured on a real rig; faults are those of simulated sensors"
                )
                yield f"{key}.sensor", line
        elif fault.actuator not in inputs:
            line = f"{plant} has no such actuator; {near(fault.actuator, inputs)}"
            yield f"{key}.actuator", f"{key}.actuator = {shown(fault.actuator)}: {line}"
        elif not inputs[fault.actuator].state:
            line = "every value of it makes new matrices, so it cannot jam or lose authority"
            yield f"{key}.actuator", f"{key}.actuator = {shown(fault.actuator)}: {line}"
        for field in ("at", "duration"):
            if value := getattr(fault, field):
                yield from whole_frames(f"{key}.{field}", lookup(raw, (name, field)), value, frame_ns, field == "at")
    for (name, first), (other, second) in combinations(part_faults.items(), 2):
        begin = max(first.at, second.at)
        if first.part == second.part and all(begin < _last(fault) for fault in (first, second)):
            where = f"both act on {first.part} at {begin / 1e9:g} s; one fault at a time is possible"
            yield f"faults.{other}", f"faults.{name} and faults.{other}: {where}: end one before, with duration"


def _last(fault: Any) -> float:
    """The time up to which a fault acts [ns]; of a spike without a duration only the first sample counts."""
    lasting = fault.at + 1.0 if isinstance(fault, Spike) else math.inf
    return lasting if fault.end is None else float(fault.end)
