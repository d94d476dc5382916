"""A tread block of a tyre on a plate: its tip moves along the plate (x) and normal to it (z), and may lift off.

    m x'' + d_x x' + c_x x - c_xz z = T
    m z'' + d_z z' + c_z z - c_xz x = N - P          z away from the plate
    N = -c_c z, not below zero;   w = V - x'

Rubber keeps its volume, so a tangential deformation at a rounded edge also moves the tip along the normal: c_xz. With
constant friction the tip flutters where mu c_c > c_xz > 0. A rough surface has no such coupling: its asperities bend
at constant normal force.
Source: Kroeger, Neubauer, Popp, Phil. Trans. R. Soc. A 366 (2008) 785, section 3b, figures 11 to 14. The paper gives no
equations; the model is derived and its numbers are calibrated here.
"""

from __future__ import annotations

from collections.abc import Mapping

from rig.effects import drive, load
from rig.effects.drive import BeltDrive
from rig.effects.load import Load
from rig.effects.noise import Noisy
from rig.laws import Friction
from rig.model.assembly import Assembly, Output
from rig.picture import OnBelt, Plot
from rig.plants.belt import RAMPED, contact_outputs
from rig.quantities import (
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
    "drive.speed": Hand("speed of the glass"),
    "load.force": Hand("normal force"),
    "friction.mu": Hand("coefficient of friction"),
    "tip.tangential_damping": Hand("damping along the glass"),
}
PICTURES = (OnBelt(up="height", lifted=True),)


class Tip(Section):
    """The tip of the block: mass, springs and dampers along (x) and normal to (z) the plate, coupling c_xz."""

    mass: Kilogram
    tangential_stiffness: NonNegativeNewtonPerMetre
    tangential_damping: NewtonSecondPerMetre = 0.0
    normal_stiffness: NonNegativeNewtonPerMetre = 0.0
    normal_damping: NewtonSecondPerMetre = 0.0
    coupling: NonNegativeNewtonPerMetre = 0.0


class Contact(Section):
    """The stiffness of the rubber at the contact [N/m]."""

    stiffness: NewtonPerMetre


class Start(Section):
    """Position and velocity of the tip at the start; zero: unloaded block just touching the plate."""

    displacement: Metre = 0.0
    velocity: MetrePerSecond = 0.0
    height: Metre = 0.0
    height_velocity: MetrePerSecond = 0.0


class Parameters(Noisy):
    """The tables of a tread scene. `load`: the preload P; `drive`: the speed of the plate."""

    tip: Tip
    contact: Contact
    drive: BeltDrive
    load: Load
    friction: Friction
    start: Start = Start()


def assemble(p: Parameters, moved: Mapping[str, str] = RAMPED) -> Assembly:
    """Assemble the rig. `moved`: actuators that a scene commands ("held") or ramps ("ramped"); others are constant."""
    a = Assembly(title="tread")
    a.coordinate("x", p.tip.mass, p.tip.tangential_damping, p.tip.tangential_stiffness)
    a.coordinate("z", p.tip.mass, p.tip.normal_damping, p.tip.normal_stiffness)
    a.stiffness["x", "z"] = a.stiffness["z", "x"] = -p.tip.coupling
    a.start |= {"x": p.start.displacement, "x'": p.start.velocity, "z": p.start.height, "z'": p.start.height_velocity}
    a.push("z", {name: -value for name, value in load.add(a, p.load, moved).items()})
    a.patch("contact", {"x": 1.0}, drive.add(a, p.drive, "m/s", moved), p.friction.friction())
    a.normal("load", "contact", {"z": -p.contact.stiffness}, {"z": 1.0})
    a.outputs |= contact_outputs({"x": 1.0}, a)
    a.outputs |= {"height": Output({"z": 1.0}, "m", Plot()), "height_velocity": Output({"z'": 1.0}, "m/s", Plot())}
    return a
