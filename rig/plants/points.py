"""A plate that slides on many points of contact; each of them opens and closes often.

    q_i'' + 2 zeta w_i q_i' + w_i^2 q_i = sum_p (phi_i(p) + mu l phi_i,x(p)) N_p          modes i, points p
    N_p = F / points - k sum_i phi_i(p) q_i, not below zero
    phi_i = 2 / sqrt(m) sin(m_i pi x / a) sin(n_i pi y / b)

The plate is held at its edges and slides along x at a speed that vibration does not change. Friction mu N acts at a
distance l below the middle plane; its moment acts on phi_i,x = d phi_i / dx. This force has no potential, so the plate
can flutter. The points are at the centres of the cells of a grid. Lift-offs are not located (rig.solve.kick): there are
tens of thousands in a second.

The modes are those of a thin plate with m_i, n_i half waves along and across. Their frequencies are evenly spaced
instead, for tests that compare methods (derived here).
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Annotated, Self

import numpy as np
from annotated_types import Ge, Le
from pydantic import Field, model_validator

from rig.effects import load
from rig.effects.load import Load
from rig.effects.noise import Noisy
from rig.laws.constant import Constant
from rig.model.assembly import Assembly, Output
from rig.plants.belt import RAMPED
from rig.plants.structures.same_modes import refuse_others
from rig.quantities import (
    Hertz,
    Kilogram,
    Metre,
    NewtonPerMetre,
    PositiveMetre,
    PositiveMetrePerSecond,
    Ratio,
    Section,
)

HALF_WAVES = ((1, 1), (2, 1), (1, 2), (3, 1), (2, 2), (3, 2), (4, 1), (1, 3), (4, 2), (5, 1))
"""Half waves of each mode, along and across."""
Count = Annotated[int, Ge(1), Le(64)]

HANDS = {
    "friction.mu": "coefficient of friction",
    "load.force": "normal force",
    "plate.damping_ratio": "damping ratio",
    "contact.stiffness": "stiffness of the contact",
}


class Plate(Section):
    """The plate: sides along and across the sliding direction, mass; ten modes with evenly spaced frequencies."""

    length: PositiveMetre
    width: PositiveMetre
    mass: Kilogram
    lowest: Hertz
    highest: Hertz
    damping_ratio: Ratio = 0.0

    @model_validator(mode="after")
    def _ordered(self) -> Self:
        if not self.lowest < self.highest:
            raise ValueError(f"lowest {self.lowest:g} Hz is not below highest {self.highest:g} Hz")
        return self


class Contact(Section):
    """A grid of points with one spring each; `lever`: distance from the plate's middle plane to the contact [m]."""

    along: Count
    across: Count
    stiffness: NewtonPerMetre
    lever: Metre = 0.0


class Drive(Section):
    """The speed of the surface under the plate."""

    speed: PositiveMetrePerSecond


class Start(Section):
    """Velocities of the modes of unit modal mass [kg^0.5 m/s] at the start; modes that are not stated are at rest."""

    velocities: tuple[float, ...] = Field(default=(), max_length=len(HALF_WAVES))


class Parameters(Noisy):
    """The tables of a points scene. `load`: the preload, shared equally by all points."""

    plate: Plate
    contact: Contact
    drive: Drive
    load: Load
    friction: Constant
    start: Start = Start()

    def continuing(self, begun: Self) -> Self:
        """See `Section.continuing`: the modes of the plate stay, each of mass one."""
        refuse_others({"plate.mass": self.plate.mass}, {"plate.mass": begun.plate.mass})
        return self


def assemble(p: Parameters, moved: Mapping[str, str] = RAMPED) -> Assembly:
    """Assemble the rig. `moved`: actuators that a scene commands ("held") or ramps ("ramped"); others are constant."""
    a = Assembly(title="points")
    for mode, frequency in enumerate(np.linspace(p.plate.lowest, p.plate.highest, len(HALF_WAVES)).tolist()):
        omega = 2.0 * math.pi * frequency
        a.coordinate(f"q{mode}", 1.0, 2.0 * p.plate.damping_ratio * omega, omega * omega)
    a.start |= {f"q{mode}'": velocity for mode, velocity in enumerate(p.start.velocities)}
    a.patch("contact", {}, {"one": p.drive.speed}, p.friction.friction(), {})
    count = p.contact.along * p.contact.across
    share = {name: value / count for name, value in load.add(a, p.load, moved).items()}
    places = [
        ((i + 0.5) / p.contact.along, (j + 0.5) / p.contact.across)
        for i in range(p.contact.along)
        for j in range(p.contact.across)
    ]
    names = [f"point {1 + i // p.contact.across}.{1 + i % p.contact.across}" for i in range(count)]
    for name, place in zip(names, places):
        shape, turn = shapes(p.plate, *place)
        push = {q: value + p.friction.mu * p.contact.lever * turn[q] for q, value in shape.items()}
        a.normal(name, "contact", share | {q: -p.contact.stiffness * value for q, value in shape.items()}, push)
    seen, _ = shapes(p.plate, *places[0])
    a.struck = seen  # the modes deflect normal to the plate only
    a.outputs |= {
        "displacement": Output(seen, "m", role="displacement"),
        "velocity": Output({f"{q}'": value for q, value in seen.items()}, "m/s", role="velocity"),
        "acceleration": Output({f"{q}''": value for q, value in seen.items()}, "m/s^2"),
        "normal_force": Output({f"N:{name}": 1.0 for name in names}, "N"),
        "friction_force": Output({"T:contact": 1.0}, "N"),
        "surface_speed": Output({"one": p.drive.speed}, "m/s", role="drive"),
    }
    return a


def shapes(plate: Plate, x: float, y: float) -> tuple[dict[str, float], dict[str, float]]:
    """Deflection [kg^-0.5] and slope d/dx of each mode of unit modal mass; x, y: position as shares of the sides."""
    size = 2.0 / math.sqrt(plate.mass)
    shape, turn = {}, {}
    for mode, (m, n) in enumerate(HALF_WAVES):
        across = size * math.sin(n * math.pi * y)
        shape[f"q{mode}"] = across * math.sin(m * math.pi * x)
        turn[f"q{mode}"] = across * math.cos(m * math.pi * x) * m * math.pi / plate.length
    return shape, turn
