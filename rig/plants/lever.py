"""A slider on a rotating disc whose motion turns an L-shaped lever; the lever changes the normal force.

The disc drags the pin of a cylinder (angle phi). One spring holds the arm of the cylinder; another one connects its
tail to a leg of the lever (angle theta). The other leg acts through a spring on the fixture of the pin and presses it
on the disc:

    J phi'' + c1 phi' + dU/dphi = r2 T          U = sum k_i d_i^2 / 2 - m g r1 sin phi
    I theta'' + c2 theta' + dU/dtheta = 0       N = N0 + k2 r3 theta,  open at N = 0
    T = mu(w) N in slip,   w = rd Omega - r2 phi'

    d1 = |(l0 + D1 + r1 sin phi,  r1 (1 - cos phi))| - l0                                                 arm
    d2 = |(l0 + D2 - r3 sin theta,  r2 sin phi + r3 (1 - cos theta),  r2 (1 - cos phi))| - l0             fixture
    d3 = |(l0 + D3 + rv sin phi - r3 sin theta,  rv (1 - cos phi),  r3 (1 - cos theta))| - l0             tail

The deformations d_i (and the lift of the dead mass) are power series in the angles up to `order`; the forces follow
from the energy, with terms of one degree more. Order 2 is the paper's model, d1 = D1 + r1 phi,
d2 = D2 - r3 theta + r2^2 phi^2 / (2 (l0 + D2)), d3 = D3 + rv phi - r3 theta; order 5 has the cycle of the exact
geometry to 1e-5 at angles of 0.03 rad. J includes the dead mass.

Parts are optional, as in the experiments that identify the rig: the lever with its springs, the disc, the spring of the
arm (a load cell then holds the tip). The cylinder may be bolted.
Source: Liu and Ouyang, Mechanical Systems and Signal Processing (2022), the test rig, equations 14 to 21; the layout
of the springs is read from the text.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Annotated, ClassVar, Self

import numpy as np
from annotated_types import Ge, Le
from numpy.typing import NDArray
from pydantic import model_validator

from rig.about import About
from rig.effects import drive, load, sector
from rig.effects.drive import DiscDrive
from rig.effects.load import Load
from rig.effects.noise import Noisy
from rig.effects.sector import Sector
from rig.laws import Friction
from rig.model.assembly import Assembly, Output
from rig.picture import OnDisc, Own, Plot
from rig.plants.belt import RAMPED, contact_outputs
from rig.plants.structures import series
from rig.quantities import (
    Angle,
    Hand,
    KilogramSquareMetre,
    Metre,
    NewtonMetreSecondPerRadian,
    NewtonPerMetre,
    NewtonSecondPerMetre,
    NonNegativeKilogram,
    PositiveMetre,
    RadianPerSecond,
    Section,
)

HANDS = {
    "drive.speed": Hand("disc speed", 0.0, 5.0),
    "load.force": Hand("normal force"),
    "friction.mu_static": Hand("friction coefficient at rest"),
    "friction.mu_kinetic": Hand("friction coefficient in motion"),
    "lever.damping": Hand("damping of the lever", 0.0, 25.0),
}
PICTURES = (Own("rig.view.lever:Lever", ("angle", "lever_angle", "disc_speed", "normal_force")), OnDisc())

GRAVITY = 9.81  # m/s^2
ANGLES = ("phi", "theta")

Order = Annotated[int, Ge(2), Le(5)]


class Cylinder(Section):
    """Inertia J, damping c1, dead mass m; lengths r1 of the arm (spring and dead mass at its tips), r2 pin, rv tail."""

    inertia: KilogramSquareMetre
    damping: NewtonMetreSecondPerRadian = 0.0
    arm: PositiveMetre
    pin: PositiveMetre
    tail: PositiveMetre
    dead_mass: NonNegativeKilogram = 0.0
    bolted: bool = False


class Lever(Section):
    """The lever: inertia I, damping c2, length r3 of its two legs."""

    declares: ClassVar = About("turns with the slider's motion and presses it on the disc")

    inertia: KilogramSquareMetre
    damping: NewtonMetreSecondPerRadian = 0.0
    leg: PositiveMetre


class Spring(Section):
    """A spring: stiffness [N/m], deformation as mounted [m] (positive: extended)."""

    stiffness: NewtonPerMetre
    deformation: Metre = 0.0


class Springs(Section):
    """The springs of equal free length l0: k1 at the arm, k2 at the fixture, k3 at the tail; `order` of the series."""

    free_length: PositiveMetre
    order: Order = 2
    arm: Annotated[Spring | None, About("holds the arm of the cylinder")] = None
    fixture: Annotated[Spring | None, About("between the pin's fixture and the lever; presses the pin on")] = None
    tail: Annotated[Spring | None, About("between the tail of the cylinder and the lever")] = None

    @model_validator(mode="after")
    def _of_some_length(self) -> Self:
        for name in ("arm", "fixture", "tail"):
            spring = getattr(self, name)
            if spring is not None and self.free_length + spring.deformation <= 0.0:
                raise ValueError(
                    f"{name}.deformation {spring.deformation:g} m compresses the spring by its whole free length "
                    f"of {self.free_length:g} m or more"
                )
        return self


class LoadCell(Section):
    """A load cell that holds the tip of the arm in place of its spring and measures the force there."""

    declares: ClassVar = About("holds the tip of the arm instead of its spring, and measures the force there")

    stiffness: NewtonPerMetre
    damping: NewtonSecondPerMetre = 0.0


class Disc(Section):
    """The disc: radius rd [m] at which the pin rubs."""

    declares: ClassVar = About("turns under the pin; without it the pin is lifted")

    radius: PositiveMetre


class Start(Section):
    """Angles [rad] and angular velocities [rad/s] at the start; zero is the rig as mounted."""

    angle: Angle = 0.0
    angular_velocity: RadianPerSecond = 0.0
    lever_angle: Angle = 0.0
    lever_velocity: RadianPerSecond = 0.0


class Parameters(Noisy):
    """The tables of a lever scene. Optional: `lever` with two springs; `disc` with drive, load and friction."""

    cylinder: Cylinder
    springs: Springs
    lever: Lever | None = None
    load_cell: LoadCell | None = None
    disc: Disc | None = None
    drive: DiscDrive | None = None
    load: Load | None = None
    friction: Friction | None = None
    sector: Sector | None = None
    start: Start = Start()

    @model_validator(mode="after")
    def _whole(self) -> Self:
        faults = []
        mounted = [self.lever, self.springs.fixture, self.springs.tail]
        if any(part is None for part in mounted) and any(part is not None for part in mounted):
            faults.append("lever, springs.fixture and springs.tail belong together: give all three or none")
        turning = [self.disc, self.drive, self.load, self.friction]
        if any(part is None for part in turning) and any(part is not None for part in turning):
            faults.append("disc, drive, load and friction belong together: give all four, or none for a lifted pin")
        if self.sector is not None and self.disc is None:
            faults.append("sector: there is no disc; leave it out or give disc, drive, load and friction")
        if self.cylinder.bolted:
            if self.lever is None:
                faults.append("nothing can move: the cylinder is bolted and there is no lever")
            if self.disc is not None:
                faults.append("cylinder.bolted: a bolted pin cannot rub; leave disc, drive, load and friction out")
        elif (self.springs.arm is None) == (self.load_cell is None):
            faults.append("the tip of the arm is held by springs.arm or by load_cell: give one of them")
        if faults:
            raise ValueError("; ".join(faults))
        return self


def assemble(p: Parameters, moved: Mapping[str, str] = RAMPED) -> Assembly:
    """Assemble the rig. `moved`: actuators that a scene commands ("held") or ramps ("ramped"); others are constant."""
    a = Assembly(title="lever")
    cylinder = p.cylinder
    lever = p.lever
    if not cylinder.bolted:
        a.coordinate("phi", cylinder.inertia, cylinder.damping)
        a.start |= {"phi": p.start.angle, "phi'": p.start.angular_velocity}
    if lever is not None:
        a.coordinate("theta", lever.inertia, lever.damping)
        a.start |= {"theta": p.start.lever_angle, "theta'": p.start.lever_velocity}
    _springs(a, energy(p))
    if p.load_cell is not None and not cylinder.bolted:
        a.stiffness["phi", "phi"] += p.load_cell.stiffness * cylinder.arm**2
        a.damping["phi", "phi"] += p.load_cell.damping * cylinder.arm**2
        cell = {"phi": p.load_cell.stiffness * cylinder.arm, "phi'": p.load_cell.damping * cylinder.arm}
        a.outputs["cell_force"] = Output(cell, "N", Plot())
    if p.disc is not None and p.drive is not None and p.load is not None and p.friction is not None:
        turning = drive.add(a, p.drive, "rad/s", moved)
        surface = {name: p.disc.radius * factor for name, factor in turning.items()}
        a.patch("contact", {"phi": cylinder.pin}, surface, p.friction.friction())
        pressed = load.add(a, p.load, moved)
        if lever is not None and p.springs.fixture is not None:
            pressed |= {"theta": p.springs.fixture.stiffness * lever.leg}
        a.normal("load", "contact", pressed)
        a.outputs |= contact_outputs({"phi": cylinder.pin}, a)
        a.outputs["disc_speed"] = Output(turning, "rad/s", role="drive")
        if p.sector is not None:
            sector.add(a, p.sector, "contact", turning, {"phi": -cylinder.pin / p.disc.radius})
    if not cylinder.bolted:
        a.outputs |= {
            "angle": Output({"phi": 1.0}, "rad"),
            "angular_velocity": Output({"phi'": 1.0}, "rad/s"),
            "arm_displacement": Output({"phi": cylinder.arm}, "m", Plot()),
        }
    if lever is not None:
        a.outputs |= {
            "lever_angle": Output({"theta": 1.0}, "rad", Plot()),
            "lever_velocity": Output({"theta'": 1.0}, "rad/s", Plot()),
            "lever_displacement": Output({"theta": lever.leg}, "m", Plot()),
        }
    return a


def _springs(a: Assembly, stored: NDArray[np.float64]) -> None:
    """Add the forces of an energy to each coordinate: constant, stiffness, and a product for each further term."""
    for axis, name in enumerate(ANGLES):
        if name not in a.coordinates:
            continue
        moment = series.slope(stored, axis)
        for i, j in np.argwhere(moment):
            value = float(moment[i, j])
            powers = ("phi",) * int(i) + ("theta",) * int(j)
            if not set(powers) <= set(a.coordinates):
                continue
            if not powers:
                a.push(name, {"one": -value})
            elif len(powers) == 1:
                a.stiffness[name, powers[0]] = a.stiffness.get((name, powers[0]), 0.0) + value
            else:
                term = " ".join(f"{angle}^{n}" if n > 1 else angle for angle, n in zip(ANGLES, (i, j)) if n)
                a.product(term, *powers)
                a.push(name, {term: -value})


def energy(p: Parameters) -> NDArray[np.float64]:
    """U(phi, theta) of springs and dead mass [J] as a series; forces then have terms up to degree `order` + 1."""
    r1 = p.cylinder.arm
    r2 = p.cylinder.pin
    rv = p.cylinder.tail
    r3 = p.lever.leg if p.lever is not None else 0.0
    n = p.springs.order
    l0 = p.springs.free_length
    unit = series.constant(1.0, n)
    sin_phi, sin_theta = (series.sine(axis, n) for axis in (0, 1))
    up_phi, up_theta = (series.versine(axis, n) for axis in (0, 1))
    sides = (
        (p.springs.arm, (r1 * sin_phi, r1 * up_phi)),
        (p.springs.fixture, (-r3 * sin_theta, r2 * sin_phi + r3 * up_theta, r2 * up_phi)),
        (p.springs.tail, (rv * sin_phi - r3 * sin_theta, rv * up_phi, r3 * up_theta)),
    )
    parts = [series.cut(-p.cylinder.dead_mass * GRAVITY * r1 * sin_phi, n, n + 2)]
    for spring, (along, *across) in sides:
        if spring is None:
            continue
        along = along + (l0 + spring.deformation) * unit
        squares = [series.times(side, side) for side in (along, *across)]
        length = series.root(series.total(np.array(squares)))
        deformed = series.cut(series.total(np.array([length, -l0 * unit])), n, n + 2)
        parts.append(0.5 * spring.stiffness * series.times(deformed, deformed))
    return series.total(np.array(parts))
