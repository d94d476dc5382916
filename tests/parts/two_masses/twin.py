"""Two masses in a row on one belt, each with a friction contact of its own."""

from rig.effects import drive, load
from rig.effects.drive import BeltDrive
from rig.effects.load import Load
from rig.laws import Friction
from rig.model.assembly import Assembly, Output
from rig.quantities import Kilogram, NewtonPerMetre, NewtonSecondPerMetre, Section, quantity


class Mass(Section):
    """A mass, its spring to the wall."""

    mass: Kilogram
    stiffness: NewtonPerMetre
    damping: NewtonSecondPerMetre = 0.0


class Parameters(Section):
    """The tables of a scene."""

    left: Mass
    right: Mass
    coupling: quantity("N/m") = 500.0
    drive: BeltDrive
    load: Load
    friction: Friction


def assemble(p, moved=None):
    """Two coordinates, coupled, with a contact each; one actuator loads both."""
    moved = moved or {}
    a = Assembly(title="two masses")
    c = p.coupling
    a.coordinate("l", p.left.mass, p.left.damping, p.left.stiffness + c)
    a.coordinate("r", p.right.mass, p.right.damping, p.right.stiffness + c)
    a.stiffness["l", "r"] = a.stiffness["r", "l"] = -c
    belt = drive.add(a, p.drive, "m/s", moved)
    press = load.add(a, p.load, moved)
    a.patch("left", {"l": 1.0}, belt, p.friction.friction())
    a.patch("right", {"r": 1.0}, belt, p.friction.friction())
    a.normal("nl", "left", press)
    a.normal("nr", "right", press)
    a.outputs |= {
        "v_left": Output({"l'": 1.0}, "m/s"),
        "v_right": Output({"r'": 1.0}, "m/s"),
        "x_left": Output({"l": 1.0}, "m"),
        "grip": Output({"T:left": 1.0}, "N"),
    }
    return a
