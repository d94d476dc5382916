"""The moving picture of the rig four_dof, from the side: body 2 on the belt, body 1 beside it, body 3 above it.

Springs connect the bodies to each other and to the frame; the inclined spring connects body 2 to a post. Motion across
the belt is magnified less than motion along it, as in `rig.view.belt`.
"""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from rig.picture import OnBelt
from rig.view import base
from rig.view.belt import ACROSS, GAP, Belt

_SIDE = np.array((-0.72, 0.0, GAP + 0.19))  # rest position of the centre of body 1
_TOP = np.array((0.0, 0.0, GAP + 0.8))  # rest position of the centre of body 3
_HALF = 0.12
_WALL = np.array((-1.22, 0.0, _SIDE[2]))
_CEILING = np.array((0.0, 0.0, 1.5))
_POST = np.array((-0.62, 0.3, 0.9))
_ALONG = np.array((1.0, 0.0, 0.0))
_UPRIGHT = np.array((0.0, 0.0, 1.0))


class ThreeBodies(Belt):
    """Three bodies and five springs; the arrow of the load on body 2 is beside body 3."""

    eye = (0.1, -3.1, 1.5)
    target = (-0.1, 0.0, 0.5)

    def __init__(self, scale: base.Scale) -> None:
        """Use half of the usual magnification, because bodies 1 and 2 move towards each other."""
        halved = scale._replace(motion=base.round_down(0.5 * scale.motion))
        super().__init__(halved, OnBelt(up="height", lifted=True))

    def static(self, log: base.Log) -> None:
        """See `Picture.static`."""
        super().static(log)
        cube = (_HALF, _HALF, _HALF)
        ceiling = base.Shape.box((0.35, 0.35, 0.03), _CEILING)
        post = base.Shape.box((0.03, 0.03, 0.45), _POST - (0.0, 0.0, 0.45))
        log("rig/body_1", base.Shape.box(cube, _SIDE))
        log("rig/body_3", base.Shape.box(cube, _TOP))
        log("rig/ceiling", ceiling)
        log("rig/post", post)

    def _frames(
        self, t_ns: base.Integers, s: Mapping[str, base.Reals], modes: base.Integers, ran: base.Reals
    ) -> list[base.Columns]:
        drawn = {columns.path: columns for columns in super()._frames(t_ns, s, modes, ran)}
        zoom = self.scale.motion
        body_1 = base.along(0, zoom * s["body_1_displacement"])
        body_2 = self._placed(s)["translation"] + (0.0, 0.0, 0.19)
        body_3 = base.along(2, zoom * ACROSS * s["body_3_height"])
        heads = body_2 + np.array((0.15, 0.0, 0.18))
        normal = s["normal_force"]
        texts = self._contact_text(modes, s["friction_force"], normal)
        springs = _springs(_SIDE + body_1, body_2, _TOP + body_3)
        drawn["rig/spring"] = base.spring(t_ns, *springs)
        drawn["rig/body_1"] = base.moved("rig/body_1", t_ns, translation=body_1)
        drawn["rig/body_3"] = base.moved("rig/body_3", t_ns, translation=body_3)
        drawn["rig/load"] = self._load(t_ns, heads, normal)
        drawn["rig/word"] = base.word(t_ns, (0.55, 0.0, 1.2), texts, base.coloured(modes))
        return list(drawn.values())


def _springs(body_1: base.Reals, body_2: base.Reals, body_3: base.Reals) -> list[base.Reals]:
    """The five springs between the bodies, whose centres [frame, xyz] these are, and the frame."""
    wall = np.broadcast_to(_WALL, body_1.shape)
    post = np.broadcast_to(_POST, body_1.shape)
    ceiling = np.broadcast_to(_CEILING, body_1.shape)
    beside = _HALF * _ALONG
    above = _HALF * _UPRIGHT
    ends = (
        (wall, body_1 - beside),
        (body_1 + beside, body_2 - 0.2 * _ALONG),
        (body_2 + np.array((-0.15, 0.2, 0.1)), post),
        (body_2 + 0.17 * _UPRIGHT, body_3 - above),
        (body_3 + above, ceiling),
    )
    return [base.zigzag(begin, end, flat=False) for begin, end in ends]
