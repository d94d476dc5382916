"""Rate and state friction of Dieterich and Ruina: contacts that grow stronger with their age.

The age theta [s] of the contacts is kept as psi = ln(speed theta / distance), which is 0 in steady slip at the
reference `speed`:

    mu = a asinh(w / (2 speed) exp((mu_reference + b psi) / a))
    ageing law   psi' = (speed exp(-psi) - w) / distance          theta' = 1 - w theta / distance
    slip law     psi' = -w (ln(w / speed) + psi) / distance       theta' = -(w theta / distance) ln(w theta / distance)

Steady slip: mu_reference + (a - b) ln(w / speed), which falls with the speed for b > a. On a spring such a contact
loses stability below the stiffness (b - a) N / distance (1 + m V^2 / (N a distance)).

The logarithm of the usual form, mu_reference + a ln(w / speed) + b psi, has no value at rest; asinh differs from it
by less than 1e-9 where friction exceeds 10 a. With the ageing law contacts age at rest, with the slip law they do
not. The slip law's logarithm is that of (w^2 + (1e-6 speed)^2)^0.5, so that it exists at rest.

No true stick: a contact under load creeps, and slower than any measurement. An explicit method is limited to steps of
3 distance / w, and on a mass m to 3 m w / (a N): tiny at the slow speeds at which such a contact spends its life. An
implicit method with step control has neither limit. Over decades of speed the motion is stiff; use `rosenbrock`. Creep
below 1e-16 of the speeds of the two sides is lost in their rounding: the run stops and says so.

Source: Dieterich, J. Geophys. Res. 84 (1979) 2161; Ruina, J. Geophys. Res. 88 (1983) 10359; asinh: Rice, Ben-Zion,
Proc. Natl. Acad. Sci. 93 (1996) 3811; critical stiffness with mass: Rice, Ruina, J. Appl. Mech. 50 (1983) 343.
"""

from __future__ import annotations

import math
from typing import Annotated, Any, ClassVar, Literal, NamedTuple, Self

from pydantic import Field, model_validator

from rig.about import About
from rig.laws import FrictionLaw, InternalState
from rig.quantities import PositiveMetre, PositiveMetrePerSecond, PositiveNumber, Ratio

_STEEPEST = 300.0  # mu_reference / a: exp of this and of a state beside it is far below the largest double
_LARGEST = 700.0  # of an exponent: e^710 overflows


class Numbers(NamedTuple):
    """The numbers of the law; `ageing` is 1 for the ageing law, 0 for the slip law."""

    mu: float
    a: float
    b: float
    speed: float
    distance: float
    ageing: float


def slip_factor(p, psi):
    """The factor c [s/m] of mu = a asinh(c w)."""
    return math.exp(min((p.mu + p.b * psi) / p.a, _LARGEST)) / (2.0 * p.speed)


class RateState(FrictionLaw):
    """Rate and state friction (Dieterich, Ruina) with the ageing or the slip law."""

    declares: ClassVar = About("friction that grows with the age of the contacts; the contact creeps and never sticks")
    states: ClassVar = (InternalState("state", "1"),)
    sticks: ClassVar = False

    law: Literal["rate_state"]
    mu_reference: Annotated[
        PositiveNumber, Field(title="coefficient of friction in steady slip at the reference speed")
    ]
    speed: Annotated[PositiveMetrePerSecond, Field(title="reference speed")]
    a: PositiveNumber
    b: Ratio
    distance: PositiveMetre
    evolution: Literal["ageing", "slip"] = "ageing"

    @model_validator(mode="after")
    def _finite(self) -> Self:
        if self.mu_reference > _STEEPEST * self.a:
            raise ValueError(
                f"a {self.a:g} is below mu_reference / {_STEEPEST:g}: the exponential of mu_reference / a exceeds all "
                f"numbers; give at least {self.mu_reference / _STEEPEST:g} (measured values: 0.005 to 0.02)"
            )
        return self

    def numbers(self) -> Any:
        """The numbers of the formulas."""
        return Numbers(self.mu_reference, self.a, self.b, self.speed, self.distance, float(self.evolution == "ageing"))

    @staticmethod
    def mu(p, w, N, z):
        """The coefficient of friction."""
        return p.a * math.asinh(slip_factor(p, z[0]) * w)

    @staticmethod
    def rates(p, w, N, z, dz):
        """The rate of the state [1/s]."""
        if p.ageing == 1.0:
            dz[0] = (p.speed * math.exp(min(-z[0], _LARGEST)) - w) / p.distance
        else:
            dz[0] = -w * (0.5 * math.log((w / p.speed) ** 2 + 1e-12) + z[0]) / p.distance

    @staticmethod
    def slopes(p, w, N, z, d):
        """Derivatives of the coefficient and of the rate with respect to w, N and the state."""
        c = slip_factor(p, z[0])
        root = math.hypot(1.0, c * w)
        d[0, 0], d[0, 1], d[0, 2] = p.a * c / root, 0.0, p.b * (c * w / root)
        d[1, 1] = 0.0
        if p.ageing == 1.0:
            d[1, 0], d[1, 2] = -1.0 / p.distance, -p.speed * math.exp(min(-z[0], _LARGEST)) / p.distance
        else:
            square = (w / p.speed) ** 2
            d[1, 0] = -(0.5 * math.log(square + 1e-12) + square / (square + 1e-12) + z[0]) / p.distance
            d[1, 2] = -w / p.distance
