"""The moving picture of a rig in plain data; the page draws it from the outputs of the rig."""

from __future__ import annotations

from dataclasses import asdict
from typing import Any

from rig import picture
from rig.model.assembly import Assembly
from rig.model.system import System
from rig.scenes.rooms import plant_of
from rig.scenes.scene import Scene
from rig.view.base import scale_of


def picture_of(scene: Scene, assembly: Assembly, system: System) -> dict[str, Any] | None:
    """The first declared picture whose outputs the rig has; None if there is none.

    `kind` is "on_belt", "on_disc" or "own", the other entries are the fields of the declaration (`rig.picture`).
    Motions are magnified `motion` times; `force` [N] is a typical friction force.
    """
    declared: tuple[picture.Picture, ...] = getattr(plant_of(scene.parameters), "PICTURES", ())
    found = next((one for one in declared if assembly.outputs.keys() >= set(one.outputs)), None)
    if found is None:
        return None
    kind = {picture.OnBelt: "on_belt", picture.OnDisc: "on_disc"}.get(type(found), "own")
    return {"kind": kind, **asdict(found), "outputs": list(found.outputs), **scale_of(system)._asdict()}
