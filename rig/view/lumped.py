"""The moving pictures of north and disc_slider: variants of those of the belt and the pendulum."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

from rig.view.belt import ACROSS, GAP, Belt
from rig.view.pendulum import Pendulum, disc
from rig.view.shapes import STEEL, Columns, Integers, Log, Reals, Shape, about, along, load, spring, zigzag

_PLACE = 0.83  # radius of the slider
_STAND = np.array((_PLACE, -0.9, 0.3))


class Tilting(Belt):
    """The body of the rig north, which moves towards the surface and rotates about its centre."""

    def _placed(self, s: Mapping[str, Reals]) -> dict[str, Any]:
        down, half = self.scale.motion * s["displacement"], 0.5 * self.scale.motion * s["tilt"]
        zero = np.zeros_like(down)
        return {
            "translation": np.stack((zero, zero, GAP - down), axis=1),
            "quaternion": np.stack((zero, np.sin(half), zero, np.cos(half)), axis=1),
        }


class Slider(Pendulum):
    """A slider on a rotating flexible disc; it moves along the disc and up and down.

    The rotation of the disc is not magnified: at the magnification of the motion it would be a blur.
    """

    def static(self, log: Log) -> None:
        """See `Picture.static`."""
        disc(log)
        body = Shape("Boxes3D", half_sizes=[(0.09, 0.08, 0.1)], centers=[(_PLACE, 0, 0.13)])
        log("rig/pendulum/shoe", body)
        arrow = Shape("Arrows3D", origins=[(_PLACE + 0.13, 0, 0.06)], colors=[self.friction], radii=[0.016])
        log("rig/pendulum/friction", arrow)
        post = Shape("Boxes3D", half_sizes=[(0.04, 0.04, 0.2)], centers=[_STAND - (0, 0, 0.05)], colors=[STEEL])
        log("rig/post", post)

    def _frames(self, t_ns: Integers, s: Mapping[str, Reals], modes: Integers, ran: Reals) -> list[Columns]:
        zoom = self.scale.motion
        angles, up = zoom * s["displacement"] / _PLACE, zoom * ACROSS * s["height"] + GAP
        place = np.stack((_PLACE * np.cos(angles), _PLACE * np.sin(angles), up), axis=1)
        drawn = {one.path: one for one in super()._frames(t_ns, {**s, "angle": angles}, modes, ran)}
        turn = Shape("Transform3D", quaternion=about(2, angles), translation=along(2, up))
        side = place + np.array((0.0, -0.08, 0.13))
        drawn["rig/disc"] = Columns("rig/disc", t_ns, Shape("Transform3D", quaternion=about(2, ran)))
        drawn["rig/pendulum"] = Columns("rig/pendulum", t_ns, turn)
        drawn["rig/load"] = load(
            t_ns, place + np.array((0.0, 0.0, 0.23)), s["normal_force"] / self.scale.force * 0.25, self.normal
        )
        drawn["rig/spring"] = spring(t_ns, zigzag(np.broadcast_to(_STAND, side.shape), side, flat=True))
        return list(drawn.values())
