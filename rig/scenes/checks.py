"""What holds between the parts of a scene: whole numbers of frames, sensors and actuators that exist, one owner each.

Every check yields (dotted key, line), as `faults.lines` does.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from math import isqrt
from typing import Any

from rig.controllers import made_by
from rig.controllers.blocks.base import hears
from rig.parts import told as blamed
from rig.quantities import LONGEST
from rig.scenes.faults import near, shown
from rig.scenes.protocol import Connect, Disconnect, Load, Ramp, Repeat, Set, flat, longest_ns
from rig.scenes.scene import Clock, controller_drives, controller_reads

Fault = tuple[str, str]
TIMES = ("over", "time", "timeout", "window")


def periods(clock: Clock, controllers: Mapping[str, Any], raw: Mapping[str, Any]) -> Iterator[Fault]:
    """Controllers work, and their loops delay, by whole frames."""
    for name, section in controllers.items():
        for field in ("period", "delay"):
            value = getattr(section, field, 0)
            given = _raw(raw, "controllers", name, field, default=f"{value / 1e9:g} s")
            yield from _whole(f"controllers.{name}.{field}", given, value, clock.frame, field == "delay")
        if section.period != clock.frame and hears(made_by(section)):
            key = f"controllers.{name}.period"
            yield (
                key,
                f"{key}: a {section.kind} wants every sample, so its period must be one frame ({_ms(clock.frame)})",
            )


def foreign(key: str, section: Any) -> Iterator[Fault]:
    """A sensor or a controller from elsewhere does what is asked of it."""
    found: list[str] = []
    if hasattr(section, "front_end"):
        units = [one for one in ("delivers", "accepts") if not isinstance(getattr(section, one, None), str)]
        found = [f"its class states no `{one}`, a unit" for one in units]
        try:
            section.front_end()
        except Exception as error:
            found.append(blamed(error) or f"{section.kind}: {error}")
    else:
        from rig.controllers.runtime.file import refused  # where a scene names a file

        found = refused(section)
        period = getattr(made_by(section), "period_ns", None)
        if isinstance(period, int) and period != section.period:
            found.append(f"it works every {_ms(period)} (Controller.period_ns), not every {_ms(section.period)}")
    yield from ((key, f"{key}.kind: {line}") for line in found)


def steps(clock: Clock, step_ns: int, raw: Mapping[str, Any]) -> Iterator[Fault]:
    """The fixed step of rk4 and kick divides the sample step."""
    if clock.method in ("rk4", "kick") and step_ns % clock.rk4_step:
        parts = max(1, round(step_ns / clock.rk4_step))
        pairs = ((d, step_ns // d) for d in range(1, isqrt(step_ns) + 1) if step_ns % d == 0)
        parts = min(d for pair in pairs for d in pair if d >= parts)
        given = _raw(raw, "clock", "rk4_step", default=f"{clock.rk4_step / 1e9:g} s")
        yield (
            "clock.rk4_step",
            f"clock.rk4_step = {given}: {_ms(clock.rk4_step)} is not a whole part of the sample step "
            f"({_ms(step_ns)}); nearest: {_ms(step_ns // parts)}",
        )


def lengths(clock: Clock, protocol: Iterable[Any], raw: Any, prefix: str = "protocol") -> Iterator[Fault]:
    """Every time in the protocol is a whole number of frames."""
    for i, step in enumerate(protocol):
        told = raw[i] if isinstance(raw, list) and i < len(raw) and isinstance(raw[i], Mapping) else {}
        for field in TIMES:
            value = getattr(step, field, 0)
            given = shown(told[field]) if field in told else f"{value / 1e9:g} s"
            yield from _whole(f"{prefix}[{i + 1}].{field}", given, value, clock.frame, zero=True)
        if isinstance(step, Repeat):
            yield from lengths(clock, step.steps, told.get("steps", []), f"{prefix}[{i + 1}].steps")


def whole(protocol: Sequence[Any]) -> Iterator[Fault]:
    """The protocol ends in a time that can be counted, or never."""
    length = longest_ns(protocol)
    if length is not None and length > LONGEST:
        yield "protocol", f"protocol: takes up to {length / 1e9:.3g} s; at most {LONGEST / 1e9:g} s are possible"


def _whole(key: str, given: str, value: int, frame: int, zero: bool) -> Iterator[Fault]:
    if value % frame:
        near = sorted({n * frame for n in (value // frame, value // frame + 1) if n or zero})
        yield (
            key,
            f"{key} = {given}: {_ms(value)} is not a whole number of frames ({_ms(frame)}); "
            f"nearest: {' or '.join(map(_ms, near))}",
        )


def readings(sensors: Mapping[str, Any], outputs: Mapping[str, Any], plant: str) -> Iterator[Fault]:
    """Each sensor reads an output of the rig that has the unit it is made for."""
    for name, section in sensors.items():
        key = f"sensors.{name}.reads"
        if section.reads not in outputs:
            yield key, f"{key} = {shown(section.reads)}: {plant} has no such output; {near(section.reads, outputs)}"
        elif outputs[section.reads].unit != section.reads_unit:
            fitting = [n for n, output in outputs.items() if output.unit == section.reads_unit]
            yield (
                key,
                f"{key} = {shown(section.reads)}: is in {outputs[section.reads].unit}, a {section.kind} reads "
                f"{section.reads_unit}; fitting: {', '.join(fitting)}",
            )


def wiring(
    controllers: Mapping[str, Any], sensors: Iterable[str], inputs: Iterable[str], plant: str
) -> Iterator[Fault]:
    """Controllers read sensors that are there, drive actuators that are there, and each actuator has one driver."""
    sensors, inputs = set(sensors), set(inputs)
    owners: dict[str, str] = {}
    for name, section in controllers.items():
        for field, sensor in controller_reads(section).items():
            if sensor not in sensors:
                key = f"controllers.{name}.{field}"
                yield key, f"{key} = {shown(sensor)}: unknown sensor; {near(sensor, sensors)}"
        for actuator in controller_drives(section):
            key = f"controllers.{name}.drive"
            if actuator not in inputs:
                yield key, f"{key} = {shown(actuator)}: {plant} has no such actuator; {near(actuator, inputs)}"
            elif actuator in owners:
                yield key, f"controllers.{owners[actuator]} and controllers.{name}: both drive {actuator}; only one can"
            else:
                owners[actuator] = name


def hands_off(protocol: Iterable[Any], controllers: Mapping[str, Any]) -> Iterator[Fault]:
    """The protocol leaves an actuator alone while a controller drives it."""
    owners = {actuator: name for name, section in controllers.items() for actuator in controller_drives(section)}
    connected = set(controllers) - {s.controller for s in flat(protocol) if isinstance(s, Connect)}
    for i, step in enumerate(protocol, 1):
        for inner in flat([step]):
            if isinstance(inner, Connect):
                connected.add(inner.controller)
            elif isinstance(inner, Disconnect):
                connected.discard(inner.controller)
            elif isinstance(inner, Load | Ramp | Set) and owners.get(inner.target) in connected:
                key = f"protocol[{i}].{inner.step}"
                yield key, f"{key}: {inner.target} is driven by controllers.{owners[inner.target]} at this point"


def commanded(protocol: Iterable[Any], inputs: Mapping[str, Any]) -> Iterator[Fault]:
    """The protocol asks of an actuator what it can take, and for a ramp where it can run."""
    for i, step in enumerate(protocol, 1):
        for inner in flat([step]):
            if not isinstance(inner, Load | Ramp | Set) or inner.target not in inputs:
                continue
            one, key = inputs[inner.target], f"protocol[{i}].{inner.step}"
            value = inner.force if isinstance(inner, Load) else inner.to
            if not one.low <= value <= one.high:
                unit = "" if one.unit == "1" else f" {one.unit}"
                yield key, f"{key}: {inner.target} takes {one.low:g} to {one.high:g}{unit}, not {value:g}{unit}"
            if not isinstance(inner, Set) and inner.over and not one.slope and one.write is None:
                remedy = "set steps, one value after the other"
                if one.ramped:
                    remedy += f", or {one.ramped}"
                yield key, f"{key}: {inner.target} cannot run, every value of it makes new matrices; {remedy}"


def _raw(raw: Mapping[str, Any], *path: str, default: Any) -> str:
    value: Any = raw
    for part in path:
        value = value.get(part) if isinstance(value, Mapping) else None
    return shown(default if value is None else value)


def _ms(ns: float) -> str:
    return f"{ns / 1e6:.6g} ms"
