"""An inclined pin on a disc whose geometry couples normal force and motion. One degree of freedom, q along the pin.

    m2 q'' + d2 q' + c2 q = N sin(gamma) - T cos(gamma),   w = V + cos(gamma) q'
    N = F - (m1 y'' + d1 y' + c1 y),   y = q sin(gamma)

While the disc (m1, d1, c1) touches the pin, both move together: with k = sin(gamma) (sin(gamma) - mu cos(gamma))

    (m2 + m1 k) q'' + (d2 + d1 k) q' + (c2 + c1 k) q = (sin(gamma) - mu cos(gamma)) F

and friction can cancel damping, mass and stiffness. The pin jams where the effective mass is zero. After lift-off
(N = 0) the pin moves alone, until N computed with the disc following it would be positive again.
Source: Kroeger, Neubauer, Popp, Phil. Trans. R. Soc. A 366 (2008) 785, section 2, figure 6, equation 2.3.
"""

from __future__ import annotations

import math
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
    AcuteAngle,
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
    "friction.mu": Hand("coefficient of friction", 0.0, 1.3),
    "drive.speed": Hand("disc speed"),
    "load.force": Hand("normal force"),
    "pin.tilt": Hand("tilt of the pin", 0.1, 2.0),
    "pin.damping": Hand("damping of the pin"),
}
PICTURES = (OnBelt(up="disc_displacement", lean=0.35),)


class Pin(Section):
    """The pin: mass, spring and damper along its axis, and the angle between axis and disc."""

    mass: Kilogram
    stiffness: NonNegativeNewtonPerMetre
    damping: NewtonSecondPerMetre = 0.0
    tilt: AcuteAngle


class Disc(Section):
    """The disc at the pin: mass, spring and damper normal to its plane."""

    mass: Kilogram
    stiffness: NewtonPerMetre
    damping: NewtonSecondPerMetre = 0.0


class Start(Section):
    """Position and velocity of the pin along its axis at the start; zero: unloaded springs."""

    displacement: Metre = 0.0
    velocity: MetrePerSecond = 0.0


class Parameters(Noisy):
    """The tables of a pin scene. `drive`: speed of the surface at the pin; `load`: preload F."""

    pin: Pin
    disc: Disc
    drive: BeltDrive
    load: Load
    friction: Friction
    start: Start = Start()


def assemble(p: Parameters, moved: Mapping[str, str] = RAMPED) -> Assembly:
    """Assemble the rig. `moved`: actuators that a scene commands ("held") or ramps ("ramped"); others are constant."""
    across = math.sin(p.pin.tilt)
    along = math.cos(p.pin.tilt)
    a = Assembly(title="pin")
    a.coordinate("q", p.pin.mass, p.pin.damping, p.pin.stiffness)
    a.start |= {"q": p.start.displacement, "q'": p.start.velocity}
    a.patch("contact", {"q": -along}, drive.add(a, p.drive, "m/s", moved), p.friction.friction())
    pressed = load.add(a, p.load, moved) | {"q": -p.disc.stiffness * across, "q'": -p.disc.damping * across}
    a.normal("load", "contact", pressed, {"q": across}, {"q": -p.disc.mass * across})
    a.outputs |= contact_outputs({"q": -along}, a)
    a.outputs |= {
        "pin_displacement": Output({"q": 1.0}, "m", Plot()),
        "pin_velocity": Output({"q'": 1.0}, "m/s", Plot()),
        "disc_displacement": Output({"q": across}, "m", Plot()),
    }
    a.limits = limits(p)
    return a


def limits(p: Parameters) -> dict[str, float]:
    """Coefficients of friction at which damping (equation 2.3), mass and stiffness vanish; the smallest is critical.

    Beyond "damping" vibration grows; beyond "mass" the pin jams; beyond "stiffness" it digs in.
    """
    sine = math.sin(p.pin.tilt)
    cosine = math.cos(p.pin.tilt)

    def limit(pin: float, disc: float) -> float:
        """The mu at which pin + disc k = 0."""
        return (pin / disc + sine**2) / (sine * cosine) if disc else math.inf

    return {
        "damping": limit(p.pin.damping, p.disc.damping),
        "mass": limit(p.pin.mass, p.disc.mass),
        "stiffness": limit(p.pin.stiffness, p.disc.stiffness),
    }
