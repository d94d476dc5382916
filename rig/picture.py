"""What is to be drawn of a plant, in plain data. The plant declares it, `rig.view` draws it.

A plant's module lists its pictures; the first one whose outputs the rig has is drawn:

    PICTURES = (OnBelt(up="height", lifted=True),)

Without any, a viewer shows curves and the strip of contact modes, and no picture. Every picture shows the friction and
the normal force as arrows, and the body in the colour of its contact mode. Motions are magnified by a round number.
"""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class OnBelt:
    """A body on a running belt, a spring from it to a wall, seen from the side.

    `along`, `up` [m], `turn` [rad]: outputs that move the body along the belt, away from it, and about the axis across;
    "" where it does not move so. `lifted`: it stands on a contact spring, seen as a gap; across the belt, where the
    preload alone presses far in, a quarter of the magnification is drawn. `lean` [rad]: a rod that leans against the
    motion of the surface, in place of a block. `surface`: output, speed of the belt [m/s].
    """

    along: str = "displacement"
    up: str = ""
    turn: str = ""
    lifted: bool = False
    lean: float = 0.0
    surface: str = "surface_speed"
    friction: str = "friction_force"
    normal: str = "normal_force"

    @property
    def outputs(self) -> tuple[str, ...]:
        """Outputs that it is drawn from."""
        return tuple(filter(None, (self.along, self.up, self.turn, self.surface, self.friction, self.normal)))


@dataclass(frozen=True)
class OnDisc:
    """A body at the end of an arm over a rotating disc, a spring from the arm to a post.

    `angle` [rad], `surface` [rad/s]: outputs that turn the arm and the disc, about one axis.
    """

    angle: str = "angle"
    surface: str = "disc_speed"
    friction: str = "friction_force"
    normal: str = "normal_force"

    @property
    def outputs(self) -> tuple[str, ...]:
        """Outputs that it is drawn from."""
        return self.angle, self.surface, self.friction, self.normal


@dataclass(frozen=True)
class Own:
    """A picture of its own: `drawer`, a `rig.view.base.Picture` as "module:class". `outputs`: what it is drawn from."""

    drawer: str
    outputs: tuple[str, ...]


Picture = OnBelt | OnDisc | Own
