"""Checks across the parts of a scene: whole numbers of frames, existing sensors and actuators, one owner for each.

Of controllers from compiled files (a library, an FMU): sizes, units, algebraic loops. Every check yields (dotted key,
line), as `faults.lines` does.
"""

from __future__ import annotations

import sys
from collections.abc import Iterable, Iterator, Mapping, Sequence
from math import isqrt
from typing import Any, TypeGuard

from pydantic import BaseModel
from pydantic_core import PydanticSerializationError

from rig.controllers import controller_class, controller_drives, controller_reads
from rig.controllers.blocks import base, compiled
from rig.controllers.device import Device
from rig.errors import PartError
from rig.machine.board import Address
from rig.parts import calling, file_of, place_of
from rig.quantities import LONGEST
from rig.scenes import sections, source
from rig.scenes.faults import lookup, near, shown, unit_of
from rig.scenes.protocol import Clock, Connect, Disconnect, Repeat, extremes, flat, moves, targets
from rig.sensors.chain.front_end import FrontEnd
from rig.sensors.stream import AGE, streams
from rig.units import brief, is_number, same_unit, unit_fault

TIMES = ("over", "time", "duration", "timeout", "window")


def units(
    controllers: Mapping[str, Any], sensors: Mapping[str, Any], inputs: Mapping[str, str]
) -> Iterator[source.Fault]:
    """The inputs and outputs of compiled controllers have the units of the sensors and actuators (name -> unit)."""
    for name, section in controllers.items():
        if not isinstance(section, compiled.CompiledSection):
            continue
        heard = {sensor: instrument.unit for sensor, instrument in sensors.items()}
        both = (
            ("reads", section.connected_sensors, section.used_inputs, heard, "sensor"),
            ("drives", section.connected_actuators, section.used_outputs, inputs, "actuator"),
        )
        for field, names, signals, known, what in both:
            for other, signal in zip(names, signals):
                if signal.unit and other in known and not same_unit(known[other], signal.unit):
                    key = f"controllers.{name}.{field}"
                    own = f"{section.file} has it as {signal.name} in {signal.unit}"
                    yield key, f"{key} = {shown(other)}: the {what} is in {known[other]}, {own}"


def algebraic_loops(
    controllers: Mapping[str, Any], sensors: Mapping[str, Any], outputs: Mapping[str, Any], inputs: Mapping[str, Any]
) -> Iterator[source.Fault]:
    """No command of an FMU depends on a measurement that depends on this command at the same instant.

    `outputs`, `inputs`: those of the rig with all actuators of controllers moved.
    """
    follows: dict[str, list[tuple[str, str, str]]] = {}  # actuator -> controller, sensor, actuator that follows at once
    for name, section in controllers.items():
        if not isinstance(section, compiled.CompiledSection) or section.delay:
            continue
        heard = {signal.name: sensor for signal, sensor in zip(section.used_inputs, section.connected_sensors)}
        for signal, driven in zip(section.used_outputs, section.connected_actuators):
            for sensor in (heard[input_name] for input_name in signal.direct or () if input_name in heard):
                for actuator in inputs:
                    if _at_once(inputs[actuator], sensors[sensor], outputs):
                        follows.setdefault(actuator, []).append((name, sensor, driven))

    def chain(actuator: str, path: tuple[str, ...], seen: frozenset[str]) -> tuple[str, ...]:
        """The way from `actuator` back to the first one; empty if there is none."""
        for name, sensor, driven in follows.get(actuator, ()):
            here = (*path, sensor, name, driven)
            if driven == path[0]:
                return here
            way = () if driven in seen else chain(driven, here, seen | {driven})
            if way:
                return way
        return ()

    told: set[str] = set()
    for actuator in follows:
        circle = chain(actuator, (actuator,), frozenset((actuator,)))
        if circle and circle[2] not in told:
            told.update(circle[2::3])
            key = f"controllers.{circle[2]}.delay"
            loop = "each depends at once on the one before it, an algebraic loop; state a delay of at least one frame"
            yield key, f"{key}: {' -> '.join(circle)}: {loop}"


def _at_once(actuator: Any, sensor: Any, outputs: Mapping[str, Any]) -> bool:
    """Whether a measurement depends on the command of an actuator at the same instant."""
    end = sensor.front_end()
    if actuator.lagging or sensor.reads not in outputs or end.delay_ns or end.averages or not end.direct:
        return False
    row = outputs[sensor.reads].row  # accelerations and forces follow a command at once
    return actuator.state in row or any(":" in name or name.endswith("''") for name in row)


