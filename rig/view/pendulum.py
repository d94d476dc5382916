"""The moving picture of the pendulum rig: an arm above a rotating disc, its shoe on the disc, a spring to a post."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from rig.picture import OnDisc
from rig.view.base import Picture, Scale
from rig.view.shapes import (
    DISC,
    MARK,
    STEEL,
    Columns,
    Integers,
    Log,
    Reals,
    Shape,
    about,
    along,
    coloured,
    load,
    spring,
    word,
    zigzag,
)

_ARM = 0.8
_POST = np.array((0.55, -0.75, 0.2))


def disc(log: Log) -> None:
    """Send a disc of radius one that turns about the z axis, with marks."""
    turns = np.linspace(0.0, 2.0 * np.pi, 24, endpoint=False)
    rays = np.stack((np.cos(turns), np.sin(turns), np.full(24, 0.02) / 0.99), axis=1)
    spokes = [np.stack((ray * (0.93, 0.93, 1.0), ray * (0.99, 0.99, 1.0))) for ray in rays]
    spokes += [np.stack((ray * (0.3, 0.3, 1.0), ray * (0.99, 0.99, 1.0))) for ray in rays[::8]]
    plate = Shape("Cylinders3D", lengths=[0.08], radii=[1.0], centers=[(0, 0, -0.025)], colors=[DISC])
    log("rig/disc", plate)
    log("rig/disc/marks", Shape("LineStrips3D", strips=spokes, colors=[MARK], radii=[0.006]))


class Pendulum(Picture):
    """The pendulum of the papers, seen obliquely from above.

    Arm and disc turn about z, and the radius of the disc is one length.
    """

    eye = (1.5, 0.9, 1.2)
    target = (0.12, -0.02, 0.08)

    def __init__(self, scale: Scale, drawn: OnDisc | None = None) -> None:
        self._drawn = drawn or OnDisc()
        self.surface = self._drawn.surface
        self.forces = self._drawn.friction, self._drawn.normal
        super().__init__(scale)

    def static(self, log: Log) -> None:
        """See `Picture.static`."""
        disc(log)
        shaft = Shape("Cylinders3D", lengths=[0.5], radii=[0.07], centers=[(0, 0, 0.25)], colors=[STEEL])
        log("rig/pendulum/shaft", shaft)
        arm = Shape(
            "Boxes3D",
            half_sizes=[(_ARM / 2, 0.035, 0.03)],
            centers=[(_ARM / 2, 0, 0.2)],
            colors=[STEEL],
        )
        log("rig/pendulum/arm", arm)
        shoe = Shape("Boxes3D", half_sizes=[(0.07, 0.06, 0.075)], centers=[(_ARM, 0, 0.1)])
        log("rig/pendulum/shoe", shoe)
        log(
            "rig/pendulum/friction",
            Shape("Arrows3D", origins=[(_ARM + 0.1, 0, 0.06)], colors=[self.friction], radii=[0.016]),
        )
        post = Shape("Boxes3D", half_sizes=[(0.04, 0.04, 0.15)], centers=[_POST - (0, 0, 0.05)], colors=[STEEL])
        log("rig/post", post)

    def _frames(self, t_ns: Integers, s: Mapping[str, Reals], modes: Integers, ran: Reals) -> list[Columns]:
        zoom, colours = self.scale.motion, coloured(modes)
        angles = zoom * s[self._drawn.angle]
        tips = np.stack((0.55 * np.cos(angles), 0.55 * np.sin(angles), np.full_like(angles, 0.2)), axis=1)
        friction = along(1, s[self._drawn.friction] / self.scale.force * 0.5)
        heads = np.stack((_ARM * np.cos(angles), _ARM * np.sin(angles), np.full_like(angles, 0.24)), axis=1)
        return [
            Columns("rig/disc", t_ns, Shape("Transform3D", quaternion=about(2, zoom * ran))),
            Columns("rig/pendulum", t_ns, Shape("Transform3D", quaternion=about(2, angles))),
            Columns("rig/pendulum/shoe", t_ns, Shape("Boxes3D", colors=colours)),
            Columns("rig/pendulum/friction", t_ns, Shape("Arrows3D", vectors=friction)),
            load(t_ns, heads, s[self._drawn.normal] / self.scale.force * 0.25, self.normal),
            spring(t_ns, zigzag(np.broadcast_to(_POST, tips.shape), tips, flat=True)),
            word(
                t_ns,
                (0.0, 0.0, 0.72),
                self._contact_text(modes, s[self._drawn.friction], s[self._drawn.normal]),
                colours,
            ),
        ]
