"""One law for each direction of slip, as of a surface with a grain, a fabric or a worn track.

Slip is forward where the surface moves faster along the contact's direction than the body. A contact that sticks is
released forward at the static coefficient of `forward`, backward at that of `backward`. Both laws dissipate energy, so
their combination does too. It has no formula of its own: the sources are those of the two laws.
"""

from __future__ import annotations

from dataclasses import replace
from typing import Literal, Self

from pydantic import model_validator

from rig.laws import Friction, FrictionLaw
from rig.model.friction_law import Law


class Directional(FrictionLaw):
    """Two laws over the slip speed, `forward` and `backward`."""

    law: Literal["directional"]
    forward: Friction
    backward: Friction

    @model_validator(mode="after")
    def _over_speed(self) -> Self:
        for name, half in (("forward", self.forward), ("backward", self.backward)):
            if half.states or isinstance(half, Directional):
                raise ValueError(
                    f"{name}: {half.law} has internal states or directions; give a law over the slip speed"
                )
        return self

    def friction(self) -> Law:
        """The law for the solver."""
        return replace(self.forward.friction(), backward=self.backward.friction())