def periods(clock: Clock, controllers: Mapping[str, Any], raw: Mapping[str, Any]) -> Iterator[source.Fault]:
    """Periods and delays of controllers are whole numbers of frames."""
    for name, section in controllers.items():
        for field in ("period", "delay"):
            value = getattr(section, field, 0)
            if not _whole_ns(value, least=int(field == "period")):  # a default, which nobody has checked yet
                key = f"controllers.{name}.{field}"
                file = file_of(sys.modules[type(section).__module__])
                yield key, f"{key}: {file} declares {brief(value)}; expected whole nanoseconds, e.g. 1_000_000"
                continue
            given = lookup(raw, ("controllers", name, field))
            yield from whole_frames(f"controllers.{name}.{field}", given, value, clock.frame, field == "delay")
        if section.period != clock.frame and base.gets_every_sample(controller_class(section)):
            key = f"controllers.{name}.period"
            yield (
                key,
                f"{key}: a {section.kind} wants every sample, so its period must be one frame ({_ms(clock.frame)})",
            )


def foreign(key: str, section: Any) -> Iterator[source.Fault]:
    """A foreign sensor or controller declares what it must, and works."""
    lines: list[str] = []
    if hasattr(section, "front_end"):
        file = file_of(sys.modules[type(section).__module__])
        for name in ("delivers", "accepts"):
            if (unit := getattr(section, name, None)) is None:
                lines.append(f"{file}: its class states no `{name}`, a unit")
            elif fault := unit_fault(unit):
                lines.append(f"{file}: {name} = {fault}")
        try:
            with calling(sys.modules[type(section).__module__]):
                end = section.front_end()
                factor = section.sensitivity
                back = section.conversion
        except PartError as error:
            lines.append(str(error))
        else:
            of_end = end.faults() if isinstance(end, FrontEnd) else [f"is {brief(end)}; expected a FrontEnd"]
            lines += [f"{file}: flawed(){place_of(type(section).flawed)}: {line}" for line in of_end]
            if not is_number(factor):
                lines.append(f"{file}: sensitivity is {brief(factor)}; expected a finite number")
            if back is not None and not is_number(back):
                lines.append(f"{file}: conversion is {brief(back)}; expected a finite number, or None")
    else:
        from rig.controllers.runtime.file import section_faults  # where a scene names a file

        made = controller_class(section)
        if isinstance(section, compiled.CompiledSection):
            lines = section.faults()  # the right numbers of sensors and actuators
            if not lines:
                lines = [f"file: {line}" for line in section_faults(section, {})]
            yield from ((f"{key}.{line.partition(':')[0]}", f"{key}.{line}") for line in lines)
            return
        if not hasattr(made, "design"):  # one with a design step needs numbers: rig.design tries it
            lines = section_faults(section, {})
        try:
            controller_reads(section), controller_drives(section)
        except PartError as error:
            lines.append(str(error))
        period = getattr(made, "period_ns", None)
        if _whole_ns(period) and period != section.period:
            lines.append(f"it works every {_ms(period)} (Controller.period_ns), not every {_ms(section.period)}")
    yield from ((key, f"{key}.kind: {line}") for line in lines)


def misdeclared(section: BaseModel, key: str) -> Iterator[source.Fault]:
    """Faults of fields that only sections of foreign parts have.

    A default of a quantity that is a text: only what a scene gives is converted. A value that JSON, and so a recording,
    cannot hold.
    """
    where = file_of(sys.modules[type(section).__module__])
    whole = _plain(section)
    for name, info in type(section).model_fields.items():
        value = getattr(section, name)
        inner = f"{key}.{name}" if key else name
        what = f"{inner}: {where}: {type(section).__name__}.{name}"
        unit = unit_of(info)
        if isinstance(value, BaseModel):
            yield from misdeclared(value, inner)
        elif isinstance(value, str) and name not in section.model_fields_set and unit:
            yield inner, f"{what} has the default {brief(value)}; expected a number in {unit}"
        elif not whole and not _plain(section, {name}):
            holds = f"{what} holds {brief(value)}, which no recording can contain"
            yield inner, f"{holds}; use numbers, texts, and tuples or dicts of them"


