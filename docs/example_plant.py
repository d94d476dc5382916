"""A block on a belt, held by a spring that stands on a table which is soft itself.

    m x'' + d x' + c (x - b) = T,   M b'' + D b' + C b = c (x - b),   w = V - x'

Try it:   rig explain docs/example_parts.toml
"""

from rig.effects import drive, load
from rig.effects.drive import BeltDrive
from rig.effects.load import Load
from rig.laws import Friction
from rig.model.assembly import Assembly, Output
from rig.picture import OnBelt, Plot
from rig.quantities import Kilogram, NewtonPerMetre, NewtonSecondPerMetre, Section

PICTURES = (OnBelt(),)


class Body(Section):
    """A mass with its spring and its damper."""

    mass: Kilogram
    stiffness: NewtonPerMetre
    damping: NewtonSecondPerMetre = 0.0


class Parameters(Section):
    """The tables of a scene with this plant."""

    block: Body
    table: Body
    drive: BeltDrive
    load: Load
    friction: Friction


def assemble(p, moved=None):
    """The rig's rows. `moved`: actuators that the scene commands ("held") or ramps ("ramped"); others are constant."""
    moved, spring = moved or {}, p.block.stiffness
    a = Assembly(title="block on a soft table")
    a.coordinate("x", p.block.mass, p.block.damping, spring)
    a.coordinate("b", p.table.mass, p.table.damping, p.table.stiffness + spring)
    a.stiffness["x", "b"] = a.stiffness["b", "x"] = -spring
    a.patch("contact", {"x": 1.0}, drive.add(a, p.drive, "m/s", moved), p.friction.friction())
    a.normal("load", "contact", load.add(a, p.load, moved))
    a.outputs |= {
        "displacement": Output({"x": 1.0}, "m"),
        "velocity": Output({"x'": 1.0}, "m/s"),
        "table_velocity": Output({"b'": 1.0}, "m/s", Plot()),
        "friction_force": Output({"T:contact": 1.0}, "N"),
        "normal_force": Output({"N:load": 1.0}, "N"),
        "slip_speed": Output({"w:contact": 1.0}, "m/s", Plot()),
        "surface_speed": Output(dict(a.surface("contact")), "m/s", role="drive"),
    }
    return a
