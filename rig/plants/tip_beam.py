"""The tip of an inclined clamped beam on a disc, in several modes of a finite-element beam.

    q_i'' + 2 zeta w_i q_i' + w_i^2 q_i = t_i T + n_i (N - N0)           mass one each (rig.plants.structures.bending)
    t_i = cos(a) across_i - sin(a) along_i,   n_i = sin(a) across_i + cos(a) along_i          at the tip
    x = sum t_i q_i,   y = sum n_i q_i,   w = V - x'
    N = N0 - kc y

N0 is the normal force without friction; the height of the clamp is fixed. The contact spring couples the motions along
the disc and normal to it, which determines the relief of the normal force and the stiffness of the tip (compare
rig.plants.tip). Each stick and each release also excites the higher modes.
Source: Tonazzi, Passafiume, Papangelo, Hoffmann, Massi, Nonlinear Dynamics 102 (2020) 1361; the paper has no dimensions
of the beam, they are derived (docs/tip.md).
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Annotated, Any, Self

from annotated_types import Ge, Le
from pydantic import model_validator

from rig.effects import drive, load, waviness
from rig.effects.drive import BeltDrive
from rig.effects.load import Load
from rig.effects.noise import Noisy
from rig.effects.waviness import Waviness
from rig.laws import Friction
from rig.model.assembly import Assembly, Output
from rig.model.named_rows import Row
from rig.picture import Own, Plot
from rig.plants.belt import RAMPED, contact_outputs
from rig.plants.structures import bending
from rig.plants.structures.same_modes import keyed, refuse_others
from rig.plants.tip import refuse_jam
from rig.quantities import (
    AcuteAngle,
    Hand,
    KilogramPerCubicMetre,
    NewtonPerMetre,
    Pascal,
    PoissonRatio,
    PositiveMetre,
    Ratio,
    Section,
)

HANDS = {
    "drive.speed": Hand("disc speed"),
    "load.force": Hand("normal force"),
    "friction.mu_static": Hand("friction coefficient at rest"),
    "friction.mu_kinetic": Hand("friction coefficient in motion"),
    "beam.damping_ratio": Hand("damping ratio", 0.0, 10.0),
}
PICTURES = (Own("rig.view.beam:Tip", ("displacement", "surface_speed")),)

Count = Annotated[int, Ge(1), Le(16)]


class Beam(Section):
    """The beam, much wider than thick (plane strain), and the number of its modes."""

    length: PositiveMetre
    thickness: PositiveMetre
    depth: PositiveMetre
    modulus: Pascal
    poisson: PoissonRatio
    density: KilogramPerCubicMetre
    modes: Count
    damping_ratio: Ratio = 0.0

    def reduced(self) -> bending.Modes:
        """The modes of the beam, including the attachment modes."""
        area = self.thickness * self.depth
        modulus = self.modulus / (1.0 - self.poisson**2)
        return bending.clamped(
            modulus * area * self.thickness**2 / 12.0, modulus * area, self.density * area, self.length, self.modes
        )


class Contact(Section):
    """Angle between the beam's axis and the disc's normal; contact stiffness normal to the disc [N/m]."""

    angle: AcuteAngle
    stiffness: NewtonPerMetre


class Parameters(Noisy):
    """The tables of a tip_beam scene. `load`: normal force N0 without friction; `drive`: disc speed at the tip."""

    beam: Beam
    contact: Contact
    drive: BeltDrive
    load: Load
    friction: Friction
    waviness: Waviness | None = None

    @model_validator(mode="after")
    def _digs_in(self) -> Self:
        refuse_jam(self.drive.speed, jam(self))
        return self

    def continuing(self, begun: Self) -> Self:
        """See `Section.continuing`: the modes of the beam stay."""
        refuse_others(self._of_modes, begun._of_modes)
        return self

    @property
    def _of_modes(self) -> dict[str, Any]:
        """The values that the shapes of the modes depend on."""
        return keyed("beam", self.beam, ("modulus", "poisson", "damping_ratio"))


@dataclass(frozen=True)
class Shapes:
    """Each mode [i] at the tip: `along` the disc and `normal` to it [kg^-0.5]; `omega` [rad/s]; `clamp` [N/(kg^0.5 m)].

    `clamp`: the force on the clamp along the disc per unit of the modal coordinate.
    """

    omega: list[float]
    along: list[float]
    normal: list[float]
    clamp: list[float]

    def relief(self, contact: float) -> float:
        """Reduction of the normal force per newton along the disc, for a contact stiffness `contact` [N/m]."""
        mixed = sum(t * n / w**2 for t, n, w in zip(self.along, self.normal, self.omega))
        return mixed / (sum((n / w) ** 2 for n, w in zip(self.normal, self.omega)) + 1.0 / contact)


def shapes(p: Parameters) -> Shapes:
    """The modes of the beam in the directions of the disc."""
    modes = p.beam.reduced()
    cosine = math.cos(p.contact.angle)
    sine = math.sin(p.contact.angle)
    (across, along), (shear, pull) = modes.tip.T, modes.clamp.T
    return Shapes(
        modes.omega.tolist(),
        (cosine * across - sine * along).tolist(),
        (sine * across + cosine * along).tolist(),
        (cosine * shear - sine * pull).tolist(),
    )


def jam(p: Parameters) -> float:
    """The product beta mu at rest; from 1 on the tip jams on a disc that turns backwards."""
    return float(shapes(p).relief(p.contact.stiffness) * p.friction.friction().static)


def assemble(p: Parameters, moved: Mapping[str, str] = RAMPED) -> Assembly:
    """Assemble the rig. `moved`: actuators that a scene commands ("held") or ramps ("ramped"); others are constant."""
    modes = shapes(p)
    a = Assembly(title="tip_beam")
    names = [f"q{i}" for i in range(1, len(modes.omega) + 1)]
    for name, omega in zip(names, modes.omega):
        a.coordinate(name, 1.0, 2.0 * p.beam.damping_ratio * omega, omega**2)
    along: Row = dict(zip(names, modes.along))
    normal: Row = dict(zip(names, modes.normal))
    a.patch("contact", along, drive.add(a, p.drive, "m/s", moved), p.friction.friction())
    pressed = load.add(a, p.load, moved)
    for name, share in normal.items():
        a.push(name, {state: -share * value for state, value in pressed.items()})
    a.normal("load", "contact", pressed | {name: -p.contact.stiffness * n for name, n in normal.items()}, normal)
    if modes.relief(p.contact.stiffness) * p.friction.friction().static >= 1.0:
        a.inputs["drive.speed"] = replace(a.inputs["drive.speed"], low=0.0)
    a.outputs |= contact_outputs(along, a)
    if p.waviness is not None:
        waviness.add(a, p.waviness, "contact", "load", along)
    damped = {f"{name}'": 2.0 * p.beam.damping_ratio / w * k for name, w, k in zip(names, modes.omega, modes.clamp)}
    a.outputs |= {
        "height": Output(normal, "m", Plot()),
        "clamp_force": Output(dict(zip(names, modes.clamp)) | damped, "N", Plot()),
    }
    a.free = {f"beam, mode {i}": w / (2.0 * math.pi) for i, w in enumerate(modes.omega[: p.beam.modes], 1)}
    return a
