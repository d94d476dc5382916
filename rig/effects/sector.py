"""A sector of the disc with a friction of its own, e.g. sandblasted; absent: the disc is alike all round.

    psi = Int Omega dt - r2 phi / rd  (mod 2 pi)       the sector's law where 0 <= psi < span, else the contact's own

psi is the place under the pin on the disc. It stands still while the pin sticks, so an edge is only met in slip; the
edges are events.
Source: Liu and Ouyang, Mechanical Systems and Signal Processing (2022), the disc with two interfaces.
"""

from __future__ import annotations

import math
from typing import Any, ClassVar

from annotated_types import Ge, Gt, Lt

from rig.about import About
from rig.effects.friction import Friction
from rig.model.assembly import Assembly, Output
from rig.model.named_rows import Row
from rig.quantities import Section, quantity

TURN = "disc.turn"
_PERIOD = 2.0 * math.pi

Span: Any = quantity("rad", Gt(0.0), Lt(_PERIOD))
Place: Any = quantity("rad", Ge(0.0), Lt(_PERIOD))


class Sector(Section):
    """Its span, its friction, and the place under the pin at the start, counted from the sector's first edge."""

    declares: ClassVar = About("a part of the disc with a friction of its own")

    span: Span
    friction: Friction
    place: Place = 0.0


def add(a: Assembly, sector: Sector, patch: str, speed: Row, back: Row) -> None:
    """Add the disc's turn and the sector to `patch`. `speed`: of the disc [rad/s]; `back`: the pin's own way on it.

    The output `place` tells psi [rad].
    """
    own = next(entry[3] for entry in a.patches if entry[0] == patch)
    a.signal(TURN, speed, sector.place, "sector")
    place = {TURN: 1.0, **back}
    a.sector("disc", patch, place, TURN, _PERIOD, (0.0, sector.span), (sector.friction.friction(), own))
    a.outputs["place"] = Output(place, "rad")
