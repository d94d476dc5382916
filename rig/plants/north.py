"""North's model of non-conservative restoring forces: a body that moves towards a rubbing surface and tilts.

    m x'' + d1 x' + c1 x = F - N                       x towards the surface, phi tilt of the body
    J phi'' + d_phi phi' + c_phi phi = s (N - F) - h T
    N = F + c2 (x - s phi),   w = V + h phi'

The lining (c2) presses at a distance s from the centre; friction acts on it with the lever h. F is balanced at rest.
With T = mu N the stiffness matrix of sliding is that of equation 2.4,

    K = [[c1 + c2, -c2 s], [c2 (mu h - s), c_phi + s c2 (s - mu h)]]

which is not symmetric: the body may flutter, or lose its stiffness and tip over (divergence). The paper's critical
coefficient, equation 2.5, is that of divergence, det K = 0; beyond it no sliding equilibrium has a positive load.
Source: Kroeger, Neubauer, Popp, Phil. Trans. R. Soc. A 366 (2008) 785, section 2, figure 7; North (1972).
"""

from __future__ import annotations

import math
from collections.abc import Mapping

import numpy as np

from rig.effects import drive, load
from rig.effects.drive import BeltDrive
from rig.effects.load import Load
from rig.effects.noise import Noisy
from rig.laws import Friction
from rig.model.assembly import Assembly, Output
from rig.picture import Own, Plot
from rig.plants.belt import RAMPED, contact_outputs
from rig.quantities import (
    Angle,
    Hand,
    Kilogram,
    KilogramSquareMetre,
    Metre,
    MetrePerSecond,
    NewtonMetreSecondPerRadian,
    NewtonPerMetre,
    NewtonSecondPerMetre,
    NonNegativeNewtonMetrePerRadian,
    NonNegativeNewtonPerMetre,
    PositiveMetre,
    RadianPerSecond,
    Section,
)

HANDS = {
    "friction.mu": Hand("coefficient of friction"),
    "drive.speed": Hand("disc speed"),
    "load.force": Hand("normal force"),
    "body.tilt_damping": Hand("damping of the tilt", 0.0, 200.0),
    "lining.offset": Hand("offset of the lining"),
}
PICTURES = (Own("rig.view.belt:Tilting", ("displacement", "tilt", "surface_speed")),)


class Body(Section):
    """The body: mass, spring and damper across its faces (c1, d1), the same for its tilt (c_phi, d_phi)."""

    mass: Kilogram
    stiffness: NonNegativeNewtonPerMetre
    damping: NewtonSecondPerMetre = 0.0
    inertia: KilogramSquareMetre
    tilt_stiffness: NonNegativeNewtonMetrePerRadian
    tilt_damping: NewtonMetreSecondPerRadian = 0.0


class Lining(Section):
    """The lining: stiffness c2, lever arm h of friction, distance s of the normal force from the centre."""

    stiffness: NewtonPerMetre
    lever: PositiveMetre
    offset: Metre


class Start(Section):
    """Position and velocity of the body at the start; zero: the preload is balanced without friction."""

    displacement: Metre = 0.0
    velocity: MetrePerSecond = 0.0
    tilt: Angle = 0.0
    tilt_velocity: RadianPerSecond = 0.0


class Parameters(Noisy):
    """The tables of a scene of North's model. `load`: the preload F; `drive`: speed of the surface."""

    body: Body
    lining: Lining
    drive: BeltDrive
    load: Load
    friction: Friction
    start: Start = Start()


def assemble(p: Parameters, moved: Mapping[str, str] = RAMPED) -> Assembly:
    """Assemble the rig. `moved`: actuators that a scene commands ("held") or ramps ("ramped"); others are constant."""
    c2 = p.lining.stiffness
    h = p.lining.lever
    s = p.lining.offset
    a = Assembly(title="north")
    a.coordinate("x", p.body.mass, p.body.damping, p.body.stiffness)
    a.coordinate("tilt", p.body.inertia, p.body.tilt_damping, p.body.tilt_stiffness)
    a.start |= {"x": p.start.displacement, "x'": p.start.velocity}
    a.start |= {"tilt": p.start.tilt, "tilt'": p.start.tilt_velocity}
    preload = load.add(a, p.load, moved)
    a.push("x", preload)
    a.push("tilt", {name: -s * value for name, value in preload.items()})
    a.patch("contact", {"tilt": -h}, drive.add(a, p.drive, "m/s", moved), p.friction.friction())
    a.normal("load", "contact", preload | {"x": c2, "tilt": -c2 * s}, {"x": -1.0, "tilt": s})
    a.outputs |= contact_outputs({"x": 1.0}, a)
    a.outputs |= {
        "tilt": Output({"tilt": 1.0}, "rad", Plot()),
        "tilt_velocity": Output({"tilt'": 1.0}, "rad/s", Plot()),
    }
    a.limits = limits(p)
    return a


def limits(p: Parameters) -> dict[str, float]:
    """Coefficients of friction at which the body begins to flutter and to tip over; infinite if it never does.

    flutter      least mu > 0 with Hurwitz's determinant a1 a2 a3 - a3^2 a0 - a4 a1^2 = 0
    divergence   det K = 0, equation 2.5
    """
    body = p.body
    c2 = p.lining.stiffness
    h = p.lining.lever
    s = p.lining.offset
    m = body.mass
    J = body.inertia
    c1 = body.stiffness
    d1 = body.damping
    c_phi = body.tilt_stiffness
    d_phi = body.tilt_damping
    tilt = np.polynomial.Polynomial([c_phi + c2 * s * s, -c2 * s * h])  # K22 over mu
    a4 = m * J
    a3 = J * d1 + m * d_phi
    a2 = J * (c1 + c2) + d1 * d_phi + m * tilt
    a1 = d_phi * (c1 + c2) + d1 * tilt
    a0 = (c1 + c2) * c_phi + c1 * c2 * s * np.polynomial.Polynomial([s, -h])
    hurwitz = a1 * a2 * a3 - a3**2 * a0 - a4 * a1**2
    crossings = [
        float(root.real) for root in hurwitz.roots() if abs(root.imag) <= 1e-12 * abs(root) and root.real > 0.0
    ]
    flutters = [mu for mu in crossings if a1(mu) > 0.0]  # else the crossing is a pair of real roots, not a vibration
    return {
        "flutter": min(flutters, default=math.inf),
        "divergence": s / h + c_phi / (h * s) * (1.0 / c1 + 1.0 / c2) if s > 0.0 and c1 > 0.0 else math.inf,
    }
