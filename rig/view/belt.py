"""The moving picture of the belt rig: a mass on a running belt, a spring to a wall."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

from rig.picture import OnBelt
from rig.view.base import Picture, Scale
from rig.view.shapes import (
    DISC,
    LYING,
    MARK,
    STEEL,
    Columns,
    Integers,
    Log,
    Reals,
    Shape,
    along,
    coloured,
    load,
    spring,
    word,
    zigzag,
)

_PITCH = 0.25
_BELT = 1.5
GAP = 0.17
ACROSS = 0.25  # magnification of motion across the belt, as a fraction of that along it


class Belt(Picture):
    """The mass on the belt, from the side; x is the direction of the belt."""

    eye = (0.2, -2.5, 1.3)
    target = (0.0, 0.0, 0.12)

    def __init__(self, scale: Scale, drawn: OnBelt | None = None) -> None:
        self._drawn = drawn or OnBelt()
        self.surface = self._drawn.surface
        self.forces = self._drawn.friction, self._drawn.normal
        super().__init__(scale)

    def static(self, log: Log) -> None:
        """See `Picture.static`."""
        rollers = Shape(
            "Cylinders3D",
            lengths=[0.9, 0.9],
            radii=[0.15, 0.15],
            centers=[(-_BELT, 0, -0.16), (_BELT, 0, -0.16)],
            quaternions=[LYING, LYING],
            colors=[STEEL],
        )
        log("rig/rollers", rollers)
        bands = Shape(
            "Boxes3D",
            half_sizes=[(_BELT, 0.42, 0.01)] * 2,
            centers=[(0, 0, -0.01), (0, 0, -0.31)],
            colors=[DISC],
        )
        log("rig/belt", bands)
        places = np.arange(-_BELT, _BELT - _PITCH / 2, _PITCH)
        lines = [np.array([(x, -0.42, 0.006), (x, 0.42, 0.006)]) for x in places]
        log("rig/marks", Shape("LineStrips3D", strips=lines, colors=[MARK], radii=[0.006]))
        half, centre, lean = (0.2, 0.2, 0.17), (0.0, 0.0, 0.19), self._drawn.lean
        if lean:
            half, centre = (0.06, 0.06, 0.4), (-0.26, 0.0, 0.32)
        turn: dict[str, Any] = {"quaternions": [(0.0, -np.sin(lean), 0.0, np.cos(lean))]} if lean else {}
        log("rig/mass/body", Shape("Boxes3D", half_sizes=[half], centers=[centre], **turn))
        log("rig/mass/friction", Shape("Arrows3D", origins=[(0, -0.27, 0.04)], colors=[self.friction], radii=[0.018]))
        wall = Shape("Boxes3D", half_sizes=[(0.03, 0.35, 0.3)], centers=[(-1.25, 0, 0.32)], colors=[STEEL])
        log("rig/wall", wall)

    def _placed(self, s: Mapping[str, Reals]) -> dict[str, Any]:
        """Translations and rotations of the body [frame], as components of a transform."""
        zoom, drawn = self.scale.motion, self._drawn
        x = zoom * s[drawn.along] if drawn.along else np.zeros(len(s[drawn.surface]))
        zero, up = np.zeros_like(x), np.full_like(x, GAP if drawn.lifted else 0.0)
        if drawn.up:
            up = up + zoom * (ACROSS if drawn.lifted else 1.0) * s[drawn.up]
        placed: dict[str, Any] = {"translation": np.stack((x, zero, up), axis=1)}
        if drawn.turn:
            half = 0.5 * zoom * s[drawn.turn]
            placed["quaternion"] = np.stack((zero, np.sin(half), zero, np.cos(half)), axis=1)
        return placed

    def _frames(self, t_ns: Integers, s: Mapping[str, Reals], modes: Integers, ran: Reals) -> list[Columns]:
        zoom, colours = self.scale.motion, coloured(modes)
        x = zoom * s[self._drawn.along] if self._drawn.along else np.zeros(len(t_ns))
        zero = np.zeros_like(x)
        tips = np.stack((x - 0.2, zero, zero + 0.2), axis=1)
        heads = np.stack((x, zero, zero + 0.37), axis=1)
        texts = self._contact_text(modes, s[self._drawn.friction], s[self._drawn.normal])
        return [
            Columns("rig/marks", t_ns, Shape("Transform3D", translation=along(0, np.mod(zoom * ran, _PITCH)))),
            Columns("rig/mass", t_ns, Shape("Transform3D", **self._placed(s))),
            Columns("rig/mass/body", t_ns, Shape("Boxes3D", colors=colours)),
            Columns(
                "rig/mass/friction",
                t_ns,
                Shape("Arrows3D", vectors=along(0, s[self._drawn.friction] / self.scale.force * 0.6)),
            ),
            load(t_ns, heads, s[self._drawn.normal] / self.scale.force * 0.25, self.normal),
            spring(t_ns, zigzag(np.broadcast_to((-1.22, 0.0, 0.2), tips.shape), tips, flat=False)),
            word(t_ns, (0.0, 0.0, 1.02), texts, colours),
        ]
