"""The Stribeck curve of a lubricated contact over the slip speed v: a fall with an exponent, and a viscous rise.

    mu = mu_dynamic + (mu_static - mu_dynamic) exp(-(v / speed_scale)^exponent) + viscous v

With the exponent 1 this is the law of Tustin, with 2 that of Bo and Pavelescu, which LuGre has in steady slip.

Source: Armstrong-Helouvry, Dupont, Canudas de Wit, Automatica 30 (1994) 1083, equation 5; Tustin, J. IEE 94 (1947) 143.
"""

from __future__ import annotations

import math
from typing import Annotated, Any, Literal, Self

from annotated_types import Ge, Le
from pydantic import Field, model_validator

from rig.laws import FrictionLaw
from rig.quantities import PositiveMetrePerSecond, Ratio, SecondPerMetre, quantity

Exponent: Any = quantity("1", Ge(1.0), Le(10.0))


class StribeckViscous(FrictionLaw):
    """The Stribeck curve with an exponent and a viscous part [s/m]."""

    law: Literal["stribeck_viscous"]
    mu_static: Annotated[Ratio, Field(title="static coefficient of friction")]
    mu_dynamic: Annotated[Ratio, Field(title="dynamic coefficient of friction")]
    speed_scale: PositiveMetrePerSecond
    exponent: Exponent = 2.0
    viscous: SecondPerMetre = 0.0

    @model_validator(mode="after")
    def _static_is_larger(self) -> Self:
        if self.mu_static < self.mu_dynamic:
            raise ValueError(
                f"mu_static {self.mu_static:g} is below mu_dynamic {self.mu_dynamic:g}; give at least the same value "
                '(the viscous part lets friction rise with the slip speed, and so does "strengthening")'
            )
        return self

    @staticmethod
    def mu(p: Any, w: float) -> float:
        """The coefficient of friction."""
        fall = math.exp(-((w / p.speed_scale) ** p.exponent))
        return p.mu_dynamic + (p.mu_static - p.mu_dynamic) * fall + p.viscous * w  # type: ignore[no-any-return]

    @staticmethod
    def slope(p: Any, w: float) -> float:
        """Its derivative with respect to w [s/m]."""
        u = w / p.speed_scale
        fall = math.exp(-(u**p.exponent)) * p.exponent * u ** (p.exponent - 1.0) / p.speed_scale
        return p.viscous - (p.mu_static - p.mu_dynamic) * fall  # type: ignore[no-any-return]
