"""A wavy surface: the normal force varies as the surface passes under the contact. Absent: the surface is even.

    N (1 + depth cos(2 pi s / wavelength + phase)),   s = Int V dt - x

s is the slip distance: the travel of the surface, a state, minus the displacement of the body. It is constant while
the contact sticks. It represents waviness of a real disc, or contact nodes of a finite-element mesh that pass over the
elements of the other body (docs/tip.md). Source: derived here.
"""

from __future__ import annotations

import math
from typing import Any, ClassVar

from annotated_types import Gt, Lt

from rig.about import About
from rig.model.assembly import Assembly, Output
from rig.model.named_rows import Row
from rig.picture import Plot
from rig.quantities import Angle, PositiveMetre, Section, quantity

TRAVEL = "surface.travel"
Depth: Any = quantity("1", Gt(0.0), Lt(1.0))


class Waviness(Section):
    """Share by which the normal force varies, wavelength along the surface [m], phase at the start [rad]."""

    declares: ClassVar = About("the surface is wavy: the normal force varies with the slip distance")

    depth: Depth
    wavelength: PositiveMetre
    phase: Angle = 0.0


def add(a: Assembly, waviness: Waviness, patch: str, normal: str, along: Row) -> None:
    """Add the travel of the surface, and the variation of the force `normal` by the waves.

    `along`: displacement of the body at the contact [m] as a row over coordinates. The variation is a share of the
    force on an even surface and ends where that force becomes zero; the guard of lift-off stays a row over the state.
    Outputs: `slip_distance` [m] and `normal_force` [N] including the waves.
    """
    a.signal(TRAVEL, a.surface(patch), 0.0, "waviness")
    slip = {TRAVEL: 1.0} | {name: -value for name, value in along.items()}
    turn = {name: 2.0 * math.pi / waviness.wavelength * value for name, value in slip.items()}
    a.product("waves", ("press", a.load(normal)), ("sin", turn | {"one": 0.5 * math.pi + waviness.phase}))
    a.normal("waviness", patch, {"waves": waviness.depth}, opens=False)
    a.outputs["slip_distance"] = Output(slip, "m", Plot())
    a.outputs["normal_force"] = Output({f"N:{normal}": 1.0, "N:waviness": 1.0}, "N")
