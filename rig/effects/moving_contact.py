"""A contact that moves over a flexible disc: what depends on how far it has moved, beside the terms at its first place.

Friction and normal force act at the angle phi = s / r0 of the slider. Without `Geometry` that place stays where it is,
phi = 0, and the equations are linear but for the friction law. `Slope` is what the normal force, upright in the paper,
pushes along a surface that is inclined: -N dw / (r0 dtheta) on the slider. Without it the rig is not consistent in
energy: the moving load does work on the disc that nobody pays for.
Source: Liu and Ouyang, Meccanica 55 (2020), equations 19, 29, 30 (geometry); slope derived.
"""

from __future__ import annotations

from typing import ClassVar

from rig.about import About
from rig.quantities import Section


class Geometry(Section):
    """The contact moves round with the slider. It has no numbers of its own."""

    declares: ClassVar = About("the contact moves round with the slider; without it, it stays where it was")


class Slope(Section):
    """The normal force pushes along the inclined surface. It has no numbers of its own."""

    declares: ClassVar = About("the normal force pushes along the inclined surface")
