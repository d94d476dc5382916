"""A tuned mass: an inclined absorber on the body. Its inertia changes the normal force.

The absorber moves by y along a line inclined by `angle`. Its position is (x + y sin a, -y cos a), where x is the
displacement of the body along the belt, both from the equilibrium under gravity:

    (m1 + m2) x'' + m2 sin a y'' + d1 x' + c1 x = T        m2 (sin a x'' + y'') + d2 y' + c2 y = 0
    N = load + d2 cos a y' + c2 cos a y + m2 sin a cos a x''

N depends on an acceleration, so friction changes the mass matrix. The rig jams where the mass matrix is no longer
positive definite: mu m2 sin a cos a above m1 + m2 cos^2 a. In steady sliding the motion depends on the angle only
through sin a (sin a + mu cos a); at constant mu it is symmetric about a = -atan(mu)/2, not about zero.
Source: Kroeger, Neubauer, Popp, Phil. Trans. R. Soc. A 366 (2008) 785, equations 4.10 to 4.13.
"""

from __future__ import annotations

import math
from typing import Any, ClassVar, Self

from annotated_types import Ge
from pydantic import field_validator, model_validator

from rig.about import About
from rig.model.assembly import Assembly, Output
from rig.model.named_rows import add as add_row
from rig.picture import Plot
from rig.quantities import Angle, NewtonPerMetre, Section, optional, quantity

AbsorberMass: Any = quantity("kg", Ge(0.0))
Damping: Any = optional("N*s/m", Ge(0.0))
DampingRatio: Any = optional("1", Ge(0.0))


class TunedMass(Section):
    """Angle, mass and spring; damping by `damping` or `damping_ratio` D2 = d2 / (2 sqrt(c2 m2)), or undamped."""

    declares: ClassVar = About("a tilted absorber; its inertia enters the normal force", hardware=True)

    angle: Angle
    mass: AbsorberMass
    stiffness: NewtonPerMetre
    damping: Damping = None
    damping_ratio: DampingRatio = None

    @field_validator("mass")
    @classmethod
    def _something(cls, mass: float) -> float:
        if mass == 0.0:
            raise ValueError("a tuned mass of 0 kg has no effect: leave [tuned_mass] out (-p tuned_mass=none)")
        return mass

    @model_validator(mode="after")
    def _one_damper(self) -> Self:
        if self.damping is not None and self.damping_ratio is not None:
            raise ValueError("damping and damping_ratio are both given; give one of them")
        return self

    @property
    def damper(self) -> float:
        """Damping constant d2 [N s/m]."""
        if self.damping_ratio is not None:
            return float(self.damping_ratio * 2.0 * math.sqrt(self.stiffness * self.mass))
        return self.damping or 0.0


def add(a: Assembly, tuned: TunedMass, normal: str, coordinate: str, arm: float = 1.0) -> None:
    """Add the absorber to the body of `coordinate`. `arm`: displacement along the belt [m] per unit of it."""
    s = math.sin(tuned.angle)
    c = math.cos(tuned.angle)
    a.coordinate("absorber", tuned.mass, tuned.damper, tuned.stiffness)
    a.mass[coordinate, coordinate] += tuned.mass * arm**2
    a.mass[coordinate, "absorber"] = a.mass["absorber", coordinate] = tuned.mass * s * arm
    add_row(a.load(normal), {"absorber": tuned.stiffness * c, "absorber'": tuned.damper * c})
    add_row(a.inertia(normal), {coordinate: tuned.mass * s * c * arm})
    a.own("tuned_mass", "absorber", "absorber'")
    a.outputs |= {
        "absorber_displacement": Output({"absorber": 1.0}, "m", Plot()),
        "absorber_velocity": Output({"absorber'": 1.0}, "m/s", Plot()),
    }
