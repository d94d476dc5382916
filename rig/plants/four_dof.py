"""Three bodies on a belt: mode coupling with four degrees of freedom.

    m1 u1'' + (k1 + k2) u1 - k2 u2                        = 0           u along the belt
    m3 v3'' + (k4 + k5) v3 - k4 v2                        = 0           v away from it
    m2 u2'' + (k2 + k3 c^2) u2 - k2 u1 + k3 c s v2        = T           c, s: cosine and sine of the angle of spring 3
    m2 v2'' + (k4 + k3 s^2) v2 - k4 v3 + k3 c s u2        = N - F0
    N = -kc v2,   w = V - u2'

Body 2 slides on the belt under the preload F0. v2 is zero where the contact spring is unloaded. In forward sliding
T = mu N = -mu kc v2: this adds mu kc to the stiffness matrix in row u2, column v2, and only there. With spring 3 at 135
degrees and no damping these are the matrices of equation 1. Each spring may have a damper.

With the values of the paper, W = omega^2 and h = 200 - W - 10000 / (200 - W), the eigenvalues are given by

    h^2 = 5000 (1 - mu)

At mu = 1 two pairs of modes coalesce at once, at 10 and 17.3205 rad/s. Above, the rig flutters.
Source: "A new mechanism for friction-induced vibration and noise", section 3.1, equations 1 and 2, figures 5 and 6.
"""

from __future__ import annotations

import math
from collections.abc import Mapping

from rig.effects import drive, load
from rig.effects.drive import BeltDrive
from rig.effects.load import Load
from rig.effects.noise import Noisy
from rig.effects.separation import Separation
from rig.laws import Friction
from rig.model.assembly import Assembly, Output
from rig.picture import Own, Plot
from rig.plants.belt import RAMPED, contact_outputs
from rig.plants.two_dof import Body, Contact, Strut
from rig.quantities import Hand, Metre, MetrePerSecond, NewtonSecondPerMetre, NonNegativeNewtonPerMetre, Section

HANDS = {
    "friction.mu": Hand("coefficient of friction"),
    "drive.speed": Hand("belt speed"),
    "load.force": Hand("normal force"),
    "spring_3.angle": Hand("angle of the inclined spring", 0.3, 1.5),
}
PICTURES = (Own("rig.view.four_dof:ThreeBodies", ("body_1_displacement", "body_3_height")),)


class Spring(Section):
    """A spring and a parallel damper, along the belt or across it."""

    stiffness: NonNegativeNewtonPerMetre
    damping: NewtonSecondPerMetre = 0.0


class Start(Section):
    """Position and velocity of body 2 at the start, from the unloaded springs; bodies 1 and 3 are at rest."""

    displacement: Metre = 0.0
    velocity: MetrePerSecond = 0.0
    height: Metre = 0.0
    height_velocity: MetrePerSecond = 0.0
    body_1_displacement: Metre = 0.0
    body_3_height: Metre = 0.0


class Parameters(Noisy):
    """The tables of a four_dof scene. `load`: the preload F0 on body 2.

    Body 1 moves along the belt, body 3 across it, body 2 in both directions. Spring 1 connects frame and body 1, spring
    2 bodies 1 and 2, spring 3 frame and body 2 at an angle to the belt's direction, spring 4 bodies 2 and 3, spring 5
    body 3 and frame.
    """

    body_1: Body
    body_2: Body
    body_3: Body
    spring_1: Spring
    spring_2: Spring
    spring_3: Strut
    spring_4: Spring
    spring_5: Spring
    contact: Contact
    drive: BeltDrive
    load: Load
    friction: Friction
    separation: Separation | None = None
    start: Start = Start()


def assemble(p: Parameters, moved: Mapping[str, str] = RAMPED) -> Assembly:
    """Assemble the rig. `moved`: actuators that a scene commands ("held") or ramps ("ramped"); others are constant."""
    a = Assembly(title="four_dof")
    for name, body in {"u1": p.body_1, "v3": p.body_3, "u2": p.body_2, "v2": p.body_2}.items():
        a.coordinate(name, body.mass)
    angle = p.spring_3.angle
    start = p.start
    for spring, extension in (
        (p.spring_1, {"u1": 1.0}),
        (p.spring_2, {"u1": -1.0, "u2": 1.0}),
        (p.spring_3, {"u2": math.cos(angle), "v2": math.sin(angle)}),
        (p.spring_4, {"v3": 1.0, "v2": -1.0}),
        (p.spring_5, {"v3": 1.0}),
    ):
        a.spring(extension, spring.stiffness, spring.damping)
    a.start |= {"u1": start.body_1_displacement, "v3": start.body_3_height}
    a.start |= {"u2": start.displacement, "u2'": start.velocity, "v2": start.height, "v2'": start.height_velocity}
    a.push("v2", {name: -value for name, value in load.add(a, p.load, moved).items()})
    a.patch("contact", {"u2": 1.0}, drive.add(a, p.drive, "m/s", moved), p.friction.friction())
    a.normal("load", "contact", {"v2": -p.contact.stiffness}, {"v2": 1.0}, opens=p.separation is not None)
    a.outputs |= contact_outputs({"u2": 1.0}, a)
    a.outputs |= {"height": Output({"v2": 1.0}, "m", Plot()), "height_velocity": Output({"v2'": 1.0}, "m/s", Plot())}
    a.outputs |= {
        "body_1_displacement": Output({"u1": 1.0}, "m", Plot()),
        "body_3_height": Output({"v3": 1.0}, "m", Plot()),
    }
    return a
