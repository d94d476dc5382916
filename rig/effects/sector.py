"""A sector of the disc with its own friction law, for example sandblasted. Absent: the disc has one friction law.

    psi = Int Omega dt - r2 phi / rd  (mod 2 pi)       the sector's law where 0 <= psi < span, else the contact's own

psi is the angular position of the pin on the disc. It is constant while the pin sticks, so the pin reaches an edge only
in slip. The edges are events.
Source: Liu and Ouyang, Mechanical Systems and Signal Processing (2022), the disc with two interfaces.
"""

from __future__ import annotations

import math
from typing import Any, ClassVar

from annotated_types import Ge, Gt, Lt

from rig.about import About
from rig.laws import Friction
from rig.model.assembly import Assembly, Output
from rig.model.named_rows import Row
from rig.picture import Plot
from rig.quantities import Section, quantity

TURN = "disc.turn"
_PERIOD = 2.0 * math.pi

Span: Any = quantity("rad", Gt(0.0), Lt(_PERIOD))
Place: Any = quantity("rad", Ge(0.0), Lt(_PERIOD))


class Sector(Section):
    """Span [rad] and friction law of the sector; position of the pin at the start [rad], from its first edge."""

    declares: ClassVar = About("a part of the disc with its own friction law")

    span: Span
    friction: Friction
    place: Place = 0.0


def add(a: Assembly, sector: Sector, patch: str, speed: Row, back: Row) -> None:
    """Add the angle of the disc, and the sector to the contact `patch`.

    `speed`: speed of the disc [rad/s]; `back`: angle of the pin's own motion over the disc. Output: `place`, psi [rad].
    """
    own = next(entry[3] for entry in a.patches if entry[0] == patch)
    a.signal(TURN, speed, sector.place, "sector")
    place = {TURN: 1.0, **back}
    a.sector("disc", patch, place, TURN, _PERIOD, (0.0, sector.span), (sector.friction.friction(), own))
    a.outputs["place"] = Output(place, "rad", Plot())
