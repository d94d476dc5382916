"""An exponential fall over the slip speed v.

    mu = mu_dynamic + (mu_static - mu_dynamic) exp(-v / speed_scale)

Source: Kroeger, Neubauer, Popp, Phil. Trans. R. Soc. A 366 (2008) 785, figure 3, characteristic A; the formula is a
choice: the paper gives its shape.
"""

from __future__ import annotations

from typing import Annotated, Literal

from pydantic import Field

from rig.laws import FrictionLaw
from rig.model import friction_law
from rig.model.friction_law import Law
from rig.quantities import PositiveMetrePerSecond, Ratio


class Stribeck(FrictionLaw):
    """The Stribeck law: an exponential fall from the static to the dynamic coefficient."""

    law: Literal["stribeck"]
    mu_static: Annotated[Ratio, Field(title="static coefficient of friction")]
    mu_dynamic: Annotated[Ratio, Field(title="dynamic coefficient of friction")]
    speed_scale: PositiveMetrePerSecond

    def friction(self) -> Law:
        """The law for the solver."""
        return friction_law.stribeck(self.mu_static, self.mu_dynamic, self.speed_scale)
