"""The moving picture of the rig four_dof, from the side: body 2 on the belt, body 1 beside it, body 3 above it.

Springs connect the bodies to each other and to the frame; the inclined spring connects body 2 to a post. Motion across
the belt is magnified less than motion along it, as in `rig.view.belt`.
"""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from rig.picture import OnBelt
from rig.view.base import Scale, round_down
from rig.view.belt import ACROSS, GAP, Belt
from rig.view.shapes import STEEL, Columns, Integers, Log, Reals, Shape, along, coloured, load, spring, word, zigzag

_SIDE = np.array((-0.72, 0.0, GAP + 0.19))
"""Rest position of the centre of body 1."""
_TOP = np.array((0.0, 0.0, GAP + 0.8))
"""Rest position of the centre of body 3."""
_HALF = 0.12
_WALL = np.array((-1.22, 0.0, _SIDE[2]))
_CEILING = np.array((0.0, 0.0, 1.5))
_POST = np.array((-0.62, 0.3, 0.9))


class ThreeBodies(Belt):
    """Three bodies and five springs; the arrow of the load on body 2 is beside body 3."""

    eye = (0.1, -3.1, 1.5)
    target = (-0.1, 0.0, 0.5)

    def __init__(self, scale: Scale) -> None:
        """Use half of the usual magnification, because bodies 1 and 2 move towards each other."""
        super().__init__(scale._replace(motion=round_down(0.5 * scale.motion)), OnBelt(up="height", lifted=True))

    def static(self, log: Log) -> None:
        """See `Picture.static`."""
        super().static(log)
        for name, half, place in (
            ("body_1", (_HALF, _HALF, _HALF), _SIDE),
            ("body_3", (_HALF, _HALF, _HALF), _TOP),
            ("ceiling", (0.35, 0.35, 0.03), _CEILING),
            ("post", (0.03, 0.03, 0.45), _POST - (0.0, 0.0, 0.45)),
        ):
            box = Shape("Boxes3D", half_sizes=[half], centers=[place], colors=[STEEL])
            log(f"rig/{name}", box)

    def _frames(self, t_ns: Integers, s: Mapping[str, Reals], modes: Integers, ran: Reals) -> list[Columns]:
        drawn = {one.path: one for one in super()._frames(t_ns, s, modes, ran)}
        slider = self._placed(s)["translation"] + (0.0, 0.0, 0.19)
        side = along(0, self.scale.motion * s["body_1_displacement"])
        top = along(2, self.scale.motion * ACROSS * s["body_3_height"])
        count = len(t_ns)

        def still(place: Reals) -> Reals:
            return np.broadcast_to(place, (count, 3))

        along_x, upright = np.array((1.0, 0.0, 0.0)), np.array((0.0, 0.0, 1.0))
        ends = (
            (still(_WALL), _SIDE + side - _HALF * along_x, False),
            (_SIDE + side + _HALF * along_x, slider - 0.2 * along_x, False),
            (slider + np.array((-0.15, 0.2, 0.1)), still(_POST), False),
            (slider + 0.17 * upright, _TOP + top - _HALF * upright, False),
            (_TOP + top + _HALF * upright, still(_CEILING), False),
        )
        springs = [zigzag(begin, end, flat) for begin, end, flat in ends]
        drawn["rig/spring"] = spring(t_ns, *springs)
        for name, moved in (("body_1", side), ("body_3", top)):
            drawn[f"rig/{name}"] = Columns(f"rig/{name}", t_ns, Shape("Transform3D", translation=moved))
        drawn["rig/load"] = load(
            t_ns, slider + np.array((0.15, 0.0, 0.18)), s["normal_force"] / self.scale.force * 0.25, self.normal
        )
        texts = self._contact_text(modes, s["friction_force"], s["normal_force"])
        drawn["rig/word"] = word(t_ns, (0.55, 0.0, 1.2), texts, coloured(modes))
        return list(drawn.values())
