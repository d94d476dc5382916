"""A disc brake as rigid bodies in a plane: disc, pads, calliper, carriers on springs. Mode coupling at 2 to 4 kHz.

    M q'' + C q' + K q = sum_p t_p T_p - sum_c n_c N_c + f0,   w_p = r Omega - t_p.v,   N_c = N0 + scale^2 k n_c.q >= 0
    K = scale^2 sum k b b^T over the springs,   C = scale loss / (2 pi frequency) sum k b b^T over springs and contacts
    f0 = sum_c n_c N0 (at rest), less sum_c mu N0 t_c (in sliding)

A contact is a point of a pad on a point of the disc's face: n_c is their approach along z, t_c the motion of the pad
along x relative to the disc. Contacts of one pad with the same slip velocity form one friction patch. The force of a
pad is proportional to the pressure p; its stiffness is kn (p / p0)^exponent.

The coordinates are relative to the pressed state. `load.at` = "sliding": every contact carries N0 while the disc turns,
so steady sliding is q = 0 and the static moment of friction is not taken up by the pads. `load.at` = "rest": every
contact carries N0 without friction; friction then loads one end of a pad more than the other. C also acts between pad
and disc while a contact is open. With `disc_modes` the disc bends (rig.plants.structures.multibody); each contact then
slides in its own direction.
Source: Kroeger, Neubauer, Popp, Phil. Trans. R. Soc. A 366 (2008) 785, section 3c, figures 15 to 17 (kind of model).
The paper gives no numbers: springs, masses and the pressure law are calibrated here to its 0.64 and 2140 Hz.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Annotated, Any, Literal, Self

from pydantic import model_validator

from rig.about import SetPoint
from rig.effects import drive, inhomogeneity, piezo
from rig.effects.disc_modes import Disc
from rig.effects.drive import DiscDrive
from rig.effects.inhomogeneity import Inhomogeneity
from rig.effects.piezo import Piezo, WithStack
from rig.laws import Friction
from rig.model.assembly import Assembly, Output
from rig.model.named_rows import Row
from rig.picture import Own, Plot
from rig.plants.belt import RAMPED
from rig.plants.structures.multibody import (
    Bending,
    Body,
    Spring,
    both_ends_act,
    motion,
    place_fault,
    place_faults,
    relative_motion,
)
from rig.plants.structures.same_modes import keyed, refuse_others
from rig.quantities import (
    Hand,
    Hertz,
    MetrePerSecond,
    NewtonPerMetre,
    NonNegativeNewton,
    Number,
    Pascal,
    PositiveMetre,
    PositiveNumber,
    Ratio,
    Section,
    refused,
)

HANDS = {
    "friction.mu": Hand("coefficient of friction"),
    "load.pressure": Hand("brake pressure"),
    "structure.loss_factor": Hand("damping (loss factor)", 0.0, 4.0),
    "shunt.connected": Hand("shunt connected"),
    "shunt.resistance": Hand("resistance of the shunt"),
    "shunt.inductance": Hand("inductance of the shunt", 0.5, 1.5),
}
PICTURES = (Own("rig.view.brake:Brake", ("displacement", "velocity", "surface_speed")),)


class Structure(Section):
    """Damping of all springs by their loss factor at a frequency; `scale` multiplies frequencies of rigid bodies."""

    loss_factor: Ratio
    frequency: Hertz
    scale: PositiveNumber = 1.0


class Linings(Section):
    """Normal force [N] and stiffness [N/m] of one pad at `pressure`, each the sum over its contacts.

    `radius`: radius [m] of the circle on which the pads rub. `exponent`: exponent of the stiffness over the pressure.
    """

    pressure: Annotated[Pascal, SetPoint()]
    force: NonNegativeNewton
    stiffness: NewtonPerMetre
    exponent: Number = 0.0
    radius: PositiveMetre


class Contact(Section):
    """A contact of a point of a pad with a point of the disc, each stated as "body.point"."""

    pad: str
    disc: str


class Load(Section):
    """Pressure in the calliper [Pa], and the state in which every contact carries N0 (see the head of this file)."""

    pressure: Pascal
    at: Literal["sliding", "rest"]


class Probe(Section):
    """Point and direction of the outputs displacement, velocity and acceleration."""

    point: str
    direction: Literal["x", "z"] = "x"


class Start(Section):
    """Velocity at the start [m/s] of the body under the probe, in the probe's direction; the others are at rest."""

    velocity: MetrePerSecond = 0.0


class Mounted(Piezo):
    """The stack between two points, "body.point" each; its extension is the displacement of `first` minus `second`."""

    first: str
    second: str
    direction: Literal["x", "z"] = "z"


class Parameters(WithStack):
    """The tables of a brake scene."""

    piezo: Mounted | None = None
    bodies: dict[str, Body]
    springs: dict[str, Spring]
    contacts: dict[str, Contact]
    structure: Structure
    linings: Linings
    drive: DiscDrive
    load: Load
    friction: Friction
    probe: Probe
    inhomogeneity: Inhomogeneity | None = None
    disc_modes: Disc | None = None
    start: Start = Start()

    @model_validator(mode="after")
    def _joined(self) -> Self:
        ends = {f"contacts.{name}": (c.pad, c.disc) for name, c in self.contacts.items()}
        if self.piezo is not None:
            ends["piezo"] = (self.piezo.first, self.piezo.second)
        wrong = list(place_faults(self.bodies, self.springs, ends))
        if problem := place_fault(self.bodies, self.probe.point):
            wrong.append(("probe.point", problem))
        if not wrong:
            middle = [name for name, c in self.contacts.items() if not _side(self, c)]
            wrong = [(f"contacts.{name}", "the point on the disc lies in its middle, not on a face") for name in middle]
        if self.disc_modes is not None:
            if fault := self.disc_modes.off(self.linings.radius):
                wrong.append(("linings.radius", fault))
        if wrong:
            raise refused(wrong)
        return self

    def continuing(self, begun: Self) -> Self:
        """See `Section.continuing`: the modes of the disc stay."""
        refuse_others(self._of_modes, begun._of_modes)
        return self

    @property
    def _of_modes(self) -> dict[str, Any]:
        """The values that the shapes of the modes depend on."""
        return keyed("disc_modes", self.disc_modes, ("modulus", "damping_ratio"))


