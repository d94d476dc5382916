"""Bodies in a plane, joined by springs, with their geometry by named points: rigid ones, and a disc that bends.

The coordinates of a rigid body are x, z and the rotation phi; its point (a along x, b along z) moves by

    u_x = x + b phi,   u_z = z - a phi

A spring of stiffness k between two points, or between a point and the ground, along x or z (or between two rotations)
adds k b b^T, where b is the motion of its first point minus that of its second.
Source: Kroeger, Neubauer, Popp, Phil. Trans. R. Soc. A 366 (2008) 785, section 3c (kind of model; rows derived here).

In the bending disc of a brake, modes of a free annular plate replace the axial motion and the tilt of a rigid disc:

    u_z = w(theta) = sum R(r) (C cos l theta + S sin l theta),   u_x = x - b dw / (r dtheta),   theta = a / r

for the point at the distance a along the circle on which the pads rub and b from the middle plane. For a rigid disc
these are z - a phi and x + b phi. The springs of a rigid disc along z and phi represent bending and are not used here.
At the speeds of a braking disc (l Omega of a few rad/s) the effect of the rotation on a pair of modes is far below its
damping and is neglected.
Source: rig.effects.disc_modes; slope as in Liu and Ouyang, Meccanica 55 (2020), section 3; derived.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from typing import Annotated, Any, Literal

from pydantic import Field

from rig.effects.disc_modes import Disc, free_modes
from rig.model.named_rows import Row
from rig.quantities import (
    Kilogram,
    KilogramSquareMetre,
    NewtonMetrePerRadian,
    NewtonPerMetre,
    Section,
    Unit,
    quantity,
)
from rig.units import brief

GROUND = "ground"
Place: Any = quantity("m")
Point = Annotated[tuple[Place, Place], Unit("m")]
"""Position (along x, along z) [m] from the centre of mass."""


class Body(Section):
    """A rigid body: mass, moment of inertia about the centre of mass, points by name."""

    mass: Kilogram
    inertia: KilogramSquareMetre
    points: dict[str, Point] = Field(default_factory=dict)

    def coordinates(self, name: str) -> dict[str, tuple[float, float, float]]:
        """The coordinates of the body `name` -> (inertia, damping and stiffness of the body itself)."""
        parts = (("x", self.mass), ("z", self.mass), ("phi", self.inertia))
        return {f"{name}.{axis}": (inertia, 0.0, 0.0) for axis, inertia in parts}

    def row(self, name: str, a: float, b: float, direction: str) -> Row:
        """The motion of the point (a, b) [m] along a direction, as a row over the coordinates."""
        if direction == "phi":
            return {f"{name}.phi": 1.0}
        arm = b if direction == "x" else -a
        return {f"{name}.{direction}": 1.0} | ({f"{name}.phi": arm} if arm else {})

    def acts_on(self, point: str, direction: str) -> bool:
        """Whether a spring at this point along this direction acts on a coordinate."""
        return True


class Bending(Body):
    """A bending disc: its mass along x, its points; deflection of `disc` at `radius` [m]."""

    disc: Disc
    radius: float

    def coordinates(self, name: str) -> dict[str, tuple[float, float, float]]:
        """See `Body.coordinates`."""
        bends = {
            f"{name}.{part}": (1.0, 2.0 * self.disc.damping_ratio * mode.omega, mode.omega**2)
            for mode in free_modes(self.disc)
            for part in mode.names
        }
        return {f"{name}.x": (self.mass, 0.0, 0.0)} | bends

    def row(self, name: str, a: float, b: float, direction: str) -> Row:
        """See `Body.row`."""
        row: Row = {f"{name}.x": 1.0} if direction == "x" else {}
        for mode in free_modes(self.disc):
            l = mode.diameters
            deflection = mode.at(self.radius)
            turn = l * a / self.radius
            shapes = (math.cos(turn), math.sin(turn))
            slopes = (-l * math.sin(turn) / self.radius, l * math.cos(turn) / self.radius)
            for part, shape, slope in zip(mode.names, shapes, slopes):
                moved = {"x": -b * slope, "z": shape}.get(direction, -slope)
                row[f"{name}.{part}"] = deflection * moved
        return row

    def acts_on(self, point: str, direction: str) -> bool:
        """See `Body.acts_on`."""
        return bool(point) or direction == "x"


class Straight(Section):
    """A spring along x or z from point to point, "body.point"; the name of a body alone is its centre of mass."""

    direction: Literal["x", "z"]
    stiffness: NewtonPerMetre
    first: str
    second: str = GROUND


class Torsion(Section):
    """A spring between the rotations of two bodies."""

    direction: Literal["phi"]
    stiffness: NewtonMetrePerRadian
    first: str
    second: str = GROUND


Spring = Annotated[Straight | Torsion, Field(discriminator="direction")]
Bodies = Mapping[str, Body]


def motion(bodies: Bodies, place: str, direction: str) -> Row:
    """The motion of "body.point" along x or z, or the rotation of its body (phi), as a row; empty for the ground."""
    if place == GROUND:
        return {}
    body, _, point = place.partition(".")
    a, b = bodies[body].points[point] if point else (0.0, 0.0)
    return bodies[body].row(body, a, b, direction)


def relative_motion(bodies: Bodies, first: str, second: str, direction: str) -> Row:
    """The motion of `first` minus that of `second`, as a row."""
    row = motion(bodies, first, direction)
    for name, value in motion(bodies, second, direction).items():
        row[name] = row.get(name, 0.0) - value
    return row


def both_ends_act(bodies: Bodies, spring: Any) -> bool:
    """Whether both ends of a spring act on a coordinate or on the ground."""
    ends = [place.partition(".") for place in (spring.first, spring.second) if place != GROUND]
    return all(bodies[body].acts_on(point, spring.direction) for body, _, point in ends)


def place_fault(bodies: Bodies, place: str) -> str:
    """The fault of a place "body.point" as text; "" for a known one."""
    body, _, point = place.partition(".")
    if place == GROUND:
        return ""
    if body not in bodies:
        return f"no body is called {brief(body)}; known: {', '.join(bodies)}, {GROUND}"
    if point and point not in bodies[body].points:
        known = ", ".join(bodies[body].points) or "none"
        return f"{body} has no point {brief(point)}; known: {known}"
    return ""


def place_faults(
    bodies: Bodies, springs: Mapping[str, Any], joined: Mapping[str, tuple[str, str]]
) -> Iterator[tuple[str, str]]:
    """Pairs (key, fault) for every spring or contact (`joined`) with an unknown place."""
    ends = {f"springs.{name}": (spring.first, spring.second) for name, spring in springs.items()}
    for key, (first, second) in [*ends.items(), *joined.items()]:
        for place in (first, second):
            wrong = place_fault(bodies, place)
            if wrong:
                yield key, wrong
        if first == second:
            yield key, f"joins {first} to itself"
