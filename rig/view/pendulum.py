"""The moving picture of the pendulum rig: an arm above a rotating disc, its shoe on the disc, a spring to a post.

Its variant for the rig disc_slider.
"""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from rig.picture import OnDisc
from rig.view import base
from rig.view.belt import ACROSS, GAP

_ARM = 0.8
_POST = np.array((0.55, -0.75, 0.2))
_PLACE = 0.83  # radius of the slider
_STAND = np.array((_PLACE, -0.9, 0.3))


class Pendulum(base.Picture):
    """The pendulum of the papers, seen obliquely from above.

    Arm and disc turn about z, and the radius of the disc is one length.
    """

    eye = (1.5, 0.9, 1.2)
    target = (0.12, -0.02, 0.08)

    def __init__(self, scale: base.Scale, drawn: OnDisc | None = None) -> None:
        self._drawn = drawn or OnDisc()
        self.surface = self._drawn.surface
        self.forces = self._drawn.friction, self._drawn.normal
        super().__init__(scale)

    def static(self, log: base.Log) -> None:
        """See `Picture.static`."""
        disc(log)
        shaft = base.Shape("Cylinders3D", lengths=[0.5], radii=[0.07], centers=[(0, 0, 0.25)], colors=[base.STEEL])
        arm = base.Shape.box((_ARM / 2, 0.035, 0.03), (_ARM / 2, 0, 0.2))
        shoe = base.Shape("Boxes3D", half_sizes=[(0.07, 0.06, 0.075)], centers=[(_ARM, 0, 0.1)])
        friction = base.Shape.arrow((_ARM + 0.1, 0, 0.06), self.friction, 0.016)
        post = base.Shape.box((0.04, 0.04, 0.15), _POST - (0, 0, 0.05))
        log("rig/pendulum/shaft", shaft)
        log("rig/pendulum/arm", arm)
        log("rig/pendulum/shoe", shoe)
        log("rig/pendulum/friction", friction)
        log("rig/post", post)

    def _frames(
        self, t_ns: base.Integers, s: Mapping[str, base.Reals], modes: base.Integers, ran: base.Reals
    ) -> list[base.Columns]:
        drawn = self._drawn
        zoom = self.scale.motion
        colours = base.coloured(modes)
        angles = zoom * s[drawn.angle]
        tips = _on_circle(0.55, angles, 0.2)
        heads = _on_circle(_ARM, angles, 0.24)
        post = np.broadcast_to(_POST, tips.shape)
        friction = s[drawn.friction]
        normal = s[drawn.normal]
        texts = self._contact_text(modes, friction, normal)
        return [
            base.moved("rig/disc", t_ns, quaternion=base.about(2, zoom * ran)),
            base.moved("rig/pendulum", t_ns, quaternion=base.about(2, angles)),
            base.painted("rig/pendulum/shoe", t_ns, colours),
            self._friction("rig/pendulum/friction", t_ns, 1, friction, 0.5),
            self._load(t_ns, heads, normal),
            base.spring(t_ns, base.zigzag(post, tips, flat=True)),
            base.word(t_ns, (0.0, 0.0, 0.72), texts, colours),
        ]


class Slider(Pendulum):
    """A slider on a rotating flexible disc; it moves along the disc and up and down.

    The rotation of the disc is not magnified: at the magnification of the motion it would be a blur.
    """

    def static(self, log: base.Log) -> None:
        """See `Picture.static`."""
        disc(log)
        slider = base.Shape("Boxes3D", half_sizes=[(0.09, 0.08, 0.1)], centers=[(_PLACE, 0, 0.13)])
        friction = base.Shape.arrow((_PLACE + 0.13, 0, 0.06), self.friction, 0.016)
        post = base.Shape.box((0.04, 0.04, 0.2), _STAND - (0, 0, 0.05))
        log("rig/pendulum/shoe", slider)
        log("rig/pendulum/friction", friction)
        log("rig/post", post)

    def _frames(
        self, t_ns: base.Integers, s: Mapping[str, base.Reals], modes: base.Integers, ran: base.Reals
    ) -> list[base.Columns]:
        zoom = self.scale.motion
        angles = zoom * s["displacement"] / _PLACE
        up = zoom * ACROSS * s["height"] + GAP
        place = _on_circle(_PLACE, angles, up)
        top = place + np.array((0.0, 0.0, 0.23))
        side = place + np.array((0.0, -0.08, 0.13))
        stand = np.broadcast_to(_STAND, side.shape)
        pendulum = base.moved("rig/pendulum", t_ns, quaternion=base.about(2, angles), translation=base.along(2, up))
        drawn = {columns.path: columns for columns in super()._frames(t_ns, {**s, "angle": angles}, modes, ran)}
        drawn["rig/disc"] = base.moved("rig/disc", t_ns, quaternion=base.about(2, ran))
        drawn["rig/pendulum"] = pendulum
        drawn["rig/load"] = self._load(t_ns, top, s["normal_force"])
        drawn["rig/spring"] = base.spring(t_ns, base.zigzag(stand, side, flat=True))
        return list(drawn.values())


def _on_circle(radius: float, angles: base.Reals, height: base.Reals | float) -> base.Reals:
    """Points [frame, xyz] on a circle about the axis of the disc; a height that is one number holds in all frames."""
    x = radius * np.cos(angles)
    y = radius * np.sin(angles)
    return np.stack((x, y, np.broadcast_to(height, x.shape)), axis=1)


def disc(log: base.Log) -> None:
    """Send a disc of radius one that turns about the z axis, with marks."""
    turns = np.linspace(0.0, 2.0 * np.pi, 24, endpoint=False)
    rays = np.stack((np.cos(turns), np.sin(turns), np.full(24, 0.02) / 0.99), axis=1)
    rim = rays * (0.99, 0.99, 1.0)
    short = rays * (0.93, 0.93, 1.0)
    long = rays * (0.3, 0.3, 1.0)
    spokes = [np.stack(ends) for ends in zip(short, rim)]
    spokes += [np.stack(ends) for ends in zip(long[::8], rim[::8])]
    cylinder = base.Shape("Cylinders3D", lengths=[0.08], radii=[1.0], centers=[(0, 0, -0.025)], colors=[base.DISC])
    log("rig/disc", cylinder)
    log("rig/disc/marks", base.Shape.marks(spokes, 0.006))
