"""Dahl: the friction force over the displacement is that of a soft solid; it does not depend on the slip speed.

In the direction of slip, with the deflection z [m] and u = 1 - sigma0 z / mu_kinetic:

    z' = w |u|^exponent sgn(u)             mu = sigma0 z, between -mu_kinetic and mu_kinetic

Over the slip s from a start u0 this is u = u0 exp(-sigma0 s / mu_kinetic) for exponent 1, and else u^(1 - exponent) =
u0^(1 - exponent) + (exponent - 1) sigma0 s / mu_kinetic. With `load`, mu_kinetic and sigma0 are forces as in `lugre`.

No true stick: a spring below the limit, which drifts under a load that varies, as with LuGre. Loops are
rate-independent. An explicit method is limited to steps of 3 mu_kinetic / (exponent sigma0 w 2^(exponent - 1)) after
a reversal; an implicit one is not.

Source: Dahl, A solid friction model, The Aerospace Corporation TOR-0158(3107-18)-1 (1968); AIAA J. 14 (1976) 1675.
"""

from __future__ import annotations

import math
from typing import Annotated, Any, ClassVar, Literal, NamedTuple

from pydantic import Field

from rig.about import About
from rig.laws import FrictionLaw, InternalState
from rig.laws.lugre import Exponent, PerLoad, PerMetre
from rig.quantities import PositiveNumber


class Numbers(NamedTuple):
    """The numbers of the law per newton of load."""

    exponent: float
    kinetic: float
    sigma0: float


class Dahl(PerLoad, FrictionLaw):
    """Dahl: friction follows the displacement after a reversal and approaches one coefficient."""

    declares: ClassVar = About("friction with presliding that does not depend on speed; the contact has no true stick")
    states: ClassVar = (InternalState("deflection", "m", along=True),)
    sticks: ClassVar = False
    forces: ClassVar[dict[str, str]] = {"mu_kinetic": "N", "sigma0": "N/m"}

    law: Literal["dahl"]
    mu_kinetic: Annotated[PositiveNumber, Field(title="kinetic coefficient of friction")]
    sigma0: PerMetre
    exponent: Exponent = 1.0

    def numbers(self) -> Any:
        """The numbers of the formulas."""
        return Numbers(self.exponent, *self.per_newton("mu_kinetic", "sigma0"))

    @staticmethod
    def mu(p, w, N, z):
        """The coefficient of friction."""
        return p.sigma0 * z[0]

    @staticmethod
    def rates(p, w, N, z, dz):
        """The rate of the deflection [m/s]."""
        u = 1.0 - p.sigma0 * z[0] / p.kinetic
        dz[0] = w * math.copysign(abs(u) ** p.exponent, u)

    @staticmethod
    def slopes(p, w, N, z, d):
        """Derivatives of the coefficient and of the rate with respect to w, N and the deflection."""
        u = 1.0 - p.sigma0 * z[0] / p.kinetic
        d[0, 0], d[0, 1], d[0, 2] = 0.0, 0.0, p.sigma0
        d[1, 0], d[1, 1] = math.copysign(abs(u) ** p.exponent, u), 0.0
        d[1, 2] = -w * p.exponent * abs(u) ** (p.exponent - 1.0) * p.sigma0 / p.kinetic

    @staticmethod
    def stored(p, N, z):
        """The energy of the deflection [J]."""
        return 0.5 * p.sigma0 * z[0] * z[0] * N
