"""Maxwell slip: several springs in parallel, each of which slips at its own share of the limit.

Element i, in the direction of slip, with the share u_i of its limit:

    z_i' = w min(1, (1 - u_i) / transition)     u_i = k_i z_i / (a_i g(w)),  g(w) as in `lugre`
    mu = sum of k_i z_i + viscous w             steady slip: g(w) + viscous w

An element sticks up to the share 1 - `transition` of its limit, and then approaches the limit over the slip distance
transition a_i g / k_i, exponentially. A transition of 1 is LuGre without sigma1; a small one gives loops of straight
lines, which obey Masing's rules: the limits are reached one after the other, and after a reversal at twice the
distance. Where g falls with the speed, friction lags behind it by that slip distance. `stiffness` k [1/m] and
`shares` a (their sum is 1) are lists of equal length; with `load`, mu_static, mu_kinetic, viscous and stiffness are
forces as in `lugre`.

No true stick: n springs, of which those that do not slip do not drift: a load below (1 - transition) of all limits
causes no drift. An explicit method is limited to steps of 3 transition a_i g / (k_i w); an implicit one is not. The
rate has a kink where an element begins to slip, which step control notices.

Source: Al-Bender, Lampaert, Swevers, IEEE Trans. Autom. Control 50 (2005) 1883 (generalised Maxwell slip); there an
element approaches its limit over time, here over slip distance, so that loops do not depend on the speed and no loop
gives energy.
"""

from __future__ import annotations

from typing import Annotated, Any, ClassVar, Literal, NamedTuple, Self

from annotated_types import Gt, Le
from pydantic import Field, model_validator

from rig.about import About
from rig.laws import FrictionLaw, InternalState
from rig.laws.lugre import PerMetre, SteadySlip, StribeckCurve, limit
from rig.quantities import SecondPerMetre, quantity

Share: Any = quantity("1", Gt(0.0), Le(1.0))
"""A share of a whole."""


class Elements(NamedTuple):
    """The numbers of the law per newton of load; `stiffness` and `shares` have one entry for each element."""

    curve: StribeckCurve
    transition: float
    stiffness: tuple[float, ...]
    shares: tuple[float, ...]
    viscous: float


class MaxwellSlip(SteadySlip, FrictionLaw):
    """Maxwell slip: springs in parallel that slip one after the other; loops remember every reversal."""

    declares: ClassVar = About("friction with presliding and nested loops; the contact has no true stick")
    sticks: ClassVar = False
    forces: ClassVar[dict[str, str]] = {
        "mu_static": "N",
        "mu_kinetic": "N",
        "viscous": "N*s/m",
        "stiffness": "N/m",
    }

    law: Literal["maxwell_slip"]
    viscous: SecondPerMetre = 0.0
    transition: Share = 0.01
    stiffness: Annotated[tuple[PerMetre, ...], Field(min_length=1, max_length=20)]
    shares: Annotated[tuple[Share, ...], Field(min_length=1, max_length=20)]

    @model_validator(mode="after")
    def _elements(self) -> Self:
        if len(self.stiffness) != len(self.shares):
            counts = f"{len(self.stiffness)} values of stiffness and {len(self.shares)} shares"
            raise ValueError(f"{counts}; give one of each for every element")
        if abs(sum(self.shares) - 1.0) > 1e-6:
            raise ValueError(f"the sum of the shares is {sum(self.shares):.6g}; it must be 1")
        return self

    @property
    def states(self) -> tuple[InternalState, ...]:  # type: ignore[override]
        """The deflection of each element."""
        return tuple(InternalState(f"deflection_{i + 1}", "m", along=True) for i in range(len(self.stiffness)))

    def numbers(self) -> Any:
        """The numbers of the formulas."""
        stiffness = tuple(k / (self.load or 1.0) for k in self.stiffness)
        return Elements(self.curve(), self.transition, stiffness, self.shares, *self.per_newton("viscous"))

    @staticmethod
    def mu(p, w, N, z):
        """The coefficient of friction."""
        mu = p.viscous * w
        for i in range(len(p.stiffness)):
            mu += p.stiffness[i] * z[i]
        return mu

    @staticmethod
    def rates(p, w, N, z, dz):
        """The rates of the deflections [m/s]."""
        g, _ = limit(p.curve, w)
        for i in range(len(p.stiffness)):
            u = p.stiffness[i] * z[i] / (p.shares[i] * g)
            dz[i] = w * min(1.0, (1.0 - u) / p.transition)

    @staticmethod
    def slopes(p, w, N, z, d):
        """Derivatives of the coefficient and of the rates with respect to w, N and the deflections."""
        g, slope = limit(p.curve, w)
        n = len(p.stiffness)
        for i in range(n + 1):
            for j in range(n + 2):
                d[i, j] = 0.0
        d[0, 0] = p.viscous
        for i in range(n):
            u = p.stiffness[i] * z[i] / (p.shares[i] * g)
            d[0, 2 + i] = p.stiffness[i]
            d[1 + i, 0] = 1.0
            if 1.0 - u < p.transition:
                d[1 + i, 0] = (1.0 - u + w * u * slope / g) / p.transition
                d[1 + i, 2 + i] = -w * p.stiffness[i] / (p.shares[i] * g * p.transition)

    @staticmethod
    def stored(p, N, z):
        """The energy of the springs [J]."""
        energy = 0.0
        for i in range(len(p.stiffness)):
            energy += 0.5 * p.stiffness[i] * z[i] * z[i] * N
        return energy
