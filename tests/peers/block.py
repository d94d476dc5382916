"""A block between a pull and a surface that moves evenly or to and fro; a spring if the problem has one.

m x'' + d x' + c x = P + T,   w = V + A sin(2 pi f t) - x'
"""

import math

from rig.effects import load
from rig.effects.load import Load
from rig.laws import Friction
from rig.model.assembly import Assembly, Output
from rig.quantities import (
    Hertz,
    Kilogram,
    MetrePerSecond,
    Newton,
    NewtonSecondPerMetre,
    NonNegativeNewtonPerMetre,
    Section,
)


class Body(Section):
    """The block: its mass, spring and damper, a constant pull, and its velocity at the start."""

    mass: Kilogram
    stiffness: NonNegativeNewtonPerMetre = 0.0
    damping: NewtonSecondPerMetre = 0.0
    pull: Newton = 0.0
    velocity: MetrePerSecond = 0.0


class Surface(Section):
    """The speed of the surface, its constant part and its amplitude."""

    speed: MetrePerSecond = 0.0
    amplitude: MetrePerSecond = 0.0
    frequency: Hertz = 1.0


class Parameters(Section):
    """The tables of a scene with this plant."""

    body: Body
    surface: Surface = Surface()
    load: Load
    friction: Friction


def assemble(p, moved=None):
    """The rows of the block."""
    a, omega = Assembly(title="block"), 2.0 * math.pi * p.surface.frequency
    a.coordinate("x", p.body.mass, p.body.damping, p.body.stiffness)
    a.start["x'"] = p.body.velocity
    a.push("x", {"one": p.body.pull})
    speed = {"one": p.surface.speed}
    if p.surface.amplitude:
        a.signal("sine", {"cosine": omega}, 0.0, "surface", "the surface moves to and fro")
        a.signal("cosine", {"sine": -omega}, 1.0, "surface")
        speed["sine"] = p.surface.amplitude
    a.patch("contact", {"x": 1.0}, speed, p.friction.friction())
    a.normal("load", "contact", load.add(a, p.load, moved or {}))
    a.outputs |= {
        "displacement": Output({"x": 1.0}, "m"),
        "velocity": Output({"x'": 1.0}, "m/s"),
        "slip_speed": Output({"w:contact": 1.0}, "m/s"),
    }
    return a
