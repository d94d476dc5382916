"""The contact points as coloured areas in moving pictures: maps of the pressure, side by side, and their scale.

The picture of a structure consists of these maps. A text over each contact states its normal force and the share of its
points in contact. The vibration is faster than any picture: each frame shows one instant, not a mean.
"""

from __future__ import annotations

from collections.abc import Mapping
from itertools import pairwise
from typing import Self

import numpy as np

from rig.model.assembly import Assembly
from rig.model.system import System
from rig.record.film_points import Points
from rig.scenes.scene import Scene
from rig.view import base, pressure

_GREY = (176, 182, 192)
_CENTRE = (240, 60, 60)
_LINE = (60, 64, 72)
_BETWEEN = 0.12  # gap between two maps, over the widest
_SCALE = (-1.0, 0.4)  # both ends of the colour scale in x [lengths]
_SHADES = 64  # number of colours of the scale that are drawn
_TRIANGLES = np.array([[0, 1, 2], [0, 2, 3]])
"""Corners of the two triangles of a rectangle."""


class Cells:
    """Maps of the contacts under the entity `root`, side by side, two lengths wide in all.

    `unit`: lengths of the picture per metre, by default so that they fit. `flat`: one map alone, without lines, scale
    and centre.
    """

    eye = (0.0, -0.12, 1.9)
    target = (0.0, -0.12, 0.0)

    def __init__(self, points: Points, root: str, unit: float | None = None, flat: bool = False) -> None:
        self._points = points
        self._root = root
        self._flat = flat
        lows = [surface.corners.min(axis=(0, 1)) for surface in points.surfaces]
        highs = [surface.corners.max(axis=(0, 1)) for surface in points.surfaces]
        sizes = np.array([high - low for low, high in zip(lows, highs)])
        widths = sizes[:, 0]
        tallest = sizes[:, 1].max()
        gap = _BETWEEN * widths.max()
        width = widths.sum() + gap * (len(sizes) - 1)
        self._unit = unit or 2.0 / max(width, 1.5 * tallest)
        lefts = np.cumsum(widths + gap) - widths - gap - 0.5 * width
        self._moved = [np.array([left, -0.5 * size[1]]) - low for left, size, low in zip(lefts, sizes, lows)]
        self.half = 0.5 * self._unit * np.array([width, tallest])
        """Half of the size of all maps together [lengths]."""
        self.tops: list[tuple[float, float, float]] = []
        """The places over the maps."""
        for left, size in zip(lefts, sizes):
            middle = self._unit * (left + 0.5 * size[0])
            over = self._unit * 0.5 * size[1] + 0.1
            self.tops.append((float(middle), float(over), 0.0))

    def static(self, log: base.Log) -> None:
        """Send areas, lines between them, and the colour scale with its labels."""
        cells = np.concatenate([s.corners + moved for s, moved in zip(self._points.surfaces, self._moved)])
        corners = np.concatenate([self._unit * cells, np.zeros((*cells.shape[:2], 1))], axis=2)
        path = self._root if self._flat else f"{self._root}/map"
        areas = base.Shape("Mesh3D", vertex_positions=corners.reshape(-1, 3), triangle_indices=_triangles(len(cells)))
        log(path, areas)
        if not self._flat:
            above = np.array([0.0, 0.0, 0.004])
            lines = [np.vstack([cell, cell[:1]]) + above for cell in corners]
            count = len(lines)
            grid = base.Shape("LineStrips3D", strips=lines, colors=[_LINE] * count, radii=[0.004] * count)
            log(f"{self._root}/grid", grid)
            self._legend(log, -float(self.half[1]) - 0.22)

    def frames(self, t_ns: base.Integers, s: Mapping[str, base.Reals]) -> list[base.Columns]:
        """Pressures as colours, and the pressure centres."""
        maps = [surface.maps(s) for surface in self._points.surfaces]
        cells = np.concatenate([pressed.reshape(len(t_ns), -1) for pressed in maps], axis=1)
        corners = np.repeat(pressure.colours(cells, self._points.scale), 4, axis=1)
        coloured = base.Shape("Mesh3D", vertex_colors=corners.reshape(-1, 3))
        if self._flat:
            return [base.Columns(self._root, t_ns, coloured)]
        centres = np.full((len(t_ns), len(maps), 3), 0.03)
        for map_, (surface, pressed, moved) in enumerate(zip(self._points.surfaces, maps, self._moved)):
            for frame, pressures in enumerate(pressed):
                centres[frame, map_, :2] = self._unit * (np.array(surface.centre(pressures)) + moved)
        count = len(maps) * len(t_ns)
        marks = base.Shape(
            "Points3D", positions=centres.reshape(-1, 3), colors=[_CENTRE] * count, radii=[0.035] * count
        )
        return [base.Columns(f"{self._root}/map", t_ns, coloured), base.Columns(f"{self._root}/centre", t_ns, marks)]

    def _legend(self, log: base.Log, y: float) -> None:
        """Send the colour scale at height `y`, and beside it the meaning of white."""
        low, high = _SCALE
        ends = pairwise(np.linspace(low, high, _SHADES + 1))
        corners = [corner for left, right in ends for corner in _rectangle(left, right, y)]
        corners += _rectangle(0.9, 0.9 + 0.1, y)
        shares = (np.arange(_SHADES) + 0.5) / _SHADES
        shades = pressure.colours(np.append(shares, 0.0), 1.0)
        mesh = base.Shape(
            "Mesh3D",
            vertex_positions=corners,
            vertex_colors=np.repeat(shades, 4, axis=0),
            triangle_indices=_triangles(_SHADES + 1),
        )
        log(f"{self._root}/scale", mesh)
        top = 1e-6 * self._points.scale
        labels = ["0", f"{top / 2:g}", f"{top:g} MPa and more", "open"]
        places = [(x, y - 0.1, 0.0) for x in (low, 0.5 * (low + high), high, 0.95)]
        marks = base.Shape(
            "Points3D", positions=places, labels=labels, colors=[_GREY] * 4, radii=[0.001] * 4, show_labels=True
        )
        log(f"{self._root}/scale/words", marks)


