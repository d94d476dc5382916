"""Static friction that grows with the time of stick: a contact that has rested longer needs more force to break away.

    mu = mu_kinetic + viscous w + psi                                      static coefficient: mu_kinetic + psi
    exponential   psi' = (rise - psi) / time - w psi / distance            at rest psi = rise (1 - exp(-t / time))
    logarithmic   psi' = rise / time exp(-psi / rise) - w psi / distance   at rest psi = rise ln(1 + t / time)

The logarithmic growth has no bound. After breakaway the surplus psi decays over the slip `distance`. Contacts also
renew themselves while they slip, so that slow steady slip has more friction: psi = rise / (1 + w time / distance)
with the exponential growth.

True stick: the contact rests exactly, and its release is an event. In stick an exponential psi changes like e^(-t /
time), without a step limit of note; in slip an explicit method is limited to steps of 3 distance / w.

Source: exponential: Brockley, Davis, J. Lubric. Technol. 90 (1968) 35; logarithmic: Dieterich, J. Geophys. Res. 77
(1972) 3690.
"""

from __future__ import annotations

import math
from typing import Annotated, Any, ClassVar, Literal, NamedTuple

from pydantic import Field

from rig.about import About
from rig.laws import FrictionLaw, InternalState
from rig.quantities import PositiveMetre, PositiveNumber, PositiveSecond, SecondPerMetre


class Numbers(NamedTuple):
    """The numbers of the law; `bounded` is 1 for the exponential growth, 0 for the logarithmic one."""

    kinetic: float
    viscous: float
    rise: float
    time: float
    distance: float
    bounded: float


class StickTime(FrictionLaw):
    """Static friction that grows with the time of stick and decays over a slip distance."""

    declares: ClassVar = About("static friction grows while the contact sticks")
    states: ClassVar = (InternalState("surplus", "1"),)
    sticks: ClassVar = True

    law: Literal["stick_time"]
    mu_kinetic: Annotated[PositiveNumber, Field(title="kinetic coefficient of friction")]
    viscous: SecondPerMetre = 0.0
    rise: Annotated[PositiveNumber, Field(title="growth of the static coefficient")]
    time: PositiveSecond
    distance: PositiveMetre
    growth: Literal["exponential", "logarithmic"] = "exponential"

    def numbers(self) -> Any:
        """The numbers of the formulas."""
        bounded = float(self.growth == "exponential")
        return Numbers(self.mu_kinetic, self.viscous, self.rise, self.time, self.distance, bounded)

    @staticmethod
    def mu(p, w, N, z):
        """The coefficient of friction."""
        return p.kinetic + p.viscous * w + z[0]

    @staticmethod
    def rates(p, w, N, z, dz):
        """The rate of the surplus [1/s]."""
        if p.bounded == 1.0:
            growth = (p.rise - z[0]) / p.time
        else:
            growth = p.rise / p.time * math.exp(min(-z[0] / p.rise, 700.0))
        dz[0] = growth - w * z[0] / p.distance

    @staticmethod
    def slopes(p, w, N, z, d):
        """Derivatives of the coefficient and of the rate with respect to w, N and the surplus."""
        d[0, 0], d[0, 1], d[0, 2] = p.viscous, 0.0, 1.0
        d[1, 0], d[1, 1] = -z[0] / p.distance, 0.0
        if p.bounded == 1.0:
            d[1, 2] = -1.0 / p.time - w / p.distance
        else:
            d[1, 2] = -math.exp(min(-z[0] / p.rise, 700.0)) / p.time - w / p.distance
