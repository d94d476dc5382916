"""The measured force of a lubricated seal over the slip speed v.

    mu = (mixed_force / (1 + decay v) + film (v + offset)^0.5) / load

Source: Kroeger, Neubauer, Popp, Phil. Trans. R. Soc. A 366 (2008) 785, equation 3.1.
"""

from __future__ import annotations

from typing import Literal

from rig.laws import FrictionLaw
from rig.model import friction_law
from rig.model.friction_law import Law
from rig.quantities import (
    NewtonPerRootSpeed,
    NonNegativeNewton,
    PositiveMetrePerSecond,
    PositiveNewton,
    PositiveSecondPerMetre,
)


class Seal(FrictionLaw):
    """The friction force of a lubricated seal, measured over speed under the normal force `load` [N].

    Under another normal force the friction force changes in proportion.
    """

    law: Literal["seal"]
    load: PositiveNewton
    mixed_force: NonNegativeNewton
    decay: PositiveSecondPerMetre
    film: NewtonPerRootSpeed
    offset: PositiveMetrePerSecond

    def friction(self) -> Law:
        """The law for the solver."""
        return friction_law.seal(self.mixed_force / self.load, self.decay, self.film / self.load, self.offset)
