"""Velocity strengthening over the slip speed v: friction rises with its logarithm. Such a contact has no stick-slip.

    mu = mu_static + rise ln(1 + v / speed_scale)

Source: the steady state of rate and state friction with a > b, and with a cut-off at low speed: Ruina, J. Geophys. Res.
88 (1983) 10359; Bar-Sinai, Spatschek, Brener, Bouchbinder, J. Geophys. Res. Solid Earth 119 (2014) 1738.
"""

from __future__ import annotations

import math
from typing import Annotated, Any, Literal

from pydantic import Field

from rig.laws import FrictionLaw
from rig.quantities import PositiveMetrePerSecond, Ratio


class Strengthening(FrictionLaw):
    """A coefficient that rises by `rise` ln(10) per tenfold slip speed, well above `speed_scale`."""

    law: Literal["strengthening"]
    mu_static: Annotated[Ratio, Field(title="static coefficient of friction")]
    rise: Ratio
    speed_scale: PositiveMetrePerSecond

    @staticmethod
    def mu(p: Any, w: float) -> float:
        """The coefficient of friction."""
        return p.mu_static + p.rise * math.log1p(w / p.speed_scale)  # type: ignore[no-any-return]

    @staticmethod
    def slope(p: Any, w: float) -> float:
        """Its derivative with respect to w [s/m]."""
        return p.rise / (p.speed_scale + w)  # type: ignore[no-any-return]
