"""An inhomogeneous disc: the stiffness of the structure varies with the angle of the disc. Absent: it is constant.

    scale (1 + depth cos(theta)),   theta = Int Omega dt (mod 2 pi):   stiffness by its square, damping by itself

Every natural frequency varies by the share `depth`. In each of `sectors` equal sectors the value at the middle of the
sector holds, so the equations are linear within a sector. An edge is an event; the change of stored energy at an edge
is the term `edges` of the energy balance.
Source: Kroeger, Neubauer, Popp, Phil. Trans. R. Soc. A 366 (2008) 785, figure 29: 3.4 kHz with a small variation
in the period of the turn; the paper gives no value of it.
"""

from __future__ import annotations

import math
from typing import Annotated, Any, ClassVar

from annotated_types import Ge, Gt, Le, Lt

from rig.about import About
from rig.model.assembly import Assembly, Output
from rig.model.named_rows import Row
from rig.picture import Plot
from rig.quantities import Section, quantity

TURN = "disc.turn"
_PERIOD = 2.0 * math.pi

Depth: Any = quantity("1", Gt(0.0), Lt(0.5))
Place: Any = quantity("rad", Ge(0.0), Lt(_PERIOD))
Count = Annotated[int, Ge(4), Le(96)]


class Inhomogeneity(Section):
    """Share by which the scale varies, number of sectors of the disc, angle theta at the start [rad]."""

    declares: ClassVar = About("stiffness that varies with the angle of the disc")

    depth: Depth
    sectors: Count = 24
    place: Place = 0.0


def add(a: Assembly, inhomogeneity: Inhomogeneity, speed: Row) -> None:
    """Add the angle of the disc, the integral of `speed` [rad/s], with which the structure varies. Output: `place`."""
    count = inhomogeneity.sectors
    scales = [1.0 + inhomogeneity.depth * math.cos(_PERIOD * (i + 0.5) / count) for i in range(count)]
    a.signal(TURN, speed, inhomogeneity.place, "inhomogeneity")
    a.vary("disc", {TURN: 1.0}, TURN, _PERIOD, tuple((scale**2, scale) for scale in scales))
    a.outputs["place"] = Output({TURN: 1.0}, "rad", Plot())
