"""Numbers for the controllers of stick-slip: velocity feedback and dither."""

from __future__ import annotations

import math
from typing import Any

from rig.design.designer import Designer
from rig.design.kalman import observer

GENERATOR = "dither.amplitude"


def velocity(designer: Designer, section: Any) -> dict[str, Any]:
    """Scales of a controller that feeds the contact velocity back, or its observer."""
    found: dict[str, Any] = {"frequency": designer.frequency}
    if section.velocity == "observed":
        found["observer"] = observer(designer, section)
    else:
        found["read_scale"] = designer.read_scale(section.sensor)
    return found


def normal_force(designer: Designer, section: Any) -> dict[str, Any]:
    """Velocity, and the command per unit of the normal force."""
    return velocity(designer, section) | designer.commanded(designer.load, section.drive)


def belt_velocity(designer: Designer, section: Any) -> dict[str, Any]:
    """Velocity, and the command per unit of the speed of the surface."""
    return velocity(designer, section) | designer.commanded(designer.contact.surface, section.drive)


def dither_sampled(designer: Designer, section: Any) -> dict[str, Any]:
    """The command per unit of the speed of the surface."""
    return dict(designer.commanded(designer.contact.surface, section.drive))


def dither(designer: Designer, section: Any) -> dict[str, Any]:
    """Frequency and scales of a search for the least dither. Raises ValueError without a tangential dither."""
    inputs = designer.assembly.inputs
    if GENERATOR not in inputs:
        raise ValueError("kind: commands a dither generator, and the scene has no [dither]")
    found: dict[str, Any] = {"frequency": inputs["dither.frequency"].value}
    found["read_scale"] = designer.read_scale(section.sensor)
    if inputs[GENERATOR].unit == "N":
        if not any("dither.sin" in row for row in designer.assembly.force.values()):
            raise ValueError("kind: searches a tangential dither; the generator of this scene shakes the load")
        found["force_per_hertz"] = 2.0 * math.pi * designer.inertia
    found["nominal"] = designer.nominal(designer.contact.surface)
    if section.speed_sensor is not None:
        found["speed_scale"] = designer.speed_scale(section.speed_sensor)
    return found
