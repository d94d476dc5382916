"""A wavy surface: the normal force swings as the surface passes under the contact. Absent: the surface is even.

    N (1 + depth cos(2 pi s / wavelength + phase)),   s = Int V dt - x

s is the slip distance: the way of the surface, a state, less that of the body. It stands still while the contact
sticks. Source: derived; it stands for a real waviness of the disc, and for contact nodes of a finite-element mesh that
pass over the elements of the other body (docs/tip.md).
"""

from __future__ import annotations

import math
from typing import Any, ClassVar

from annotated_types import Gt, Lt

from rig.about import About
from rig.model.assembly import Assembly, Output
from rig.model.named_rows import Row
from rig.quantities import Angle, PositiveMetre, Section, quantity

TRAVEL = "surface.travel"
Depth: Any = quantity("1", Gt(0.0), Lt(1.0))


class Waviness(Section):
    """Share by which the normal force swings, length of a wave along the surface, place in the wave at the start."""

    declares: ClassVar = About("the surface is wavy: the normal force swings with the slip distance")

    depth: Depth
    wavelength: PositiveMetre
    phase: Angle = 0.0


def add(a: Assembly, waviness: Waviness, patch: str, normal: str, along: Row) -> None:
    """Add the way of the surface, and what its waves add to the force `normal` as it is now, a normal force by itself.

    `along`: displacement of the body at the contact, over coordinates. What a wave adds is a share of the even force
    and ends where that one lifts off, so that the guard of lift-off stays a row over the state. Outputs: the
    `slip_distance` [m] and, with the waves, the `normal_force` [N].
    """
    a.signal(TRAVEL, a.surface(patch), 0.0, "waviness")
    slip = {TRAVEL: 1.0} | {name: -value for name, value in along.items()}
    turn = {name: 2.0 * math.pi / waviness.wavelength * value for name, value in slip.items()}
    a.product("waves", ("press", a.load(normal)), ("sin", turn | {"one": 0.5 * math.pi + waviness.phase}))
    a.normal("waviness", patch, {"waves": waviness.depth}, opens=False)
    a.outputs["slip_distance"] = Output(slip, "m")
    a.outputs["normal_force"] = Output({f"N:{normal}": 1.0, "N:waviness": 1.0}, "N")
