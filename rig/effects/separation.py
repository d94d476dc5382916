"""Separation: a contact spring that lifts off at N = 0 and may meet the surface again. Absent: the spring also pulls.

Without separation only stick bounds the vibration of an unstable rig. Liu and Ouyang compute it so and end a time
history at N = 0. With separation, friction and the force of the contact spring are zero while the contact is open. The
spring takes the impact on the surface; no law of restitution is needed.
Source: Liu and Ouyang, Meccanica 55 (2020), section 2.
"""

from __future__ import annotations

from typing import ClassVar

from rig.about import About
from rig.quantities import Section


class Separation(Section):
    """The contact lifts off where its normal force would become negative. The table has no parameters."""

    declares: ClassVar = About(
        "a contact spring that lifts off and meets the surface again; without it the spring also pulls"
    )
