"""The moving picture of the belt rig: a mass on a running belt, a spring to a wall. Its variant for the rig north."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

from rig.picture import OnBelt
from rig.view import base

_PITCH = 0.25
_BELT = 1.5
GAP = 0.17
ACROSS = 0.25  # magnification of motion across the belt, as a fraction of that along it


class Belt(base.Picture):
    """The mass on the belt, from the side; x is the direction of the belt."""

    eye = (0.2, -2.5, 1.3)
    target = (0.0, 0.0, 0.12)

    def __init__(self, scale: base.Scale, drawn: OnBelt | None = None) -> None:
        self._drawn = drawn or OnBelt()
        self.surface = self._drawn.surface
        self.forces = self._drawn.friction, self._drawn.normal
        super().__init__(scale)

    def static(self, log: base.Log) -> None:
        """See `Picture.static`."""
        rollers = base.Shape(
            "Cylinders3D",
            lengths=[0.9, 0.9],
            radii=[0.15, 0.15],
            centers=[(-_BELT, 0, -0.16), (_BELT, 0, -0.16)],
            quaternions=[base.LYING, base.LYING],
            colors=[base.STEEL],
        )
        belt = base.Shape(
            "Boxes3D",
            half_sizes=[(_BELT, 0.42, 0.01)] * 2,
            centers=[(0, 0, -0.01), (0, 0, -0.31)],
            colors=[base.DISC],
        )
        places = np.arange(-_BELT, _BELT - _PITCH / 2, _PITCH)
        lines = [np.array([(x, -0.42, 0.006), (x, 0.42, 0.006)]) for x in places]
        log("rig/rollers", rollers)
        log("rig/belt", belt)
        log("rig/marks", base.Shape.marks(lines, 0.006))
        log("rig/mass/body", self._body())
        log("rig/mass/friction", base.Shape.arrow((0, -0.27, 0.04), self.friction, 0.018))
        log("rig/wall", base.Shape.box((0.03, 0.35, 0.3), (-1.25, 0, 0.32)))

    def _body(self) -> base.Shape:
        """The mass, or a rod that leans if the plant declares its angle."""
        lean = self._drawn.lean
        if not lean:
            return base.Shape("Boxes3D", half_sizes=[(0.2, 0.2, 0.17)], centers=[(0.0, 0.0, 0.19)])
        rod = (0.06, 0.06, 0.4)
        middle = (-0.26, 0.0, 0.32)
        turn = (0.0, -np.sin(lean), 0.0, np.cos(lean))
        return base.Shape("Boxes3D", half_sizes=[rod], centers=[middle], quaternions=[turn])

    def _frames(
        self, t_ns: base.Integers, s: Mapping[str, base.Reals], modes: base.Integers, ran: base.Reals
    ) -> list[base.Columns]:
        drawn = self._drawn
        zoom = self.scale.motion
        colours = base.coloured(modes)
        x = zoom * s[drawn.along] if drawn.along else np.zeros(len(t_ns))
        zero = np.zeros_like(x)
        tips = np.stack((x - 0.2, zero, zero + 0.2), axis=1)
        heads = np.stack((x, zero, zero + 0.37), axis=1)
        wall = np.broadcast_to((-1.22, 0.0, 0.2), tips.shape)
        marks = base.along(0, np.mod(zoom * ran, _PITCH))
        friction = s[drawn.friction]
        normal = s[drawn.normal]
        texts = self._contact_text(modes, friction, normal)
        return [
            base.moved("rig/marks", t_ns, translation=marks),
            base.moved("rig/mass", t_ns, **self._placed(s)),
            base.painted("rig/mass/body", t_ns, colours),
            self._friction("rig/mass/friction", t_ns, 0, friction, 0.6),
            self._load(t_ns, heads, normal),
            base.spring(t_ns, base.zigzag(wall, tips, flat=False)),
            base.word(t_ns, (0.0, 0.0, 1.02), texts, colours),
        ]

    def _placed(self, s: Mapping[str, base.Reals]) -> dict[str, Any]:
        """Translations and rotations of the body [frame], as components of a transform."""
        drawn = self._drawn
        zoom = self.scale.motion
        x = zoom * s[drawn.along] if drawn.along else np.zeros(len(s[drawn.surface]))
        zero = np.zeros_like(x)
        rest = GAP if drawn.lifted else 0.0
        across = ACROSS if drawn.lifted else 1.0
        up = np.full_like(x, rest)
        if drawn.up:
            up = up + zoom * across * s[drawn.up]
        placed: dict[str, Any] = {"translation": np.stack((x, zero, up), axis=1)}
        if drawn.turn:
            half = 0.5 * zoom * s[drawn.turn]
            placed["quaternion"] = np.stack((zero, np.sin(half), zero, np.cos(half)), axis=1)
        return placed


class Tilting(Belt):
    """The body of the rig north, which moves towards the surface and rotates about its centre."""

    def _placed(self, s: Mapping[str, base.Reals]) -> dict[str, Any]:
        down = self.scale.motion * s["displacement"]
        half = 0.5 * self.scale.motion * s["tilt"]
        zero = np.zeros_like(down)
        return {
            "translation": np.stack((zero, zero, GAP - down), axis=1),
            "quaternion": np.stack((zero, np.sin(half), zero, np.cos(half)), axis=1),
        }
