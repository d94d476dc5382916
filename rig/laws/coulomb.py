"""One coefficient at rest, another one in slip.

    mu = mu_static at rest, mu_kinetic in slip

Source: Kroeger, Neubauer, Popp, Phil. Trans. R. Soc. A 366 (2008) 785, figure 3, characteristic C.
"""

from __future__ import annotations

from typing import Annotated, Literal, Self

from pydantic import Field, model_validator

from rig.laws import FrictionLaw
from rig.model import friction_law
from rig.model.friction_law import Law
from rig.quantities import Ratio


class Coulomb(FrictionLaw):
    """Coulomb friction: one coefficient in stick, one in slip."""

    law: Literal["coulomb"]
    mu_static: Annotated[Ratio, Field(title="static coefficient of friction")]
    mu_kinetic: Annotated[Ratio, Field(title="kinetic coefficient of friction")]

    @model_validator(mode="after")
    def _static_is_larger(self) -> Self:
        if self.mu_static < self.mu_kinetic:
            raise ValueError(
                f"mu_static {self.mu_static:g} is below mu_kinetic {self.mu_kinetic:g}: a contact that begins to slip "
                "would stick again immediately, and stick would end immediately; give at least the same value"
            )
        return self

    def friction(self) -> Law:
        """The law for the solver."""
        return friction_law.coulomb(self.mu_static, self.mu_kinetic)
