"""Rigid bodies in a plane, joined by springs: three degrees of freedom each, geometry by named points.

A body moves by x, z and turns by phi; what its point (a along x, b along z) moves by is

    u_x = x + b phi,   u_z = z - a phi

A spring of stiffness k between two points, or between a point and the ground, along x or z (or between two turns) adds
k b b^T, b = motion of its first point less that of its second.
Source: Kroeger, Neubauer, Popp, Phil. Trans. R. Soc. A 366 (2008) 785, section 3c (the model's kind; rows derived).
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import Annotated, Any, Literal

from pydantic import Field

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

GROUND = "ground"
Place: Any = quantity("m")
Point = Annotated[tuple[Place, Place], Unit("m")]
"""(along x, along z) from the centre of mass."""


class Body(Section):
    """Mass, moment of inertia about the centre of mass, and points by name."""

    mass: Kilogram
    inertia: KilogramSquareMetre
    points: dict[str, Point] = Field(default_factory=dict)

    def coordinates(self, name: str) -> dict[str, tuple[float, float]]:
        """Its coordinates as body `name`, each with inertia and with a stiffness of its own."""
        parts = (("x", self.mass), ("z", self.mass), ("phi", self.inertia))
        return {f"{name}.{axis}": (inertia, 0.0) for axis, inertia in parts}

    def row(self, name: str, a: float, b: float, direction: str) -> Row:
        """The motion of its point (a, b) along a direction, over its coordinates."""
        if direction == "phi":
            return {f"{name}.phi": 1.0}
        arm = b if direction == "x" else -a
        return {f"{name}.{direction}": 1.0} | ({f"{name}.phi": arm} if arm else {})

    def holds(self, point: str, direction: str) -> bool:
        """Whether a spring to that point along that direction has something to hold."""
        return True


class Straight(Section):
    """A spring along x or z from point to point, "body.point"; the name of a body alone is its centre of mass."""

    direction: Literal["x", "z"]
    stiffness: NewtonPerMetre
    first: str
    second: str = GROUND


class Torsion(Section):
    """A spring between the turns of two bodies."""

    direction: Literal["phi"]
    stiffness: NewtonMetrePerRadian
    first: str
    second: str = GROUND


Spring = Annotated[Straight | Torsion, Field(discriminator="direction")]
Bodies = Mapping[str, Body]


def motion(bodies: Bodies, place: str, direction: str) -> Row:
    """The motion of "body.point" along x or z, or the turn of its body (phi), as a row; the ground has none."""
    if place == GROUND:
        return {}
    body, _, point = place.partition(".")
    a, b = bodies[body].points[point] if point else (0.0, 0.0)
    return bodies[body].row(body, a, b, direction)


def apart(bodies: Bodies, first: str, second: str, direction: str) -> Row:
    """The motion of one place less that of another."""
    row = motion(bodies, first, direction)
    for name, value in motion(bodies, second, direction).items():
        row[name] = row.get(name, 0.0) - value
    return row


def held(bodies: Bodies, spring: Any) -> bool:
    """Whether both ends of a spring have something to hold."""
    ends = [place.partition(".") for place in (spring.first, spring.second) if place != GROUND]
    return all(bodies[body].holds(point, spring.direction) for body, _, point in ends)


def unknown(bodies: Bodies, place: str) -> str:
    """What is wrong with a place; "" where it is known."""
    body, _, point = place.partition(".")
    if place == GROUND:
        return ""
    if body not in bodies:
        return f"no body is called {body!r}; known: {', '.join(bodies)}, {GROUND}"
    if point and point not in bodies[body].points:
        known = ", ".join(bodies[body].points) or "none"
        return f"{body} has no point {point!r}; known: {known}"
    return ""


def adrift(
    bodies: Bodies, springs: Mapping[str, Any], joined: Mapping[str, tuple[str, str]]
) -> Iterator[tuple[str, str]]:
    """(key, what is wrong) for every spring or contact (`joined`) whose places are unknown."""
    ends = {f"springs.{name}": (spring.first, spring.second) for name, spring in springs.items()}
    for key, (first, second) in [*ends.items(), *joined.items()]:
        for place in (first, second):
            wrong = unknown(bodies, place)
            if wrong:
                yield key, wrong
        if first == second:
            yield key, f"joins {first} to itself"
