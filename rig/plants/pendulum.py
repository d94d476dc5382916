"""A pendulum that rubs on a rotating disc: the rig of the papers, with the angle phi as coordinate.

    J phi'' + d_phi phi' + c_phi phi = r T,   w = r Omega - r phi'

With x = r phi it is equivalent to the mass on a belt with m = J/r^2, c = c_phi/r^2, d = d_phi/r^2, for any radius r.
Instruments can read the angle and the quantities at the contact.
Source: Kroeger, Neubauer, Popp, Phil. Trans. R. Soc. A 366 (2008) 785, sections 2 and 4.
"""

from __future__ import annotations

from collections.abc import Mapping

from rig.effects import dither, drive, load, piezo, tuned_mass
from rig.effects.dither import Dither
from rig.effects.drive import DiscDrive
from rig.effects.load import Load
from rig.effects.piezo import WithStack
from rig.effects.tuned_mass import TunedMass
from rig.laws import Friction
from rig.model.assembly import Assembly, Output
from rig.picture import OnDisc
from rig.plants.belt import RAMPED, Start, contact_outputs
from rig.quantities import (
    Hand,
    KilogramSquareMetre,
    NewtonMetreSecondPerRadian,
    NonNegativeNewtonMetrePerRadian,
    PositiveMetre,
    Section,
)

HANDS = {
    "drive.speed": Hand("disc speed", 0.0, 6.0),
    "load.force": Hand("normal force"),
    "friction.mu_static": Hand("friction coefficient at rest"),
    "friction.mu_dynamic": Hand("friction coefficient in motion", 0.0, 4.0),
    "body.damping": Hand("damping", 0.0, 25.0),
}
PICTURES = (OnDisc(),)


class Body(Section):
    """The pendulum: radius of the contact, moment of inertia, rotational spring and damper."""

    radius: PositiveMetre
    inertia: KilogramSquareMetre
    stiffness: NonNegativeNewtonMetrePerRadian
    damping: NewtonMetreSecondPerRadian = 0.0


class Parameters(WithStack):
    """The tables of a pendulum scene. `start` is stated at the contact point, where a piezo stack may act."""

    body: Body
    drive: DiscDrive
    load: Load
    friction: Friction
    dither: Dither | None = None
    tuned_mass: TunedMass | None = None
    start: Start = Start()


def assemble(p: Parameters, moved: Mapping[str, str] = RAMPED) -> Assembly:
    """Assemble the rig. `moved`: actuators that a scene commands ("held") or ramps ("ramped"); others are constant."""
    r = p.body.radius
    a = Assembly(title="pendulum")
    a.coordinate("angle", p.body.inertia, p.body.damping, p.body.stiffness)
    a.start |= {"angle": p.start.displacement / r, "angle'": p.start.velocity / r}
    disc = drive.add(a, p.drive, "rad/s", moved)
    surface = {name: r * coefficient for name, coefficient in disc.items()}
    a.patch("contact", {"angle": r}, surface, p.friction.friction())
    a.normal("load", "contact", load.add(a, p.load, moved))
    if p.dither is not None:
        dither.add(a, p.dither, "contact", "load", "angle", arm=r)
    if p.tuned_mass is not None:
        tuned_mass.add(a, p.tuned_mass, "load", "angle", arm=r)
    piezo.add(a, p, {"angle": r}, moved)
    a.outputs |= contact_outputs({"angle": r}, a)
    a.outputs |= {
        "angle": Output({"angle": 1.0}, "rad"),
        "angular_velocity": Output({"angle'": 1.0}, "rad/s"),
        "disc_speed": Output(disc, "rad/s", role="drive"),
    }
    return a
