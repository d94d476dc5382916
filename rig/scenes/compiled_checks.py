"""Checks of controllers from compiled files (a library, an FMU): sizes, units, algebraic loops.

Every check yields (dotted key, line), as `rig.scenes.checks` does, or the line alone.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import Any

from rig.controllers.blocks.compiled import CompiledSection
from rig.scenes.faults import shown
from rig.scenes.source import Fault
from rig.units import same_unit


def faults(section: CompiledSection) -> Iterator[str]:
    """A compiled controller has the right numbers of sensors and actuators, and answers: the faults, one line each."""
    from rig.controllers.runtime.file import section_faults  # where a scene names a file

    found = section.faults()
    if not found:  # a crash is that of its helper process
        found = [f"file: {line}" for line in section_faults(section.model_copy(update={"where": "process"}), {})]
    yield from found


def units(controllers: Mapping[str, Any], sensors: Mapping[str, Any], inputs: Mapping[str, str]) -> Iterator[Fault]:
    """The inputs and outputs of compiled controllers have the units of the sensors and actuators (name -> unit)."""
    for name, section in controllers.items():
        if not isinstance(section, CompiledSection):
            continue
        heard = {sensor: one.unit for sensor, one in sensors.items()}
        both = (("reads", section.connected_sensors, section.used_inputs, heard, "sensor"),
                ("drives", section.connected_actuators, section.used_outputs, inputs, "actuator"))  # fmt: skip
        for field, names, signals, known, what in both:
            for other, signal in zip(names, signals):
                if signal.unit and other in known and not same_unit(known[other], signal.unit):
                    key = f"controllers.{name}.{field}"
                    own = f"{section.file} has it as {signal.name} in {signal.unit}"
                    yield key, f"{key} = {shown(other)}: the {what} is in {known[other]}, {own}"


def algebraic_loops(
    controllers: Mapping[str, Any], sensors: Mapping[str, Any], outputs: Mapping[str, Any], inputs: Mapping[str, Any]
) -> Iterator[Fault]:
    """No command of an FMU depends on a measurement that depends on this command at the same instant.

    `outputs`, `inputs`: those of the rig with all actuators of controllers moved.
    """
    follows: dict[str, list[tuple[str, str, str]]] = {}  # actuator -> controller, sensor, actuator that follows at once
    for name, section in controllers.items():
        if not isinstance(section, CompiledSection) or section.delay:
            continue
        heard = {one.name: sensor for one, sensor in zip(section.used_inputs, section.connected_sensors)}
        for signal, driven in zip(section.used_outputs, section.connected_actuators):
            for sensor in (heard[one] for one in signal.direct or () if one in heard):
                for actuator in (one for one in inputs if _at_once(inputs[one], sensors[sensor], outputs)):
                    follows.setdefault(actuator, []).append((name, sensor, driven))

    def chain(actuator: str, path: tuple[str, ...], seen: frozenset[str]) -> tuple[str, ...]:
        """The way from `actuator` back to the first one; empty if there is none."""
        for name, sensor, driven in follows.get(actuator, ()):
            here = (*path, sensor, name, driven)
            if driven == path[0]:
                return here
            if driven not in seen and (found := chain(driven, here, seen | {driven})):
                return found
        return ()

    told: set[str] = set()
    for actuator in follows:
        found = chain(actuator, (actuator,), frozenset((actuator,)))
        if found and found[2] not in told:
            told.update(found[2::3])
            key = f"controllers.{found[2]}.delay"
            loop = "each depends at once on the one before it, an algebraic loop; state a delay of at least one frame"
            yield key, f"{key}: {' -> '.join(found)}: {loop}"


def _at_once(actuator: Any, sensor: Any, outputs: Mapping[str, Any]) -> bool:
    """Whether a measurement depends on the command of an actuator at the same instant."""
    end = sensor.front_end()
    if actuator.lagging or sensor.reads not in outputs or end.delay_ns or end.averages or not end.direct:
        return False
    row = outputs[sensor.reads].row  # accelerations and forces follow a command at once
    return actuator.state in row or any(":" in name or name.endswith("''") for name in row)
