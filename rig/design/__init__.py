"""From the matrices of a rig to the numbers of its controllers.

A controller never sees the plant. This step, taken once at the start of a run, gives each controller what it needs as
plain numbers: scales between the units of its sensor and drive and those of the contact, the frequency of the
structure, observers. Which they are each controller says itself (rig.controllers.blocks.design).

asked        what a controller's design step may ask
designer     the matrices as a controller's designer sees them
kalman       an observer of the contact velocity        modal   the modes of the sliding rig
linearised   small motions about steady sliding as matrices, from actuators to outputs
sampled      a controller with its instrument, delay, sample and hold around these
"""

from __future__ import annotations

from typing import Any

from rig import controllers
from rig.design.asked import Asked
from rig.design.designer import Designer
from rig.errors import SceneError
from rig.model.assembly import Assembly

__all__ = ["described", "numbers"]


def numbers(scene: Any, assembly: Assembly | None = None) -> dict[str, dict[str, Any]]:
    """Numbers for each controller of `scene`, as plain JSON values. Raises SceneError with all that cannot be done."""
    if not scene.controllers:
        return {}
    rig = Asked(Designer(assembly if assembly is not None else scene.assemble(), scene.sensors, scene.parameters))
    found: dict[str, dict[str, Any]] = {}
    faults: list[str] = []
    for name, section in scene.controllers.items():
        try:
            design = getattr(controllers.made_by(section), "design", None)
            found[name] = {} if design is None else design(rig, section)
        except ValueError as fault:
            faults.append(f"controllers.{name}.{fault}")
        except ArithmeticError as fault:  # sizes whose squares no number holds
            faults.append(f"controllers.{name}: its numbers cannot be computed for this rig: {fault.args[-1]}")
    if faults:
        raise SceneError(scene.name, faults)
    return found


def described(scene: Any) -> dict[str, dict[str, Any]]:
    """Each controller of `scene` with its numbers, as it travels to its process. Raises SceneError as `numbers`."""
    found = numbers(scene)
    return {name: controllers.described(section, found[name]) for name, section in scene.controllers.items()}
