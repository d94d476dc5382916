"""A contact that moves over a flexible disc: the terms that depend on its position.

Friction and normal force act at the angle phi = s / r0 of the slider. Without `Geometry` they act at phi = 0, and only
the friction law is nonlinear. `Slope` is the component of the normal force along the inclined surface,
-N dw / (r0 dtheta) on the slider; the paper assumes a vertical normal force. Without `Slope` the energy balance of the
rig is not closed: the moving load does work on the disc that no other term supplies.
Source: Liu and Ouyang, Meccanica 55 (2020), equations 19, 29, 30 (geometry); slope derived.
"""

from __future__ import annotations

from typing import ClassVar

from rig.about import About
from rig.quantities import Section


class Geometry(Section):
    """The contact moves round the disc with the slider. The table has no parameters."""

    declares: ClassVar = About(
        "friction and normal force act at the place of the slider; without it at its initial place"
    )


class Slope(Section):
    """The normal force has a component along the inclined surface. The table has no parameters."""

    declares: ClassVar = About("the normal force pushes along the inclined surface")