def _plain(section: BaseModel, names: set[str] | None = None) -> bool:
    try:
        section.model_dump(mode="json", include=names, warnings=False)
    except PydanticSerializationError:
        return False
    return True


def steps(clock: Clock, step_ns: int, raw: Mapping[str, Any]) -> Iterator[source.Fault]:
    """The fixed step of rk4 and kick divides the sample step."""
    if clock.method in ("rk4", "kick") and step_ns % clock.rk4_step:
        parts = max(1, round(step_ns / clock.rk4_step))
        pairs = ((d, step_ns // d) for d in range(1, isqrt(step_ns) + 1) if step_ns % d == 0)
        parts = min(d for pair in pairs for d in pair if d >= parts)
        given = shown(lookup(raw, ("clock", "rk4_step")) or f"{clock.rk4_step / 1e9:g} s")
        yield (
            "clock.rk4_step",
            f"clock.rk4_step = {given}: {_ms(clock.rk4_step)} is not a whole part of the sample step "
            f"({_ms(step_ns)}); nearest: {_ms(step_ns // parts)}",
        )


def lengths(clock: Clock, protocol: Iterable[Any], raw: Any, prefix: str = "protocol") -> Iterator[source.Fault]:
    """Every time in the protocol is a whole number of frames."""
    for i, step in enumerate(protocol):
        for field in TIMES:
            value = getattr(step, field, None) or 0
            given = lookup(raw, (i, field))
            yield from whole_frames(f"{prefix}[{i + 1}].{field}", given, value, clock.frame, zero=True)
        if isinstance(step, Repeat):
            yield from lengths(clock, step.steps, lookup(raw, (i, "steps")), f"{prefix}[{i + 1}].steps")


def whole(protocol: Sequence[Any]) -> Iterator[source.Fault]:
    """The protocol ends within the longest time that can be counted, or never."""
    length = sections.longest_ns(protocol)
    if length is not None and length > LONGEST:
        yield "protocol", f"protocol: takes up to {length / 1e9:.3g} s; at most {LONGEST / 1e9:g} s are possible"


def whole_frames(key: str, given: Any, value: int, frame: int, zero: bool) -> Iterator[source.Fault]:
    """(key, line) if a time [ns], `given` or by default, is no whole number of frames; `zero`: whether 0 is allowed."""
    if value % frame:
        text = shown(given or f"{value / 1e9:g} s")
        near = sorted({n * frame for n in (value // frame, value // frame + 1) if n or zero})
        yield (
            key,
            f"{key} = {text}: {_ms(value)} is not a whole number of frames ({_ms(frame)}); "
            f"nearest: {' or '.join(map(_ms, near))}",
        )


def readings(sensors: Mapping[str, Any], outputs: Mapping[str, Any], plant: str) -> Iterator[source.Fault]:
    """Each sensor reads an output of the rig, in the unit that it accepts."""
    for name, section in sensors.items():
        key = f"sensors.{name}.reads"
        if section.reads not in outputs:
            yield key, f"{key} = {shown(section.reads)}: {plant} has no such output; {near(section.reads, outputs)}"
        elif section.reads_unit and outputs[section.reads].unit != section.reads_unit:
            fitting = [n for n, output in outputs.items() if output.unit == section.reads_unit]
            yield (
                key,
                f"{key} = {shown(section.reads)}: is in {outputs[section.reads].unit}, a {section.kind} reads "
                f"{section.reads_unit}; outputs in this unit: {', '.join(fitting) or 'none'}",
            )


def boards(controllers: Mapping[str, Any], sensors: Mapping[str, Any]) -> Iterator[source.Fault]:
    """Each board has one controller, or streams: one for each of its values."""
    owners: dict[Any, str] = {}
    for name, section in controllers.items():
        if not isinstance(section, Device):
            continue
        where = _place(section.address)
        if where in owners:
            yield _taken(f"controllers.{name}.port", section.port, owners[where])
        owners[where] = f"controllers.{name}"
    channels: dict[Any, list[int]] = {}
    measured = {name: stream for name, stream in streams(sensors).items() if stream.channel != AGE}
    for name, stream in measured.items():
        where = _place(stream.address)
        if where in owners:
            yield _taken(f"sensors.{name}.port", stream.port, owners[where])
        channels.setdefault(where, []).append(stream.channel)
    for name, stream in measured.items():
        given = sorted(channels[_place(stream.address)])
        if given != list(range(1, len(given) + 1)):
            key = f"sensors.{name}.channel"
            all_given = ", ".join(map(str, given))
            yield (
                key,
                f"{key}: the streams of {stream.port} have the channels {all_given}; expected each from 1 on once",
            )


def _place(address: Address) -> Any:
    return address.device if address.kind == "serial" else address


def _taken(key: str, port: str, owner: str) -> source.Fault:
    return key, f"{key} = {port}: is the port of {owner}, too; each board has its own"


def stream_rates(clock: Clock, sensors: Mapping[str, Any]) -> Iterator[source.Fault]:
    """A stream has at most one sample in a frame."""
    for name, stream in streams(sensors).items():
        instants = stream.instants
        key = f"sensors.{name}.rate"
        if stream.channel != AGE and (not instants.even or instants.whole[0] % clock.frame):
            yield (
                key,
                f"{key} = {stream.rate:g} Hz: a stream has one sample in every frame or fewer; with a frame of "
                f"{_ms(clock.frame)} state {1e9 / clock.frame:g} Hz or a whole part of it",
            )


def wiring(
    controllers: Mapping[str, Any], sensors: Iterable[str], inputs: Iterable[str], plant: str
) -> Iterator[source.Fault]:
    """Controllers read existing sensors and drive existing actuators, and each actuator has one driver."""
    sensors = set(sensors)
    inputs = set(inputs)
    owners: dict[str, str] = {}
    for name, section in controllers.items():
        for field, sensor in controller_reads(section).items():
            if sensor not in sensors:
                key = f"controllers.{name}.{field}"
                yield key, f"{key} = {shown(sensor)}: unknown sensor; {near(sensor, sensors)}"
        for actuator in controller_drives(section):
            key = f"controllers.{name}.{'drives' if 'drives' in type(section).model_fields else 'drive'}"
            if actuator not in inputs:
                yield key, f"{key} = {shown(actuator)}: {plant} has no such actuator; {near(actuator, inputs)}"
            elif actuator in owners:
                yield key, f"controllers.{owners[actuator]} and controllers.{name}: both drive {actuator}; only one can"
            else:
                owners[actuator] = name


def hands_off(protocol: Iterable[Any], controllers: Mapping[str, Any]) -> Iterator[source.Fault]:
    """The protocol does not set an actuator while a controller drives it."""
    owners = {actuator: name for name, section in controllers.items() for actuator in controller_drives(section)}
    connected = set(controllers) - {s.controller for s in flat(protocol) if isinstance(s, Connect)}
    for i, step in enumerate(protocol, 1):
        for inner in flat([step]):
            if isinstance(inner, Connect):
                connected.add(inner.controller)
            elif isinstance(inner, Disconnect):
                connected.discard(inner.controller)
            for target in targets(inner):
                if owners.get(target) in connected:
                    key = f"protocol[{i}].{inner.step}"
                    yield key, f"{key}: {target} is driven by controllers.{owners[target]} at this point"


def commanded(protocol: Iterable[Any], inputs: Mapping[str, Any]) -> Iterator[source.Fault]:
    """The protocol sets values within the range of the actuator, and ramps only actuators that can move linearly."""
    for i, step in enumerate(protocol, 1):
        for inner, target in ((part, target) for part in flat([step]) for target in targets(part)):
            if target not in inputs:
                continue
            actuator = inputs[target]
            key = f"protocol[{i}].{inner.step}"
            for value in dict.fromkeys(extremes(inner, target)):
                if value < actuator.low or value > actuator.high:
                    unit = "" if actuator.unit == "1" else f" {actuator.unit}"
                    yield key, f"{key}: {target} takes {actuator.low:g} to {actuator.high:g}{unit}, not {value:g}{unit}"
            if moves(inner) and not actuator.slope and actuator.write is None:
                remedy = "set steps, one value after the other"
                if actuator.ramped:
                    remedy += f", or {actuator.ramped}"
                yield key, f"{key}: {target} cannot run, every value of it makes new matrices; {remedy}"


def _whole_ns(value: Any, least: int = 1) -> TypeGuard[int]:
    return isinstance(value, int) and not isinstance(value, bool) and value >= least


def _ms(ns: float) -> str:
    return f"{ns / 1e6:.6g} ms"
