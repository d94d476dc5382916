"""The moving picture of the lever rig: a disc drags a pin, whose cylinder turns a lever, which presses the pin on.

The view is from the front and one length is a decimetre. The disc and the cylinder above the pin turn about y, the
L-shaped lever about z. The cylinder's tail pulls one leg of the lever (spring along x); the other leg presses the
pin's fixture on the disc (spring along y). The ends of the arm hold a spring and the dead weight.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

from rig.view import base

_RADIUS, _PIN, _ARM, _TAIL, _LEG = 0.8, 1.0, 1.5, 1.0, 0.6  # lengths of the scene
_FRONT, _BACK = -0.25, -1.45  # y of the cylinder's two ends
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

        def round_(path: str, length: float, radius: float, y: float, colour: base.Colour) -> None:
            turned: dict[str, Any] = {"centers": [(0.0, y, 0.0)], "quaternions": [base.LYING], "colors": [colour]}
            log(path, base.Shape("Cylinders3D", lengths=[length], radii=[radius], **turned))

        turns = np.linspace(0.0, 2.0 * np.pi, 24, endpoint=False)
        rays = np.stack((np.cos(turns), np.zeros(24), np.sin(turns)), axis=1)
        spokes = [
            np.stack((inner * ray, 1.04 * ray)) - (0.0, 0.005, 0.0) for inner, ray in zip((0.35, 0.95, 0.95) * 8, rays)
        ]
        round_("rig/disc", 0.1, 1.055, 0.05, base.DISC)
        log("rig/disc/marks", base.Shape("LineStrips3D", strips=spokes, colors=[base.MARK], radii=[0.008]))
        round_("rig/cylinder/axis", _FRONT - _BACK, 0.11, 0.5 * (_FRONT + _BACK), base.STEEL)
        log("rig/cylinder/arm", base.Shape.box((_ARM, 0.04, 0.04), (0.0, _FRONT, 0.0)))
        log("rig/cylinder/cantilever", base.Shape.box((0.04, 0.04, 0.5 * _PIN), (0.0, _FRONT, -0.5 * _PIN)))
        log("rig/cylinder/tail", base.Shape.box((0.04, 0.04, 0.5 * _TAIL), (0.0, _BACK, -0.5 * _TAIL)))
        log("rig/cylinder/weight", base.Shape.box((0.13, 0.13, 0.13), (-_ARM, _FRONT, -0.3)))
        cord = np.array([(-_ARM, _FRONT, 0.0), (-_ARM, _FRONT, -0.2)])
        log("rig/cylinder/cord", base.Shape("LineStrips3D", strips=[cord], colors=[base.MARK], radii=[0.012]))
        log("rig/anchor", base.Shape.box((0.12, 0.12, 0.05), (_ARM, _FRONT, _HEIGHT - 1.25)))
        pin = base.Shape("Boxes3D", half_sizes=[(0.08, 0.5 * -_FRONT, 0.08)], centers=[(0.0, 0.5 * _FRONT, -_PIN)])
        log("rig/cylinder/pin", pin)
        log(
            "rig/cylinder/friction",
            base.Shape("Arrows3D", origins=[(0.0, -0.05, -_PIN - 0.14)], colors=[self.friction], radii=[0.025]),
        )
        log("rig/lever/tail", base.Shape.box((0.035, 0.5 * _LEG, 0.06), (0.0, -0.5 * _LEG, 0.0)))
        log("rig/lever/fixture", base.Shape.box((0.5 * _LEG, 0.035, 0.06), (0.5 * _LEG, 0.0, 0.0)))
        log("rig/post", base.Shape.box((0.05, 0.05, 0.45), (_PIVOT[0], _PIVOT[1], _RADIUS - 0.45)))

    def _frames(
        self, t_ns: base.Integers, s: Mapping[str, base.Reals], modes: base.Integers, ran: base.Reals
    ) -> list[base.Columns]:
        zoom, colours = self.scale.motion, base.coloured(modes)
        phi, theta = zoom * s["angle"], zoom * s["lever_angle"]
        zero, count = np.zeros_like(phi), len(phi)

        def point(x: base.Reals, y: base.Reals | float, z: base.Reals) -> base.Reals:
            return np.stack((x, y + zero, z), axis=1)

        pin = point(_PIN * np.sin(phi), _FRONT, _HEIGHT - _PIN * np.cos(phi))
        tail = point(_TAIL * np.sin(phi), _BACK, _HEIGHT - _TAIL * np.cos(phi))
        arm = point(_ARM * np.cos(phi), _FRONT, _HEIGHT + _ARM * np.sin(phi))
        ground = np.broadcast_to((_ARM, _FRONT, _HEIGHT - 1.2), arm.shape)
        leg = point(_PIVOT[0] + _LEG * np.sin(theta), _PIVOT[1] - _LEG * np.cos(theta), zero + _RADIUS)
        presses = point(_PIVOT[0] + _LEG * np.cos(theta), _PIVOT[1] + _LEG * np.sin(theta), zero + _RADIUS)
        springs = [base.zigzag(a, b, flat=flat) for a, b, flat in
                   ((ground, arm, False), (leg, tail, True), (presses, pin, True))]  # fmt: skip
        load = base.along(1, s["normal_force"] / self.scale.force * 0.25)
        heads = pin + np.array((0.0, -_FRONT, 0.16))
        texts = self._contact_text(modes, s["friction_force"], s["normal_force"])
        return [
            base.Columns("rig/disc", t_ns, base.Shape("Transform3D", quaternion=base.about(1, zoom * ran))),
            base.Columns(
                "rig/cylinder",
                t_ns,
                base.Shape(
                    "Transform3D",
                    quaternion=base.about(1, -phi),
                    translation=np.broadcast_to((0.0, 0.0, _HEIGHT), (count, 3)),
                ),
            ),
            base.Columns(
                "rig/lever",
                t_ns,
                base.Shape(
                    "Transform3D", quaternion=base.about(2, theta), translation=np.broadcast_to(_PIVOT, (count, 3))
                ),
            ),
            base.Columns("rig/cylinder/pin", t_ns, base.Shape("Boxes3D", colors=colours)),
            base.Columns(
                "rig/cylinder/friction",
                t_ns,
                base.Shape("Arrows3D", vectors=base.along(0, s["friction_force"] / self.scale.force * 0.6)),
            ),
            base.Columns(
                "rig/load",
                t_ns,
                base.Shape(
                    "Arrows3D", vectors=load, origins=heads - load, colors=[self.normal] * count, radii=[0.02] * count
                ),
            ),
            base.spring(t_ns, *springs, radius=0.012),
            base.word(t_ns, (0.0, 0.0, _HEIGHT + 0.5), texts, colours),
        ]
