"""A mass on a belt, held by two inclined spring-dampers: mode coupling. Two degrees of freedom.

    m x'' + C11 x' + C12 y' + K11 x + K12 y      = T                   x along the belt
    m y'' + C12 x' + C22 y' + K12 x + (K22-k3) y = N - F0              y away from it
    N = -k3 y,   w = V - x'
    K11 = sum k_i cos^2 a_i,  K12 = sum k_i sin a_i cos a_i,  K22 = sum k_i sin^2 a_i + k3,  C alike with c_i, no k3

Friction changes K12 to K12 + mu k3 in the first row only. With K12 < 0 the frequencies of the two modes approach each
other as mu rises, and the rig flutters.
Source: Liu and Ouyang, Meccanica 55 (2020), section 2, equations 1 to 4.
"""

from __future__ import annotations

import math
from collections.abc import Mapping

from rig.effects import dither, drive, load, piezo
from rig.effects.dither import TangentialDither
from rig.effects.drive import BeltDrive
from rig.effects.load import Load
from rig.effects.piezo import WithStack
from rig.effects.separation import Separation
from rig.laws import Friction
from rig.model.assembly import Assembly, Output
from rig.picture import OnBelt, Plot
from rig.plants.belt import RAMPED, contact_outputs
from rig.quantities import (
    Angle,
    Hand,
    Kilogram,
    Metre,
    MetrePerSecond,
    NewtonPerMetre,
    NewtonSecondPerMetre,
    NonNegativeNewtonPerMetre,
    Section,
)

HANDS = {
    "friction.mu": Hand("coefficient of friction"),
    "drive.speed": Hand("belt speed"),
    "load.force": Hand("normal force"),
    "spring_1.angle": Hand("angle of the first spring", 0.3, 1.4),
    "spring_1.damping": Hand("damping of the first spring", 0.0, 25.0),
}
PICTURES = (OnBelt(up="height", lifted=True),)


class Body(Section):
    """The mass."""

    mass: Kilogram


class Strut(Section):
    """A spring and a parallel damper, at an angle to the belt's direction."""

    stiffness: NonNegativeNewtonPerMetre
    damping: NewtonSecondPerMetre = 0.0
    angle: Angle


class Contact(Section):
    """The contact spring between mass and belt."""

    stiffness: NewtonPerMetre


class Start(Section):
    """Position and velocity of the mass at the start; zero: unloaded springs, mass just touching the belt."""

    displacement: Metre = 0.0
    velocity: MetrePerSecond = 0.0
    height: Metre = 0.0
    height_velocity: MetrePerSecond = 0.0


class Parameters(WithStack):
    """The tables of a two_dof scene. `load`: the preload F0. A piezo stack acts in parallel to the first spring."""

    body: Body
    spring_1: Strut
    spring_2: Strut
    contact: Contact
    drive: BeltDrive
    load: Load
    friction: Friction
    separation: Separation | None = None
    dither: TangentialDither | None = None
    start: Start = Start()


def assemble(p: Parameters, moved: Mapping[str, str] = RAMPED) -> Assembly:
    """Assemble the rig. `moved`: actuators that a scene commands ("held") or ramps ("ramped"); others are constant."""
    a = Assembly(title="two_dof")
    a.coordinate("x", p.body.mass)
    a.coordinate("y", p.body.mass)
    for strut in (p.spring_1, p.spring_2):
        a.spring({"x": math.cos(strut.angle), "y": math.sin(strut.angle)}, strut.stiffness, strut.damping)
    a.start |= {"x": p.start.displacement, "x'": p.start.velocity, "y": p.start.height, "y'": p.start.height_velocity}
    a.push("y", {name: -value for name, value in load.add(a, p.load, moved).items()})
    a.patch("contact", {"x": 1.0}, drive.add(a, p.drive, "m/s", moved), p.friction.friction())
    a.normal("load", "contact", {"y": -p.contact.stiffness}, {"y": 1.0}, opens=p.separation is not None)
    if p.dither is not None:
        dither.add(a, p.dither, "contact", "load", "x")
    piezo.add(a, p, {"x": math.cos(p.spring_1.angle), "y": math.sin(p.spring_1.angle)}, moved)
    a.outputs |= contact_outputs({"x": 1.0}, a)
    a.outputs |= {"height": Output({"y": 1.0}, "m", Plot()), "height_velocity": Output({"y'": 1.0}, "m/s", Plot())}
    return a
