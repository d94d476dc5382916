"""Separation: a contact spring that lifts off at N = 0 and may meet the surface again. Absent: it pulls as it presses.

Without it nothing but the end of slip bounds an unstable rig: that is how Liu and Ouyang compute it, who end a time
history at N = 0. With it, friction and contact spring are gone while the contact is open; the impact on the surface
is borne by the spring, no law of restitution is needed.
Source: Liu and Ouyang, Meccanica 55 (2020), section 2.
"""

from __future__ import annotations

from typing import ClassVar

from rig.about import About
from rig.quantities import Section


class Separation(Section):
    """The contact lifts off where its normal force would become negative. It has no numbers of its own."""

    declares: ClassVar = About("a contact spring that lifts off and comes back; without it the spring pulls as well")
