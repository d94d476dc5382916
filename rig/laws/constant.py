"""One coefficient `mu`, at rest and in slip."""

from __future__ import annotations

from typing import Annotated, Literal

from pydantic import Field

from rig.laws import FrictionLaw
from rig.model import friction_law
from rig.model.friction_law import Law
from rig.quantities import Ratio


class Constant(FrictionLaw):
    """One coefficient in stick and slip. It does not fall with the speed; instability then comes from mode coupling."""

    law: Literal["constant"]
    mu: Annotated[Ratio, Field(title="coefficient of friction")]

    def friction(self) -> Law:
        """The law for the solver."""
        return friction_law.coulomb(self.mu, self.mu)