class Surfaces(base.Picture):
    """The contacts of a structure: their maps, seen from above."""

    eye = (0.0, -0.75, 1.75)
    target = (0.0, -0.08, 0.0)

    def __init__(self, points: Points, scale: base.Scale) -> None:
        super().__init__(scale)
        self._points = points
        self._cells = Cells(points, "rig/contacts")

    @classmethod
    def of(cls, scene: Scene, assembly: Assembly, system: System) -> Self | None:
        """See `Picture.of`; None for a structure whose contact points have no places."""
        points = Points.of(scene)
        return cls(points, base.Scale(1.0, points.load or 1.0)) if points is not None else None

    def static(self, log: base.Log) -> None:
        """See `Picture.static`."""
        self._cells.static(log)

    def _frames(
        self, t_ns: base.Integers, s: Mapping[str, base.Reals], modes: base.Integers, ran: base.Reals
    ) -> list[base.Columns]:
        words = []
        for surface, place in zip(self._points.surfaces, self._cells.tops):
            pressed = surface.maps(s)
            forces = (pressed @ surface.area).tolist()
            shares = (pressed > 0.0).mean(axis=1).tolist()
            texts = [
                f"{surface.name}: {force:.0f} N, {100.0 * share:.0f} % in contact"
                for force, share in zip(forces, shares)
            ]
            word = base.word(t_ns, place, texts, [_GREY] * len(t_ns))
            words.append(word._replace(path=f"rig/word/{surface.name}"))
        return [*self._cells.frames(t_ns, s), *words]


def _triangles(count: int) -> base.Integers:
    """Corners of the triangles of `count` rectangles, whose corners follow one another."""
    first = 4 * np.arange(count)[:, None, None]
    corners: base.Integers = (first + _TRIANGLES).reshape(-1, 3)
    return corners


def _rectangle(left: float, right: float, y: float) -> list[tuple[float, float, float]]:
    """Corners of a rectangle of the colour scale that stands on the height `y`."""
    top = y + 0.09
    return [(left, y, 0.0), (right, y, 0.0), (right, top, 0.0), (left, top, 0.0)]
