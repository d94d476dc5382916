"""Elasto-plastic friction: LuGre whose bristles do not slip at all below a limit, so that nothing drifts there.

    z' = w (1 - alpha sigma0 z / g(w))     mu = sigma0 z + sigma1 z' + sigma2 w     g(w) and coefficients as in `lugre`
    alpha = 0                              sigma0 z <= mu_elastic: a spring
            (1 - cos(pi s)) / 2            between, s = (sigma0 z - mu_elastic) / (g(w) - mu_elastic)
            1                              sigma0 z >= g(w): steady slip

mu_elastic is a share `elastic` of mu_kinetic. A deflection against the slip (z < 0, after a reversal) is elastic too.

No true stick, but below mu_elastic N the contact is a spring whose offset never changes: the drift is zero. Step
limits and method are those of `lugre`; the second derivative of alpha jumps at both ends, which step control notices.

Source: Dupont, Hayward, Armstrong, Altpeter, IEEE Trans. Autom. Control 47 (2002) 787, with the exponent i = 1.
"""

from __future__ import annotations

import math
from typing import Any, ClassVar, Literal, NamedTuple

from annotated_types import Gt, Lt

from rig.about import About
from rig.laws import FrictionLaw, InternalState
from rig.laws.lugre import PerMetre, SteadySlip, StribeckCurve, limit
from rig.quantities import SecondPerMetre, quantity

Share: Any = quantity("1", Gt(0.0), Lt(1.0))


class Bristles(NamedTuple):
    """The numbers of the law per newton of load; `elastic`: the coefficient up to which nothing slips."""

    curve: StribeckCurve
    elastic: float
    sigma0: float
    sigma1: float
    sigma2: float


def slipping(f, elastic, g):
    """Alpha at the coefficient f = sigma0 z of the bristles, and its derivatives with respect to f and g."""
    if f <= elastic:
        return 0.0, 0.0, 0.0
    if f >= g:
        return 1.0, 0.0, 0.0
    s = (f - elastic) / (g - elastic)
    rise = 0.5 * math.pi * math.sin(math.pi * s) / (g - elastic)
    return 0.5 * (1.0 - math.cos(math.pi * s)), rise, -rise * s


class ElastoPlastic(SteadySlip, FrictionLaw):
    """Elasto-plastic friction: purely elastic below a limit, without drift; above it like LuGre."""

    declares: ClassVar = About(
        "friction with presliding that does not drift below a limit; the contact has no true stick"
    )

    states: ClassVar = (InternalState("deflection", "m", along=True),)
    sticks: ClassVar = False
    forces: ClassVar[dict[str, str]] = {
        "mu_static": "N",
        "mu_kinetic": "N",
        "sigma0": "N/m",
        "sigma1": "N*s/m",
        "sigma2": "N*s/m",
    }

    law: Literal["elasto_plastic"]
    sigma0: PerMetre
    sigma1: SecondPerMetre = 0.0
    sigma2: SecondPerMetre = 0.0
    elastic: Share = 0.7

    def numbers(self) -> Any:
        """The numbers of the formulas."""
        curve = self.curve()
        return Bristles(curve, self.elastic * curve.kinetic, *self.per_newton("sigma0", "sigma1", "sigma2"))

    @staticmethod
    def mu(p, w, N, z):
        """The coefficient of friction."""
        g, _ = limit(p.curve, w)
        f = p.sigma0 * z[0]
        alpha, _, _ = slipping(f, p.elastic, g)
        return f + p.sigma1 * (w * (1.0 - alpha * f / g)) + p.sigma2 * w

    @staticmethod
    def rates(p, w, N, z, dz):
        """The rate of the deflection [m/s]."""
        g, _ = limit(p.curve, w)
        f = p.sigma0 * z[0]
        alpha, _, _ = slipping(f, p.elastic, g)
        dz[0] = w * (1.0 - alpha * f / g)

    @staticmethod
    def slopes(p, w, N, z, d):
        """Derivatives of the coefficient and of the rate with respect to w, N and the deflection."""
        g, slope = limit(p.curve, w)
        f = p.sigma0 * z[0]
        alpha, over_f, over_g = slipping(f, p.elastic, g)
        d[1, 0] = 1.0 - alpha * f / g + w * f / g * (alpha / g - over_g) * slope
        d[1, 1] = 0.0
        d[1, 2] = -w * (over_f * f + alpha) / g * p.sigma0
        d[0, 0], d[0, 1], d[0, 2] = p.sigma1 * d[1, 0] + p.sigma2, 0.0, p.sigma0 + p.sigma1 * d[1, 2]

    @staticmethod
    def stored(p, N, z):
        """The energy of the bristles [J]."""
        return 0.5 * p.sigma0 * z[0] * z[0] * N
