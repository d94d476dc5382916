"""Normal-force feedback: a smaller normal force while the body moves with the belt, a larger one against it.

    F_N = F0 - K x'        lowest <= F_N <= highest

Friction then dissipates energy of the oscillation: for small amplitudes the damping is d - F0 |dmu/dv| + mu(v0) K.
A contact cannot pull, so `lowest` is at least zero.
Source: Kroeger, Neubauer, Popp (2008), equation 4.6.
"""

from __future__ import annotations

from typing import Any, Literal

from rig.controllers.blocks.base import ForcePerSpeed, OptionalForce
from rig.controllers.blocks.design import Rig
from rig.controllers.blocks.feedback import FeedbackSection, VelocityFeedback
from rig.controllers.blocks.velocity import designed
from rig.quantities import NonNegativeNewton


class NormalForce(FeedbackSection):
    """Parameters; `nominal` is the load F0, by default that of the scene."""

    kind: Literal["normal_force"]
    gain: ForcePerSpeed = 0.0
    nominal: OptionalForce = None
    lowest: NonNegativeNewton = 0.0
    highest: NonNegativeNewton = 100.0
    drive: str = "load.force"


class NormalForceFeedback(VelocityFeedback):
    """The controller F_N = F0 - K x'."""

    direction = -1.0

    @staticmethod
    def design(rig: Rig, section: NormalForce) -> dict[str, Any]:
        """Numbers for the velocity, and the command per unit of the normal force."""
        return designed(rig, section) | rig.commands_load(section.drive)
