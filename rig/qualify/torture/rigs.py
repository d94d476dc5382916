"""Small rigs that no scene has: each isolates one difficulty for the torture test.

Each is written like a plant, with `Parameters` and `assemble`, so that cases change them by the same keys.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any

from rig.model import friction_law
from rig.model.assembly import Assembly, Output
from rig.quantities import Section
from rig.sensors.chain.instrument import Instrument
from rig.sensors.displacement_laser import DisplacementLaser
from rig.sensors.laser_vibrometer import LaserVibrometer


class Ball(Section):
    """A mass that falls on a stiff, damped contact with a belt; a spring and a damper, `sway`, hold it sideways.

    Without the damper it would, once at rest, just reach the belt speed in every period, with zero margin.
    """

    mass: float = 1.0
    gravity: float = 9.81
    height: float = 0.01
    stiffness: float = 1e5
    damping: float = 100.0
    spring: float = 1000.0
    sway: float = 1.0
    mu: float = 0.3
    belt: float = 0.05


def ball(p: Ball, moved: Mapping[str, str]) -> Assembly:
    """Assemble N = -k z - d z' of the height z; the contact opens where it would pull."""
    a = Assembly("ball")
    a.coordinate("x", p.mass, p.sway, p.spring)
    a.coordinate("z", p.mass)
    a.push("z", {"one": -p.mass * p.gravity})
    a.patch("contact", {"x": 1.0}, {"one": p.belt}, friction_law.coulomb(p.mu, p.mu))
    a.normal("load", "contact", {"z": -p.stiffness, "z'": -p.damping}, {"z": 1.0})
    a.start |= {"z": p.height}
    a.outputs |= {"height": Output({"z": 1.0}, "m"), "fall": Output({"z'": 1.0}, "m/s")}
    return a


class Twins(Section):
    """Two masses side by side on one belt, equal except for `apart`, by which the second starts later."""

    mass: float = 1.0
    stiffness: float = 1000.0
    damping: float = 0.0
    belt: float = 0.05
    load: float = 10.0
    mu_static: float = 0.4
    mu_kinetic: float = 0.25
    apart: float = 0.0


def twins(p: Twins, moved: Mapping[str, str]) -> Assembly:
    """Assemble two oscillators whose events are simultaneous."""
    a = Assembly("twins")
    for name, late in (("x1", 0.0), ("x2", p.apart)):
        a.coordinate(name, p.mass, p.damping, p.stiffness)
        a.patch(f"contact {name}", {name: 1.0}, {"one": p.belt}, friction_law.coulomb(p.mu_static, p.mu_kinetic))
        a.normal(f"load {name}", f"contact {name}", {"one": p.load})
        a.start |= {name: -late * p.belt, f"{name}'": p.belt}
        a.outputs[name] = Output({name: 1.0}, "m")
    return a


class Sectored(Twins):
    """The twins on a belt whose first lane has sectors of another friction, `piece` long, `gap` apart.

    `sliding`: the first mass begins in its sliding equilibrium; if both frictions are equal in slip it stays there, and
    edges come at belt / piece.
    """

    piece: float = 0.0005
    gap: float = 0.0005
    mu_piece: float = 0.3
    sliding: bool = False


def sectored(p: Sectored, moved: Mapping[str, str]) -> Assembly:
    """Assemble the twins with the position of the first mass on its lane, which is constant in stick."""
    a = twins(p, moved)
    a.signal("turn", {"one": p.belt}, 0.0, "belt")
    law = friction_law.coulomb(p.mu_static, p.mu_kinetic)
    piece = friction_law.coulomb(max(p.mu_piece, p.mu_static), p.mu_piece)
    length = p.piece + p.gap
    a.sector("lane", "contact x1", {"turn": 1.0, "x1": -1.0}, "turn", length, (0.0, p.piece), (piece, law))
    if p.sliding:
        rest = p.mu_kinetic * p.load / p.stiffness
        a.start |= {"x1": rest, "x1'": 0.0, "turn": rest}
    return a


class BeltLoop(Section):
    """A mass on a belt that follows it: command v0 + gain x', a lag, and limits if there are any."""

    mass: float = 5.0
    stiffness: float = 2500.0
    damping: float = 2.0
    load: float = 20.0
    mu_static: float = 0.5
    mu_kinetic: float = 0.4
    belt: float = 0.06
    gain: float = 5.33
    lag: float = 0.01
    lowest: float = 0.0
    highest: float = 0.25
    limited: bool = True


def belt_loop(p: BeltLoop, moved: Mapping[str, str]) -> Assembly:
    """Assemble V' = (clamp(v0 + K x') - V) / lag: in stick x' = V, growth (K - 1) / lag until the drive clamps."""
    a = Assembly("belt_loop")
    a.coordinate("x", p.mass, p.damping, p.stiffness)
    a.signal("command", {}, p.belt, "drive")
    a.signal("actual", {"actual": -1.0 / p.lag}, p.belt, "drive")
    row = {"command": 1.0, "x'": p.gain}
    if p.limited:
        a.limit("drive", row, p.lowest, p.highest, "actual", 1.0 / p.lag)
    else:
        a.signals["actual"] |= {name: value / p.lag for name, value in row.items()}
    a.patch("contact", {"x": 1.0}, {"actual": 1.0}, friction_law.coulomb(p.mu_static, p.mu_kinetic))
    a.normal("load", "contact", {"one": p.load})
    a.start |= {"x'": p.belt}
    a.outputs["surface_speed"] = Output({"actual": 1.0}, "m/s")
    return a


RIGS: dict[str, tuple[type[Section], Callable[[Any, Mapping[str, str]], Assembly], Instrument]] = {
    "ball": (Ball, ball, DisplacementLaser(reads="height", ideal=True)),
    "twins": (Twins, twins, DisplacementLaser(reads="x1", ideal=True)),
    "sectored": (Sectored, sectored, DisplacementLaser(reads="x1", ideal=True)),
    "belt_loop": (BeltLoop, belt_loop, LaserVibrometer(reads="surface_speed", ideal=True)),
}
"""The parameters of each rig, how it is assembled, and an ideal instrument on it."""
