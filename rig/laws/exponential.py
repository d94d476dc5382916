"""An exponential fall over the slip speed v, with a decay constant.

    mu = mu_kinetic + (mu_static - mu_kinetic) exp(-decay v)

Source: Liu and Ouyang, the slider-on-disc rig.
"""

from __future__ import annotations

from contextlib import suppress
from typing import Annotated, Literal

from pydantic import Field, field_validator

from rig.laws import FrictionLaw
from rig.model import friction_law
from rig.model.friction_law import Law
from rig.quantities import PositiveSecondPerMetre, Ratio
from rig.units import si


class Exponential(FrictionLaw):
    """An exponential fall with the decay constant `decay` [s/m].

    A decay of zero is refused: the coefficient would be mu_static at every speed.
    """

    law: Literal["exponential"]
    mu_static: Annotated[Ratio, Field(title="static coefficient of friction")]
    mu_kinetic: Annotated[Ratio, Field(title="kinetic coefficient of friction")]
    decay: PositiveSecondPerMetre

    @field_validator("decay", mode="before")
    @classmethod
    def _falls(cls, decay: object) -> object:
        none = False
        with suppress(TypeError, ValueError):  # a value that is not a number is reported by the check of its type
            none = si(decay, "s/m") == 0.0
        if none:
            raise ValueError(
                'must be greater than 0 s/m: it would be mu_static at every speed; a sudden drop is "coulomb"'
            )
        return decay

    def friction(self) -> Law:
        """The law for the solver."""
        return friction_law.stribeck(self.mu_static, self.mu_kinetic, 1.0 / self.decay)
