"""Friction that falls with the temperature of the contact, which friction heats and the surroundings cool.

With the rise T [K] of a lumped contact above its surroundings:

    capacity T' = share mu N w - cooling T
    mu = (mu_hot + (mu_cold - mu_hot) exp(-T / temperature_scale)) (1 + (static_ratio - 1) exp(-w / speed_scale))

`share`: the part of the heat of friction that enters the contact. Without `static_ratio` (1) the static and the
kinetic coefficient are equal. The energy balance counts capacity T as stored; what cools away, or never entered, is
dissipated.

True stick: the contact rests exactly, while it cools with the time constant capacity / cooling. This slow state
limits no step.

Source: lumped form of flash temperature theory; Blok, Proc. Inst. Mech. Eng. 2 (1937) 222; fading of brakes:
Ostermeyer, Wear 254 (2003) 852. The exponential is a choice.
"""

from __future__ import annotations

import math
from typing import Annotated, Any, ClassVar, Literal, NamedTuple, Self

from annotated_types import Ge, Gt, Le
from pydantic import Field, model_validator

from rig.about import About
from rig.laws import FrictionLaw, InternalState
from rig.quantities import PositiveMetrePerSecond, PositiveNumber, quantity

Share: Any = quantity("1", Ge(0.0), Le(1.0))
AtLeastOne: Any = quantity("1", Ge(1.0))
Kelvin: Any = quantity("K", Gt(0.0))
JoulePerKelvin: Any = quantity("J/K", Gt(0.0))
WattPerKelvin: Any = quantity("W/K", Ge(0.0))


class Numbers(NamedTuple):
    """The numbers of the law."""

    cold: float
    hot: float
    scale: float
    surplus: float
    speed_scale: float
    share: float
    capacity: float
    cooling: float


def parts(p, w, z):
    """The factor of the temperature and that of the speed, and their derivatives."""
    fall = (p.cold - p.hot) * math.exp(-max(z, -p.scale) / p.scale)
    rise = p.surplus * math.exp(-max(w, -p.speed_scale) / p.speed_scale)
    return p.hot + fall, 1.0 + rise, -fall / p.scale, -rise / p.speed_scale


class ContactTemperature(FrictionLaw):
    """Friction that falls with the temperature of a lumped contact."""

    declares: ClassVar = About("friction heats the contact and falls with its temperature")
    states: ClassVar = (InternalState("temperature_rise", "K"),)
    sticks: ClassVar = True

    law: Literal["contact_temperature"]
    mu_cold: Annotated[PositiveNumber, Field(title="coefficient of friction of the cold contact")]
    mu_hot: Annotated[PositiveNumber, Field(title="coefficient of friction of the hot contact")]
    temperature_scale: Kelvin
    static_ratio: AtLeastOne = 1.0
    speed_scale: PositiveMetrePerSecond = 0.01
    share: Share = 1.0
    capacity: JoulePerKelvin
    cooling: WattPerKelvin

    @model_validator(mode="after")
    def _falls(self) -> Self:
        if self.mu_hot > self.mu_cold:
            raise ValueError(f"mu_hot {self.mu_hot:g} is above mu_cold {self.mu_cold:g}; give at most the same value")
        return self

    def numbers(self) -> Any:
        """The numbers of the formulas."""
        return Numbers(
            self.mu_cold,
            self.mu_hot,
            self.temperature_scale,
            self.static_ratio - 1.0,
            self.speed_scale,
            self.share,
            self.capacity,
            self.cooling,
        )

    @staticmethod
    def mu(p, w, N, z):
        """The coefficient of friction."""
        warm, slow, _, _ = parts(p, w, z[0])
        return warm * slow

    @staticmethod
    def rates(p, w, N, z, dz):
        """The rate of the temperature [K/s]."""
        warm, slow, _, _ = parts(p, w, z[0])
        dz[0] = (p.share * warm * slow * N * w - p.cooling * z[0]) / p.capacity

    @staticmethod
    def slopes(p, w, N, z, d):
        """Derivatives of the coefficient and of the rate with respect to w, N and the temperature."""
        warm, slow, over_z, over_w = parts(p, w, z[0])
        d[0, 0], d[0, 1], d[0, 2] = warm * over_w, 0.0, over_z * slow
        d[1, 0] = p.share * N * (d[0, 0] * w + warm * slow) / p.capacity
        d[1, 1] = p.share * warm * slow * w / p.capacity
        d[1, 2] = (p.share * d[0, 2] * N * w - p.cooling) / p.capacity

    @staticmethod
    def stored(p, N, z):
        """The heat in the contact [J]."""
        return p.capacity * z[0]
