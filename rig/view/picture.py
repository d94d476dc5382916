"""Selects the moving picture of a rig, which its plant declares (rig.picture) and its outputs move.

Each picture has its own module: `pendulum` and `belt` (with variants of these two), `lever`, `four_dof`, `beam` (the
tip of a beam), `brake`, `plate`, `surfaces` (maps of contacts). `base` is the common part.

Motions of body and surface have the same magnification, so that they move together in stick. The body has the colour of
the contact state; arrows show friction and normal force. Geometry is sent once; a frame contains a few transforms.
"""

from __future__ import annotations

import importlib
from typing import Any

from rig import picture
from rig.model.assembly import Assembly
from rig.model.system import System
from rig.scenes.rooms import plant_of
from rig.scenes.scene import Scene
from rig.view.base import Picture, scale_of
from rig.view.belt import Belt
from rig.view.pendulum import Pendulum


def picture_of(scene: Scene, assembly: Assembly, system: System) -> Picture | None:
    """The first picture that the plant of `scene` declares and whose outputs the rig has; None if there is none.

    `assembly`, `system`: those of the scene.
    """
    declared: tuple[picture.Picture, ...] = getattr(plant_of(scene.parameters), "PICTURES", ())
    drawable = (candidate for candidate in declared if assembly.outputs.keys() >= set(candidate.outputs))
    declaration = next(drawable, None)
    if isinstance(declaration, picture.OnBelt):
        return Belt(scale_of(system), declaration)
    if isinstance(declaration, picture.OnDisc):
        return Pendulum(scale_of(system), declaration)
    if declaration is None:
        return None
    drawer: type[Picture] = drawer_of(declaration, scene)
    return drawer.of(scene, assembly, system)


def drawer_of(own: picture.Own, scene: Scene) -> Any:
    """The class or function that a picture or figure of its own names; one without a module is in the plant's file."""
    module, _, name = own.drawer.partition(":")
    return getattr(importlib.import_module(module) if module else plant_of(scene.parameters), name)
