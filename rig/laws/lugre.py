"""LuGre: bristles between the surfaces deflect like springs and slip like a Stribeck curve.

In the direction of slip, w >= 0, with the deflection z [m], positive where it pulls against the slip:

    z' = w (1 - sigma0 z / g(w))           g(w) = mu_kinetic + (mu_static - mu_kinetic) exp(-(w / speed_scale)^exponent)
    mu = sigma0 z + sigma1 z' + sigma2 w   steady slip: g(w) + sigma2 w

The coefficients belong to one newton of normal force, sigma0 in 1/m. Models in the literature state forces: with
`load` all five are forces under that load (N/m, N s/m, N), and the friction force changes in proportion to the load.

No true stick: below its limit the contact is a spring, which creeps under a load that varies (drift). Bristles relax
at the rate sigma0 w / g(w), which limits the step of an explicit method to about 3 g / (sigma0 w), and on a mass m to
3 / (sigma1 N / m) and 3 (m / (sigma0 N))^0.5. An implicit method (`rosenbrock`) has no such limit. Energy: with
constant sigma1 the model is passive only if sigma2 > sigma1 (mu_static - mu_kinetic) / mu_kinetic.

Source: Canudas de Wit, Olsson, Astroem, Lischinsky, IEEE Trans. Autom. Control 40 (1995) 419; the condition of
passivity: Barabanov, Ortega, IEEE Trans. Autom. Control 45 (2000) 830.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Annotated, Any, ClassVar, Literal, NamedTuple, Self

from annotated_types import Ge, Gt, Le
from pydantic import Field, model_validator

from rig.about import About
from rig.laws import FrictionLaw, InternalState
from rig.quantities import PositiveMetrePerSecond, PositiveNewton, PositiveNumber, SecondPerMetre, Section, quantity
from rig.units import si

PerMetre: Any = quantity("1/m", Gt(0.0))
Exponent: Any = quantity("1", Ge(1.0), Le(10.0))


class StribeckCurve(NamedTuple):
    """The coefficient in steady slip without its viscous part."""

    speed_scale: float
    exponent: float
    static: float
    kinetic: float


def limit(s, w):
    """The coefficient of the Stribeck curve `s` at slip speed w [m/s], and its slope [s/m].

    Below w = 0 the power is continued: by the same square, by the same line for exponent 1, else by zero.
    """
    u = w / s.speed_scale
    if s.exponent == 2.0:
        power, rise = u * u, 2.0 * u
    elif s.exponent == 1.0:
        power, rise = max(u, -1.0), 1.0 if u > -1.0 else 0.0
    else:
        power = max(u, 0.0) ** s.exponent
        rise = s.exponent * max(u, 0.0) ** (s.exponent - 1.0)
    drop = (s.static - s.kinetic) * math.exp(-power)
    return s.kinetic + drop, -drop * rise / s.speed_scale


class PerLoad(Section):
    """Coefficients that are stated as such or, with `load`, as the forces under that load [N].

    `forces`: the units of these forces by key. With `load`, a text with a unit is a force; a number is in SI units.
    """

    forces: ClassVar[dict[str, str]] = {}

    load: PositiveNewton | None = None

    @model_validator(mode="before")
    @classmethod
    def _as_forces(cls, given: Any) -> Any:
        if not isinstance(given, Mapping) or given.get("load") is None:
            return given
        texts = {key: unit for key, unit in cls.forces.items() if isinstance(given.get(key), str)}
        return {**given, **{key: si(given[key], unit) for key, unit in texts.items()}}

    def per_newton(self, *keys: str) -> Any:
        """The values of `keys` per newton of normal force."""
        return tuple(getattr(self, key) / (self.load or 1.0) for key in keys)


class SteadySlip(PerLoad):
    """The Stribeck curve of a law with presliding."""

    mu_static: Annotated[PositiveNumber, Field(title="static coefficient of friction")]
    mu_kinetic: Annotated[PositiveNumber, Field(title="kinetic coefficient of friction")]
    speed_scale: PositiveMetrePerSecond
    exponent: Exponent = 2.0

    @model_validator(mode="after")
    def _static_is_larger(self) -> Self:
        if self.mu_static < self.mu_kinetic:
            raise ValueError(
                f"mu_static {self.mu_static:g} is below mu_kinetic {self.mu_kinetic:g}; give at least the same value "
                "(the viscous part lets friction rise with the slip speed)"
            )
        return self

    def curve(self) -> StribeckCurve:
        """The Stribeck curve per newton of load."""
        return StribeckCurve(self.speed_scale, self.exponent, *self.per_newton("mu_static", "mu_kinetic"))


class Bristles(NamedTuple):
    """The numbers of the law per newton of load."""

    curve: StribeckCurve
    sigma0: float
    sigma1: float
    sigma2: float


class LuGre(SteadySlip, FrictionLaw):
    """LuGre: bristles deflect before they slip; steady slip follows a Stribeck curve with a viscous part."""

    declares: ClassVar = About(
        "friction with presliding and a lag behind the slip speed; the contact has no true stick"
    )
    states: ClassVar = (InternalState("deflection", "m", along=True),)
    sticks: ClassVar = False
    forces: ClassVar[dict[str, str]] = {
        "mu_static": "N",
        "mu_kinetic": "N",
        "sigma0": "N/m",
        "sigma1": "N*s/m",
        "sigma2": "N*s/m",
    }

    law: Literal["lugre"]
    sigma0: PerMetre
    sigma1: SecondPerMetre = 0.0
    sigma2: SecondPerMetre = 0.0

    def numbers(self) -> Any:
        """The numbers of the formulas."""
        return Bristles(self.curve(), *self.per_newton("sigma0", "sigma1", "sigma2"))

    @staticmethod
    def mu(p, w, N, z):
        """The coefficient of friction."""
        g, _ = limit(p.curve, w)
        return p.sigma0 * z[0] + p.sigma1 * (w * (1.0 - p.sigma0 * z[0] / g)) + p.sigma2 * w

    @staticmethod
    def rates(p, w, N, z, dz):
        """The rate of the deflection [m/s]."""
        g, _ = limit(p.curve, w)
        dz[0] = w * (1.0 - p.sigma0 * z[0] / g)

    @staticmethod
    def slopes(p, w, N, z, d):
        """Derivatives of the coefficient and of the rate with respect to w, N and the deflection."""
        g, slope = limit(p.curve, w)
        q = p.sigma0 * z[0] / g
        d[1, 0], d[1, 1], d[1, 2] = 1.0 - q + w * q * slope / g, 0.0, -w * p.sigma0 / g
        d[0, 0], d[0, 1], d[0, 2] = p.sigma1 * d[1, 0] + p.sigma2, 0.0, p.sigma0 + p.sigma1 * d[1, 2]

    @staticmethod
    def stored(p, N, z):
        """The energy of the bristles [J]."""
        return 0.5 * p.sigma0 * z[0] * z[0] * N
