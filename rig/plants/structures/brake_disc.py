"""A bending brake disc: modes of a free annular plate replace the axial motion and the tilt of a rigid disc.

    u_z = w(theta) = sum R(r) (C cos l theta + S sin l theta),   u_x = x - b dw / (r dtheta),   theta = a / r

for the point at the distance a along the circle on which the pads rub and b from the middle plane. For a rigid disc
these are z - a phi and x + b phi. The springs of a rigid disc along z and phi represent bending and are not used here.
At the speeds of a braking disc (l Omega of a few rad/s) the effect of the rotation on a pair of modes is far below its
damping and is neglected.
Source: rig.effects.disc_modes; slope as in Liu and Ouyang, Meccanica 55 (2020), section 3; derived.
"""

from __future__ import annotations

import math

from rig.effects.disc_modes import Disc, Mode, free_modes
from rig.model.named_rows import Row
from rig.plants.structures.multibody import Body


class Bending(Body):
    """A bending disc: its mass along x, its points; deflection of `disc` at `radius` [m]."""

    disc: Disc
    radius: float

    def coordinates(self, name: str) -> dict[str, tuple[float, float, float]]:
        """See `Body.coordinates`."""
        modes = [(part, mode.omega) for mode in free_modes(self.disc) for part in _names(name, mode)]
        bends = {part: (1.0, 2.0 * self.disc.damping_ratio * omega, omega**2) for part, omega in modes}
        return {f"{name}.x": (self.mass, 0.0, 0.0)} | bends

    def row(self, name: str, a: float, b: float, direction: str) -> Row:
        """See `Body.row`."""
        row: Row = {f"{name}.x": 1.0} if direction == "x" else {}
        for mode in free_modes(self.disc):
            l, deflection = mode.diameters, mode.at(self.radius)
            turn = l * a / self.radius
            shapes = (math.cos(turn), math.sin(turn))
            slopes = (-l * math.sin(turn) / self.radius, l * math.cos(turn) / self.radius)
            for part, shape, slope in zip(_names(name, mode), shapes, slopes):
                row[part] = deflection * (shape if direction == "z" else -b * slope if direction == "x" else -slope)
        return row

    def acts_on(self, point: str, direction: str) -> bool:
        """See `Body.acts_on`."""
        return bool(point) or direction == "x"


def _names(name: str, mode: Mode) -> tuple[str, ...]:
    which = f"{mode.diameters}.{mode.circles}" if mode.circles else f"{mode.diameters}"
    return (f"{name}.C{which}", f"{name}.S{which}") if mode.pair else (f"{name}.C{which}",)
