"""A disc that is not alike all round: the structure is stiffer or softer with its turn. Absent: it is alike.

    scale (1 + depth cos(theta)),   theta = Int Omega dt (mod 2 pi):   stiffness by its square, damping by itself

All natural frequencies swing by `depth` of themselves. In each of `sectors` equal sectors the value is that of its
middle, so that the motion stays linear in every one; an edge is an event, and what the new stiffness stores at that
instant the energy balance counts as `edges`.
Source: Kroeger, Neubauer, Popp, Phil. Trans. R. Soc. A 366 (2008) 785, figure 29: 3.4 kHz +- 17 Hz with the period of
the turn (depth derived).
"""

from __future__ import annotations

import math
from typing import Annotated, Any, ClassVar

from annotated_types import Ge, Gt, Le, Lt

from rig.about import About
from rig.model.assembly import Assembly, Output
from rig.model.named_rows import Row
from rig.quantities import Section, quantity

TURN = "disc.turn"
_PERIOD = 2.0 * math.pi

Depth: Any = quantity("1", Gt(0.0), Lt(0.5))
Place: Any = quantity("rad", Ge(0.0), Lt(_PERIOD))
Count = Annotated[int, Ge(4), Le(96)]


class Inhomogeneity(Section):
    """Share by which the scale swings, into how many sectors the disc is cut, and theta at the start."""

    declares: ClassVar = About("stiffness that swings with the turn of the disc")

    depth: Depth
    sectors: Count = 24
    place: Place = 0.0


def add(a: Assembly, inhomogeneity: Inhomogeneity, speed: Row) -> None:
    """Add the disc's turn, `speed` [rad/s], and let the structure as it is now vary with it; the output `place`."""
    count = inhomogeneity.sectors
    scales = [1.0 + inhomogeneity.depth * math.cos(_PERIOD * (i + 0.5) / count) for i in range(count)]
    a.signal(TURN, speed, inhomogeneity.place, "inhomogeneity")
    a.vary("disc", {TURN: 1.0}, TURN, _PERIOD, tuple((scale**2, scale) for scale in scales))
    a.outputs["place"] = Output({TURN: 1.0}, "rad")
