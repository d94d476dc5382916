"""The moving picture of the tip of a clamped beam: the beam hangs from its clamp, its tip rubs on the disc."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING, Self

import numpy as np

from rig.model.system import System
from rig.view.base import Scale, round_down
from rig.view.belt import Belt
from rig.view.shapes import STEEL, Columns, Integers, Log, Reals, Shape, load, spring

if TYPE_CHECKING:
    from rig.model.assembly import Assembly
    from rig.scenes.scene import Scene

_REACH = 0.5
"""Largest displacement of the tip in the picture [lengths]."""
_CLAMP, _TIP = np.array((-0.12, 0.0, 0.9)), np.array((0.0, 0.0, 0.1))


def scale(system: System) -> Scale:
    """The scale for a rig: static friction, with the normal force that it leaves, deflects it by `_REACH` at most."""
    patch, normal, count = system.patches[0], system.normals[0], len(system.coordinates)
    force = patch.law.static * float(normal.row @ system.start)
    push = normal.direction + patch.law.static * patch.direction
    bent = np.linalg.solve(system.stiffness - np.outer(push, normal.row[:count]), patch.direction * force)
    reach = abs(float(patch.direction @ bent))
    return Scale(round_down(_REACH / reach) if reach else 1.0, force or 1.0)


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

    def static(self, log: Log) -> None:
        """See `Picture.static`."""
        super().static(log)
        body = Shape("Boxes3D", half_sizes=[(0.07, 0.16, 0.05)], centers=[(0, 0, 0.06)])
        log("rig/mass/body", body)
        block = Shape("Boxes3D", half_sizes=[(0.2, 0.3, 0.09)], centers=[(-0.12, 0.0, 0.99)], colors=[STEEL])
        log("rig/wall", block)

    def _frames(self, t_ns: Integers, s: Mapping[str, Reals], modes: Integers, ran: Reals) -> list[Columns]:
        drawn = {one.path: one for one in super()._frames(t_ns, s, modes, ran)}
        x = self.scale.motion * s["displacement"]
        share = np.linspace(0.0, 1.0, 16)[:, None]
        bent = 0.5 * share[:, 0] ** 2 * (3.0 - share[:, 0])  # shape of a clamped beam under a force at its end
        strips = np.tile(_CLAMP + share * (_TIP - _CLAMP), (len(x), 1, 1))
        strips[:, :, 0] += x[:, None] * bent
        drawn["rig/spring"] = spring(t_ns, strips, radius=0.03)
        heads = np.stack((x + 0.2, np.zeros_like(x), np.full_like(x, 0.02)), axis=1)
        drawn["rig/load"] = load(t_ns, heads, s["normal_force"] / self.scale.force * 0.25, self.normal)
        return list(drawn.values())
