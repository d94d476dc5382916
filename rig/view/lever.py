"""The moving picture of the lever rig: a disc drags a pin, whose cylinder turns a lever, which presses the pin on.

The view is from the front and one length is a decimetre. The disc and the cylinder above the pin turn about y, the
L-shaped lever about z. The cylinder's tail pulls one leg of the lever (spring along x); the other leg presses the
pin's fixture on the disc (spring along y). The ends of the arm hold a spring and the dead weight.
"""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from rig.view import base

# lengths of the scene
_RADIUS = 0.8
_PIN = 1.0
_ARM = 1.5
_TAIL = 1.0
_LEG = 0.6
# y of the cylinder's two ends
_FRONT = -0.25
_BACK = -1.45
_HEIGHT = _RADIUS + _PIN  # of the cylinder's axis
_PIVOT = (-_LEG, _BACK + _LEG, _RADIUS)
"""Pivot of the lever, placed so that its legs end beside the tail and behind the pin's fixture."""


class Lever(base.Picture):
    """The disc, the cylinder with arm, pin and tail, and the lever with its springs."""

    surface = "disc_speed"
    eye = (1.5, -3.7, 2.6)
    target = (0.0, -0.4, 0.95)

    def static(self, log: base.Log) -> None:
        """See `Picture.static`."""
        turns = np.linspace(0.0, 2.0 * np.pi, 24, endpoint=False)
        rays = np.stack((np.cos(turns), np.zeros(24), np.sin(turns)), axis=1)
        inner_radii = (0.35, 0.95, 0.95) * 8
        spokes = [np.stack((inner * ray, 1.04 * ray)) - (0.0, 0.005, 0.0) for inner, ray in zip(inner_radii, rays)]
        cord = np.array([(-_ARM, _FRONT, 0.0), (-_ARM, _FRONT, -0.2)])
        pin = base.Shape("Boxes3D", half_sizes=[(0.08, 0.5 * -_FRONT, 0.08)], centers=[(0.0, 0.5 * _FRONT, -_PIN)])
        log("rig/disc", _round(0.1, 1.055, 0.05, base.DISC))
        log("rig/disc/marks", base.Shape.marks(spokes, 0.008))
        log("rig/cylinder/axis", _round(_FRONT - _BACK, 0.11, 0.5 * (_FRONT + _BACK), base.STEEL))
        log("rig/cylinder/arm", base.Shape.box((_ARM, 0.04, 0.04), (0.0, _FRONT, 0.0)))
        log("rig/cylinder/cantilever", base.Shape.box((0.04, 0.04, 0.5 * _PIN), (0.0, _FRONT, -0.5 * _PIN)))
        log("rig/cylinder/tail", base.Shape.box((0.04, 0.04, 0.5 * _TAIL), (0.0, _BACK, -0.5 * _TAIL)))
        log("rig/cylinder/weight", base.Shape.box((0.13, 0.13, 0.13), (-_ARM, _FRONT, -0.3)))
        log("rig/cylinder/cord", base.Shape.marks([cord], 0.012))
        log("rig/anchor", base.Shape.box((0.12, 0.12, 0.05), (_ARM, _FRONT, _HEIGHT - 1.25)))
        log("rig/cylinder/pin", pin)
        log("rig/cylinder/friction", base.Shape.arrow((0.0, -0.05, -_PIN - 0.14), self.friction, 0.025))
        log("rig/lever/tail", base.Shape.box((0.035, 0.5 * _LEG, 0.06), (0.0, -0.5 * _LEG, 0.0)))
        log("rig/lever/fixture", base.Shape.box((0.5 * _LEG, 0.035, 0.06), (0.5 * _LEG, 0.0, 0.0)))
        log("rig/post", base.Shape.box((0.05, 0.05, 0.45), (_PIVOT[0], _PIVOT[1], _RADIUS - 0.45)))

    def _frames(
        self, t_ns: base.Integers, s: Mapping[str, base.Reals], modes: base.Integers, ran: base.Reals
    ) -> list[base.Columns]:
        zoom = self.scale.motion
        phi = zoom * s["angle"]
        theta = zoom * s["lever_angle"]
        colours = base.coloured(modes)
        friction = s["friction_force"]
        normal = s["normal_force"]
        texts = self._contact_text(modes, friction, normal)
        axis = np.broadcast_to((0.0, 0.0, _HEIGHT), (len(phi), 3))
        pivot = np.broadcast_to(_PIVOT, (len(phi), 3))
        return [
            base.moved("rig/disc", t_ns, quaternion=base.about(1, zoom * ran)),
            base.moved("rig/cylinder", t_ns, quaternion=base.about(1, -phi), translation=axis),
            base.moved("rig/lever", t_ns, quaternion=base.about(2, theta), translation=pivot),
            base.painted("rig/cylinder/pin", t_ns, colours),
            self._friction("rig/cylinder/friction", t_ns, 0, friction, 0.6),
            self._pressed(t_ns, _pin(phi), normal),
            base.spring(t_ns, *_springs(phi, theta), radius=0.012),
            base.word(t_ns, (0.0, 0.0, _HEIGHT + 0.5), texts, colours),
        ]

    def _pressed(self, t_ns: base.Integers, pin: base.Reals, force: base.Reals) -> base.Columns:
        """The arrows of the normal force, which presses the pin on along y."""
        load = base.along(1, force / self.scale.force * 0.25)
        heads = pin + np.array((0.0, -_FRONT, 0.16))
        count = len(pin)
        arrows = base.Shape(
            "Arrows3D", vectors=load, origins=heads - load, colors=[self.normal] * count, radii=[0.02] * count
        )
        return base.Columns("rig/load", t_ns, arrows)


def _round(length: float, radius: float, y: float, colour: base.Colour) -> base.Shape:
    """A cylinder about the y axis with its middle at `y`."""
    return base.Shape(
        "Cylinders3D",
        lengths=[length],
        radii=[radius],
        centers=[(0.0, y, 0.0)],
        quaternions=[base.LYING],
        colors=[colour],
    )


def _springs(phi: base.Reals, theta: base.Reals) -> list[base.Reals]:
    """The springs at the arm, the tail and the pin, for rotations of cylinder and lever [rad]."""
    arm = _points(_ARM * np.cos(phi), _FRONT, _HEIGHT + _ARM * np.sin(phi))
    anchor = np.broadcast_to((_ARM, _FRONT, _HEIGHT - 1.2), arm.shape)
    tail = _points(_TAIL * np.sin(phi), _BACK, _HEIGHT - _TAIL * np.cos(phi))
    x, y, z = _PIVOT
    pulled = _points(x + _LEG * np.sin(theta), y - _LEG * np.cos(theta), z)
    pressing = _points(x + _LEG * np.cos(theta), y + _LEG * np.sin(theta), z)
    return [
        base.zigzag(anchor, arm, flat=False),
        base.zigzag(pulled, tail, flat=True),
        base.zigzag(pressing, _pin(phi), flat=True),
    ]


def _pin(phi: base.Reals) -> base.Reals:
    """Places of the pin's end for rotations of the cylinder [rad]."""
    return _points(_PIN * np.sin(phi), _FRONT, _HEIGHT - _PIN * np.cos(phi))


def _points(x: base.Reals, y: base.Reals | float, z: base.Reals | float) -> base.Reals:
    """Points [frame, xyz]; a height or depth that is one number holds in all frames."""
    zero = np.zeros_like(x)
    return np.stack((x, y + zero, z + zero), axis=1)
