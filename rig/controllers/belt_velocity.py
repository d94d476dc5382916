"""Belt-velocity feedback: the belt speed follows the velocity of the body.

    v_b = v0 + K x'        lowest <= v_b <= highest

With K above 1 the slip speed falls while the body moves against the belt, so a falling friction law damps. With K
between 0 and 1 the cycle grows. With K above 1 a sticking body accelerates the belt exponentially; therefore the limits
are part of the control law. For a pendulum the drive is commanded in rad/s; the design step gives the conversion.
Source: Kroeger, Neubauer, Popp (2008), equations 4.7 to 4.9.
"""

from __future__ import annotations

from typing import Any, Literal

from rig.controllers.blocks.base import OptionalSpeed
from rig.controllers.blocks.design import Rig
from rig.controllers.blocks.feedback import FeedbackSection, VelocityFeedback
from rig.controllers.blocks.velocity import designed
from rig.quantities import Number, Speed


class BeltVelocity(FeedbackSection):
    """Parameters; `nominal` is the belt speed v0 at the contact, by default that of the scene."""

    kind: Literal["belt_velocity"]
    gain: Number = 0.0
    nominal: OptionalSpeed = None
    lowest: Speed = 0.0
    highest: Speed = 0.25
    drive: str = "drive.speed"


class BeltVelocityFeedback(VelocityFeedback):
    """v_b = v0 + K x'."""

    direction = 1.0

    @staticmethod
    def design(rig: Rig, section: BeltVelocity) -> dict[str, Any]:
        """Numbers for the velocity, and the command per unit of the surface speed."""
        return designed(rig, section) | rig.commands_surface(section.drive)
