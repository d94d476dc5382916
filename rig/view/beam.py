"""The moving picture of the tip of a clamped beam: the beam hangs from its clamp, its tip rubs on the disc."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Self

import numpy as np

from rig.model.assembly import Assembly
from rig.model.system import System
from rig.scenes.scene import Scene
from rig.view import base
from rig.view.belt import Belt

_REACH = 0.5  # largest displacement of the tip in the picture [lengths]
_CLAMP = np.array((-0.12, 0.0, 0.9))
_TIP = np.array((0.0, 0.0, 0.1))


class Tip(Belt):
    """The beam and its tip from the side; the disc moves to the right.

    The beam has the static shape for a force at its tip; higher vibration modes are not drawn.
    """

    eye = (0.1, -2.9, 1.3)
    target = (-0.05, 0.0, 0.42)

    @classmethod
    def of(cls, scene: Scene, assembly: Assembly, system: System) -> Self:
        """See `Picture.of`."""
        return cls(scale(system))

    def static(self, log: base.Log) -> None:
        """See `Picture.static`."""
        super().static(log)
        log("rig/mass/body", base.Shape("Boxes3D", half_sizes=[(0.07, 0.16, 0.05)], centers=[(0, 0, 0.06)]))
        log("rig/wall", base.Shape.box((0.2, 0.3, 0.09), (-0.12, 0.0, 0.99)))

    def _frames(
        self, t_ns: base.Integers, s: Mapping[str, base.Reals], modes: base.Integers, ran: base.Reals
    ) -> list[base.Columns]:
        drawn = {columns.path: columns for columns in super()._frames(t_ns, s, modes, ran)}
        x = self.scale.motion * s["displacement"]
        share = np.linspace(0.0, 1.0, 16)[:, None]
        bent = 0.5 * share[:, 0] ** 2 * (3.0 - share[:, 0])  # shape of a clamped beam under a force at its end
        strips = np.tile(_CLAMP + share * (_TIP - _CLAMP), (len(x), 1, 1))
        strips[:, :, 0] += x[:, None] * bent
        heads = np.stack((x + 0.2, np.zeros_like(x), np.full_like(x, 0.02)), axis=1)
        drawn["rig/spring"] = base.spring(t_ns, strips, radius=0.03)
        drawn["rig/load"] = self._load(t_ns, heads, s["normal_force"])
        return list(drawn.values())


def scale(system: System) -> base.Scale:
    """The scale for a rig: static friction, with the normal force that it leaves, deflects it by `_REACH` at most."""
    patch = system.patches[0]
    normal = system.normals[0]
    count = len(system.coordinates)
    load = float(normal.row @ system.start)
    mu = patch.law.at_rest(load)
    force = mu * load
    push = normal.direction + mu * patch.direction
    stiffness = system.stiffness - np.outer(push, normal.row[:count])
    bent = np.linalg.solve(stiffness, patch.direction * force)
    reach = abs(float(patch.direction @ bent))
    return base.Scale(base.round_down(_REACH / reach) if reach else 1.0, force or 1.0)
