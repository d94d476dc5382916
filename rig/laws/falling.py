"""A linear fall over the slip speed v, down to a floor.

    mu = max(mu_zero - slope v, mu_floor)

Source: Kroeger, Neubauer, Popp, Phil. Trans. R. Soc. A 366 (2008) 785, figure 3, characteristic B; the floor is a
choice.
"""

from __future__ import annotations

from typing import Annotated, Literal, Self

from pydantic import Field, model_validator

from rig.laws import FrictionLaw
from rig.model import friction_law
from rig.model.friction_law import Law
from rig.quantities import Ratio, SecondPerMetre


class Falling(FrictionLaw):
    """A coefficient that falls linearly with the slip speed, down to a floor."""

    law: Literal["falling"]
    mu_zero: Annotated[Ratio, Field(title="coefficient of friction at zero speed")]
    slope: SecondPerMetre
    mu_floor: Ratio = 0.0

    @model_validator(mode="after")
    def _floor_below(self) -> Self:
        if self.mu_floor > self.mu_zero:
            raise ValueError(f"mu_floor {self.mu_floor:g} is above mu_zero {self.mu_zero:g}")
        return self

    def friction(self) -> Law:
        """The law for the solver."""
        return friction_law.falling(self.mu_zero, self.slope, self.mu_floor)
