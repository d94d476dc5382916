"""A mass on a moving belt: the classical stick-slip rig with one degree of freedom.

    m x'' + d x' + c x = T,   w = V - x',   T = mu(|w|) N sgn(w) in slip

Source: Kroeger, Neubauer, Popp, Phil. Trans. R. Soc. A 366 (2008) 785, section 2, equation 2.1.
"""

from __future__ import annotations

from collections.abc import Mapping

from rig.effects import dither, drive, load, piezo, tuned_mass
from rig.effects.dither import Dither
from rig.effects.drive import BeltDrive
from rig.effects.load import Load
from rig.effects.piezo import WithStack
from rig.effects.tuned_mass import TunedMass
from rig.laws import Friction
from rig.model.assembly import Assembly, Output
from rig.picture import OnBelt, Plot
from rig.quantities import (
    Hand,
    Kilogram,
    Metre,
    MetrePerSecond,
    NewtonSecondPerMetre,
    NonNegativeNewtonPerMetre,
    Section,
)

HANDS = {
    "drive.speed": Hand("belt speed", 0.0, 6.0),
    "load.force": Hand("normal force"),
    "friction.mu_static": Hand("friction coefficient at rest"),
    "body.stiffness": Hand("stiffness of the spring", 0.3, 2.0),
    "body.damping": Hand("damping", 0.0, 25.0),
    "dither.amplitude": Hand("dither amplitude"),
}
PICTURES = (OnBelt(),)
RAMPED = {"drive.speed": "ramped", "load.force": "ramped"}


class Body(Section):
    """The mass, its spring and its damper."""

    mass: Kilogram
    stiffness: NonNegativeNewtonPerMetre
    damping: NewtonSecondPerMetre = 0.0


class Start(Section):
    """Displacement [m] and velocity [m/s] of the mass at the start; zero: unloaded spring."""

    displacement: Metre = 0.0
    velocity: MetrePerSecond = 0.0


class Parameters(WithStack):
    """The tables of a belt scene. A piezo stack acts in parallel to the spring."""

    body: Body
    drive: BeltDrive
    load: Load
    friction: Friction
    dither: Dither | None = None
    tuned_mass: TunedMass | None = None
    start: Start = Start()


def assemble(p: Parameters, moved: Mapping[str, str] = RAMPED) -> Assembly:
    """Assemble the rig. `moved`: actuators that a scene commands ("held") or ramps ("ramped"); others are constant."""
    a = Assembly(title="belt")
    a.coordinate("x", p.body.mass, p.body.damping, p.body.stiffness)
    a.start |= {"x": p.start.displacement, "x'": p.start.velocity}
    a.patch("contact", {"x": 1.0}, drive.add(a, p.drive, "m/s", moved), p.friction.friction())
    a.normal("load", "contact", load.add(a, p.load, moved))
    if p.dither is not None:
        dither.add(a, p.dither, "contact", "load", "x")
    if p.tuned_mass is not None:
        tuned_mass.add(a, p.tuned_mass, "load", "x")
    piezo.add(a, p, {"x": 1.0}, moved)
    a.outputs |= contact_outputs({"x": 1.0}, a)
    return a


def contact_outputs(along: dict[str, float], a: Assembly) -> dict[str, Output]:
    """The outputs at the contact. `along`: displacement of the contact [m] as a row over the coordinates."""
    return {
        "displacement": Output(along, "m", role="displacement"),
        "velocity": Output({f"{c}'": f for c, f in along.items()}, "m/s", role="velocity"),
        "acceleration": Output({f"{c}''": f for c, f in along.items()}, "m/s^2"),
        "friction_force": Output({"T:contact": 1.0}, "N"),
        "normal_force": Output({"N:load": 1.0}, "N"),
        "slip_speed": Output({"w:contact": 1.0}, "m/s", Plot()),
        "surface_speed": Output(dict(a.surface("contact")), "m/s", role="drive"),
    }
