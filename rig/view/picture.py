"""The rig as a moving picture, drawn from its outputs as its plant declares it (rig.picture).

Each picture has a module of its own: `pendulum`, `belt`, `lumped` (rigs like these two), `lever`, `three_bodies`,
`beam` (a tip of a beam), `brake`, `plate`. `base` is what they have in common.

Motions are magnified, arm and disc (mass and belt) alike, so that in stick they move as one. The shoe has the colour of
the contact mode; arrows show friction and normal force. Geometry is sent once; a frame is a few transforms.
"""

from __future__ import annotations

import importlib

from rig import picture
from rig.model.assembly import Assembly
from rig.model.system import System
from rig.scenes.rooms import plant_of
from rig.scenes.scene import Scene
from rig.view.base import Picture, scale_of
from rig.view.belt import Belt
from rig.view.pendulum import Pendulum


def picture_of(scene: Scene, assembly: Assembly, system: System) -> Picture | None:
    """The first picture that the plant of `scene` declares and whose outputs there are; None without one.

    `assembly`, `system`: those of the scene.
    """
    declared: tuple[picture.Picture, ...] = getattr(plant_of(scene.parameters), "PICTURES", ())
    found = next((one for one in declared if assembly.outputs.keys() >= set(one.outputs)), None)
    if isinstance(found, picture.OnBelt):
        return Belt(scale_of(system), found)
    if isinstance(found, picture.OnDisc):
        return Pendulum(scale_of(system), found)
    if found is None:
        return None
    module, _, name = found.drawer.partition(":")
    drawer: type[Picture] = getattr(importlib.import_module(module), name)
    return drawer.of(scene, assembly, system)
