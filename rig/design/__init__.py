"""From the matrices of a rig to the numbers of its controllers.

A controller never sees the plant. This step is carried out once at the start of a run. It gives each controller plain
numbers: scales between the units of its sensor and actuator and those of the contact, the frequency of the structure,
observers. Each controller selects its numbers itself (rig.controllers.blocks.design).

rig             the quantities that a controller's design step may use, among them a Kalman observer and vibration modes
linearised      the rig linearised about steady sliding, from actuators to outputs; controllers in linear form
sampled_loops   control loops around it: controllers, instruments, delays, sample and hold
"""

from __future__ import annotations

import json
from collections.abc import Iterator, Mapping
from typing import Any

from rig import controllers
from rig.controllers import controller_drives, controller_reads
from rig.design.rig import DesignRig
from rig.errors import PartError, SceneError
from rig.parts import calling, code_of, file_of
from rig.scenes.faults import near, shown
from rig.scenes.scene import Scene
from rig.units import brief

__all__ = ["described", "numbers"]


def numbers(scene: Scene) -> dict[str, dict[str, Any]]:
    """The numbers of each controller of `scene`, as plain JSON values, from what it believes of the rig.

    Raises SceneError with all faults.
    """
    if not scene.controllers:
        return {}
    believed = scene.designed_for
    rig = DesignRig(believed.assemble(), believed.sensors, believed.parameters)
    by_controller: dict[str, dict[str, Any]] = {}
    faults: list[str] = []
    for name, section in scene.controllers.items():
        try:
            if missing := _missing(section, scene.sensors):
                faults += [f"controllers.{name}.{text}" for text in missing]
                continue
            design = getattr(controllers.controller_class(section), "design", None)
            by_controller[name] = {} if design is None else _designed(design, rig, section)
            faults += [
                f"controllers.{name}: {text}" for text in _unconnected(section, by_controller[name], scene.sensors)
            ]
        except PartError as fault:
            faults.append(f"controllers.{name}: {fault}")
        except ValueError as fault:
            stated = str(fault).partition(":")[0] in type(section).model_fields
            faults.append(f"controllers.{name}{'.' if stated else ': '}{fault}")
        except ArithmeticError as fault:  # overflow of squares
            faults.append(f"controllers.{name}: its numbers cannot be computed for this rig: {fault.args[-1]}")
    if faults:
        raise SceneError(scene.name, faults)
    return by_controller


def _missing(section: Any, sensors: Mapping[str, Any]) -> list[str]:
    """The sensors that a controller reads and the scene does not have: that of a recording was not checked."""
    return [
        f"{field} = {shown(sensor)}: unknown sensor; {near(sensor, sensors)}"
        for field, sensor in controller_reads(section).items()
        if sensor not in sensors
    ]


def _unconnected(section: Any, numbers: Mapping[str, Any], sensors: Mapping[str, Any]) -> Iterator[str]:
    """What a foreign controller reads or drives beside what its section names, and what no one can connect it to."""
    if code_of(controllers.module_of(section)) is None:
        return
    made = controllers.build(section, numbers)
    drives = controller_drives(section)
    if missing := [name for name in made.reads if name not in sensors]:
        yield f"Controller.reads has {', '.join(missing)}; the sensors are {', '.join(sensors)}"
    if missing := [name for name in made.drives if name not in drives]:
        yield f"Controller.drives has {', '.join(missing)}; the table of the scene names {', '.join(drives) or 'none'}"


def _designed(design: Any, rig: DesignRig, section: Any) -> dict[str, Any]:
    """The numbers of the design step. A foreign controller is tried with them: raises PartError if it fails."""
    module = controllers.module_of(section)
    with calling(module, ValueError, ArithmeticError):
        numbers: dict[str, Any] = design(rig, section)
    if code_of(module) is None:
        return numbers
    from rig.controllers.runtime.file import section_faults  # where a scene names a file

    if not isinstance(numbers, dict):
        raise PartError(f"{file_of(module)}: design gives {brief(numbers)}; expected a dict of plain JSON values")
    try:
        json.dumps(numbers, allow_nan=False)
    except (TypeError, ValueError) as error:
        raise PartError(f"{file_of(module)}: design gives values that are not plain JSON: {error}") from None
    if faults := section_faults(section, numbers):
        raise PartError("; ".join(faults))
    return numbers


def described(scene: Scene) -> dict[str, dict[str, Any]]:
    """The description of each controller of `scene` with its numbers. Raises SceneError as `numbers` does."""
    by_controller = numbers(scene)
    return {name: controllers.described(section, by_controller[name]) for name, section in scene.controllers.items()}