def assemble(p: Parameters, moved: Mapping[str, str] = RAMPED) -> Assembly:
    """Assemble the rig. `moved`: actuators that a scene commands ("held") or ramps ("ramped"); others are constant."""
    a = Assembly(title="brake")
    bodies = dict(p.bodies)
    if p.disc_modes is not None:
        disc = next(iter(p.contacts.values())).disc.partition(".")[0]
        bodies[disc] = Bending(**dict(p.bodies[disc]), disc=p.disc_modes, radius=p.linings.radius)
    elastic = p.structure.scale**2
    viscous = p.structure.scale * p.structure.loss_factor / (2.0 * math.pi * p.structure.frequency)
    for name, body in bodies.items():
        for coordinate, (inertia, damping, stiffness) in body.coordinates(name).items():
            a.coordinate(coordinate, inertia, damping, stiffness)
    for spring in p.springs.values():
        if both_ends_act(bodies, spring):
            row = relative_motion(bodies, spring.first, spring.second, spring.direction)
            a.spring(row, elastic * spring.stiffness, viscous * spring.stiffness)

    speed = drive.add(a, p.drive, "rad/s", moved)
    share = p.load.pressure / p.linings.pressure
    pads = [contact.pad.partition(".")[0] for contact in p.contacts.values()]
    patches: dict[str, Row] = {}
    law = p.friction.friction()
    slip = abs(p.linings.radius * p.drive.speed)
    rows = [relative_motion(bodies, contact.pad, contact.disc, "x") for contact in p.contacts.values()]
    shares = [1.0 / pads.count(pad) for pad in pads]
    for (name, contact), pad, along in zip(p.contacts.items(), pads, rows):
        patch = next((known for known, row in patches.items() if row == along), "")
        if not patch:
            patch = pad if pad not in patches else name
            patches[patch] = along
            a.patch(patch, along, {state: p.linings.radius * value for state, value in speed.items()}, law)
        approach = relative_motion(bodies, contact.pad, contact.disc, "z")
        approach = {coordinate: -_side(p, contact) * value for coordinate, value in approach.items()}
        stiffness = p.linings.stiffness * share**p.linings.exponent / pads.count(pad)
        force = p.linings.force * share / pads.count(pad)
        pressed = {coordinate: elastic * stiffness * value for coordinate, value in approach.items()}
        a.normal(name, patch, pressed | {"one": force}, {coordinate: -value for coordinate, value in approach.items()})
        a.spring(approach, 0.0, viscous * stiffness)
        for coordinate, value in approach.items():
            a.push(coordinate, {"one": value * force})
        load = p.linings.force * share * sum(part for row, part in zip(rows, shares) if row == along)
        pull = law.mu(slip, load) * (-1.0 if p.drive.speed < 0.0 else 1.0)
        for coordinate, value in along.items() if p.load.at == "sliding" else ():
            a.push(coordinate, {"one": -value * pull * force})

    if p.inhomogeneity is not None:  # the stiffness of the brake varies, that of the stack does not
        inhomogeneity.add(a, p.inhomogeneity, speed)
    if p.piezo is not None:
        piezo.add(a, p, relative_motion(bodies, p.piezo.first, p.piezo.second, p.piezo.direction), moved)
    seen = motion(bodies, p.probe.point, p.probe.direction)
    a.start |= {f"{p.probe.point.partition('.')[0]}.{p.probe.direction}'": p.start.velocity}
    a.outputs |= {
        "displacement": Output(seen, "m", role="displacement"),
        "velocity": Output({f"{c}'": f for c, f in seen.items()}, "m/s", role="velocity"),
        "acceleration": Output({f"{c}''": f for c, f in seen.items()}, "m/s^2"),
    }
    first = next(iter(patches))
    of_first = [name for name, patch, *_ in a.normals if patch == first]
    a.outputs |= {
        "friction_force": Output({f"T:{first}": 1.0}, "N"),
        "normal_force": Output({f"N:{name}": 1.0 for name in of_first}, "N"),
        "slip_speed": Output({f"w:{first}": 1.0}, "m/s", Plot()),
        "surface_speed": Output(dict(a.surface(first)), "m/s", role="drive"),
        "disc_speed": Output(dict(speed), "rad/s", role="drive"),
    }
    a.outputs |= {f"normal_force_{name}": Output({f"N:{name}": 1.0}, "N", Plot()) for name in p.contacts}
    return a


def _side(p: Parameters, contact: Contact) -> float:
    """The side of the disc of a contact: 1 for the face towards +z, -1 for the face towards -z, 0 for neither."""
    body, _, point = contact.disc.partition(".")
    height = p.bodies[body].points[point][1] if point else 0.0
    return math.copysign(1.0, height) if height else 0.0
