"""A drive train with a clutch and a brake: three inertias, the second and the third on a spring.

    J3 w3' = M(t) - K,   J2 w2' = K - S,   J1 w1' = S - B,   S = c (phi2 - phi1) + d (w2 - w1)

K and B are the friction torques of clutch and brake, M(t) = amplitude sin(speed t) until the scene switches it off.
"""

from rig.effects import load
from rig.effects.load import Load
from rig.laws import Friction
from rig.model.assembly import Assembly, Output
from rig.quantities import RadianPerSecond, Section, quantity

Inertia, Stiffness, Damping, Torque = (quantity(u) for u in ("kg*m^2", "N*m/rad", "N*m*s/rad", "N*m"))


class Train(Section):
    """The inertias from motor to brake with their speeds at the start, and the spring between the last two."""

    motor: Inertia
    middle: Inertia
    braked: Inertia
    stiffness: Stiffness
    damping: Damping
    motor_speed: RadianPerSecond
    speed: RadianPerSecond


class Motor(Section):
    """The torque of the motor."""

    amplitude: Torque
    speed: RadianPerSecond


class Clutch(Section):
    """The largest torque of the clutch."""

    torque: Torque


class Parameters(Section):
    """The tables of a scene with this plant; `load` presses the brake."""

    train: Train
    motor: Motor
    clutch: Clutch
    load: Load
    friction: Friction


def assemble(p, moved=None):
    """The rows of the train."""
    a, t = Assembly(title="drive train"), p.train
    for name, inertia, speed in (("q3", t.motor, t.motor_speed), ("q2", t.middle, t.speed), ("q1", t.braked, t.speed)):
        a.coordinate(name, inertia)
        a.start[f"{name}'"] = speed
    a.spring({"q2": 1.0, "q1": -1.0}, t.stiffness, t.damping)
    a.signal("sine", {"cosine": p.motor.speed}, 0.0, "motor", "the torque of the motor")
    a.signal("cosine", {"sine": -p.motor.speed}, 1.0, "motor")
    a.push("q3", {"sine": p.motor.amplitude})
    law = p.friction.friction()
    a.patch("clutch", {"q3": 1.0, "q2": -1.0}, {}, law)
    a.normal("clutch_force", "clutch", {"one": p.clutch.torque})
    a.patch("brake", {"q1": 1.0}, {}, law)
    a.normal("load", "brake", load.add(a, p.load, moved or {}))
    a.outputs |= {
        "clutch_angle": Output({"q3": 1.0, "q2": -1.0}, "rad"),
        "motor_angle": Output({"q3": 1.0}, "rad"),
        "motor_speed": Output({"q3'": 1.0}, "rad/s"),
        "braked_speed": Output({"q1'": 1.0}, "rad/s"),
    }
    return a
