"""The tip of a clamped beam on a disc, in one mode: steady sliding and stick-slip at the same speed.

    m x'' + (c + r k) x' + k x = T,   w = V - x',   T = mu N sgn(w) in slip
    N = N0 - beta (k x + r k x')

A clamp that is pushed down by a fixed distance presses the tip on with N0. A force F that bends the tip along the disc
reduces the normal force by beta F. In steady sliding N = N0 / (1 + beta mu), and the tip is stiffer in slip,
w_s = sqrt((1 + beta mu) k / m). r is the damping of the material as a time; it is part of the elastic force, c is not.

A beam with its axis at `angle` to the disc's normal and compliances 1 across and eps along the axis has

    beta = c_nt / c_nn,   k = k_b c_nn / (c_tt c_nn - c_nt^2)
    c_tt = cos^2 + eps sin^2,   c_nn = sin^2 + eps cos^2,   c_nt = (1 - eps) sin cos

If the disc turns in the other direction, friction adds to the normal force: the tip digs in and jams for beta mu >= 1.
Such a rig refuses a negative speed.
Source: Tonazzi, Passafiume, Papangelo, Hoffmann, Massi, Nonlinear Dynamics 102 (2020) 1361 (finite elements and
experiment). The paper has no lumped equations: the model is derived, its numbers are calibrated (docs/tip.md).
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import replace
from typing import Any, ClassVar, Self

from annotated_types import Gt, Le
from pydantic import model_validator

from rig.about import About
from rig.effects import drive, load, waviness
from rig.effects.drive import BeltDrive
from rig.effects.load import Load
from rig.effects.noise import Noisy
from rig.effects.waviness import Waviness
from rig.laws import Friction
from rig.model.assembly import Assembly, Output
from rig.picture import Own, Plot
from rig.plants.belt import RAMPED, contact_outputs
from rig.quantities import (
    AcuteAngle,
    Hand,
    Kilogram,
    Metre,
    MetrePerSecond,
    NewtonSecondPerMetre,
    NonNegativeNewtonPerMetre,
    Ratio,
    Second,
    Section,
    quantity,
)

HANDS = {
    "drive.speed": Hand("disc speed"),
    "load.force": Hand("normal force"),
    "friction.mu_static": Hand("friction coefficient at rest"),
    "friction.mu_kinetic": Hand("friction coefficient in motion"),
    "tip.stiffness": Hand("stiffness of the beam", 0.3, 3.0),
}
PICTURES = (Own("rig.view.beam:Tip", ("displacement", "surface_speed")),)

Share: Any = quantity("1", Gt(0.0), Le(1.0))


class Tip(Section):
    """The beam, reduced to its tip along the disc: mass, stiffness, damping of the material, separate damper.

    `retardation` r: damping constant of the material over its stiffness [s]. `damping` c: a damper without influence on
    the normal force [N s/m]. `relief` beta: reduction of the normal force per newton that bends the tip [1].
    """

    mass: Kilogram
    stiffness: NonNegativeNewtonPerMetre
    retardation: Second = 0.0
    damping: NewtonSecondPerMetre = 0.0
    relief: Ratio = 0.0


class Inclination(Section):
    """Angle [rad] between the beam's axis and the disc's normal; compliance along the axis (with contact) over bending.

    With this table the stiffness of the tip is that of bending alone, and the relief is computed.
    """

    declares: ClassVar = About(
        "an inclined beam: bending reduces the normal force; without this table `relief` states by how much"
    )

    angle: AcuteAngle
    compliance: Share

    def relief(self) -> float:
        """Reduction beta of the normal force per newton along the disc."""
        _, across, mixed = self._compliances()
        return mixed / across

    def stiffening(self) -> float:
        """Stiffness along the disc at fixed height of the tip, over that of bending."""
        along, across, mixed = self._compliances()
        return across / (along * across - mixed**2)

    def _compliances(self) -> tuple[float, float, float]:
        """Compliances along the disc, normal to it and between both, relative to bending."""
        cosine = math.cos(self.angle)
        sine = math.sin(self.angle)
        eps = self.compliance
        return cosine**2 + eps * sine**2, sine**2 + eps * cosine**2, (1.0 - eps) * sine * cosine


class Start(Section):
    """Position and velocity of the tip at the start; zero: unbent beam."""

    displacement: Metre = 0.0
    velocity: MetrePerSecond = 0.0


class Parameters(Noisy):
    """The tables of a tip scene. `load`: the normal force of the unbent beam; `drive`: speed of the disc at the tip."""

    tip: Tip
    inclination: Inclination | None = None
    drive: BeltDrive
    load: Load
    friction: Friction
    waviness: Waviness | None = None
    start: Start = Start()

    @model_validator(mode="after")
    def _one_relief(self) -> Self:
        if self.inclination is not None and self.tip.relief:
            raise ValueError("tip.relief and inclination are both given; the relief follows from the inclination")
        return self

    @model_validator(mode="after")
    def _digs_in(self) -> Self:
        refuse_jam(self.drive.speed, jam(self))
        return self

    @property
    def at_fixed_height(self) -> Tip:
        """The tip at fixed height: the inclination is included in stiffness, damping and relief."""
        if self.inclination is None:
            return self.tip
        k = self.inclination.stiffening()
        return self.tip.model_copy(update={"stiffness": k * self.tip.stiffness, "relief": self.inclination.relief()})


def refuse_jam(speed: float, most: float) -> None:
    """Raise ValueError if the disc turns backwards (`speed` [m/s] below zero) and the tip jams (beta mu = `most`)."""
    if most >= 1.0 and speed < 0.0:
        raise ValueError(
            f"drive.speed {speed:g} m/s jams the tip: friction raises the normal force faster "
            f"than the beam yields (beta mu = {most:.3g}, must be below 1); run the disc forward, or lower the "
            "friction coefficient or the relief"
        )


def jam(p: Parameters) -> float:
    """The product beta mu at rest; from 1 on the tip jams on a disc that turns backwards."""
    return float(p.at_fixed_height.relief * p.friction.friction().static)


def assemble(p: Parameters, moved: Mapping[str, str] = RAMPED) -> Assembly:
    """Assemble the rig. `moved`: actuators that a scene commands ("held") or ramps ("ramped"); others are constant."""
    tip = p.at_fixed_height
    elastic = {"x": tip.stiffness, "x'": tip.retardation * tip.stiffness}
    a = Assembly(title="tip")
    a.coordinate("x", tip.mass, tip.damping + elastic["x'"], elastic["x"])
    a.start |= {"x": p.start.displacement, "x'": p.start.velocity}
    a.patch("contact", {"x": 1.0}, drive.add(a, p.drive, "m/s", moved), p.friction.friction())
    pressed = load.add(a, p.load, moved) | {name: -tip.relief * value for name, value in elastic.items()}
    a.normal("load", "contact", pressed)
    if jam(p) >= 1.0:
        a.inputs["drive.speed"] = replace(a.inputs["drive.speed"], low=0.0)
    a.outputs |= contact_outputs({"x": 1.0}, a) | {"clamp_force": Output(elastic, "N", Plot())}
    if p.waviness is not None:
        waviness.add(a, p.waviness, "contact", "load", {"x": 1.0})
    return a
