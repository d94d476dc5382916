"""The contact points as coloured areas in moving pictures: maps of the pressure, side by side, and their scale.

The picture of a structure consists of these maps. A text over each contact states its normal force and the share of its
points in contact. The vibration is faster than any picture: each frame shows one instant, not a mean.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Self

import numpy as np

from rig.model.assembly import Assembly
from rig.model.system import System
from rig.record.film_points import Points
from rig.scenes.scene import Scene
from rig.view import base, pressure

_GREY, _CENTRE, _LINE = (176, 182, 192), (240, 60, 60), (60, 64, 72)
_BETWEEN = 0.12  # gap between two maps, over the widest


class Cells:
    """Maps of the contacts under the entity `root`, side by side, two lengths wide in all.

    `unit`: lengths of the picture per metre, by default so that they fit. `flat`: one map alone, without lines, scale
    and centre.
    """

    eye = (0.0, -0.12, 1.9)
    target = (0.0, -0.12, 0.0)

    def __init__(self, points: Points, root: str, unit: float | None = None, flat: bool = False) -> None:
        self._points, self._root, self._flat = points, root, flat
        ends = [(surface.corners.min(axis=(0, 1)), surface.corners.max(axis=(0, 1))) for surface in points.surfaces]
        sizes = np.array([high - low for low, high in ends])
        gap = _BETWEEN * sizes[:, 0].max()
        width = sizes[:, 0].sum() + gap * (len(sizes) - 1)
        self._unit = unit or 2.0 / max(width, 1.5 * sizes[:, 1].max())
        left = np.cumsum(sizes[:, 0] + gap) - sizes[:, 0] - gap - 0.5 * width
        self._moved = [np.array([x, -0.5 * size[1]]) - low for x, size, (low, _) in zip(left, sizes, ends)]
        self.half = 0.5 * self._unit * np.array([width, sizes[:, 1].max()])
        """Half of the size of all maps together [lengths]."""
        self.tops = [
            (float(self._unit * (x + 0.5 * size[0])), float(self._unit * 0.5 * size[1] + 0.1), 0.0)
            for x, size in zip(left, sizes)
        ]
        """The places over the maps."""

    def static(self, log: base.Log) -> None:
        """Send areas, lines between them, and the colour scale with its labels."""
        cells = np.concatenate([s.corners + moved for s, moved in zip(self._points.surfaces, self._moved)])
        corners = np.concatenate([self._unit * cells, np.zeros((*cells.shape[:2], 1))], axis=2)
        first = 4 * np.arange(len(cells))[:, None, None]
        triangles = (first + np.array([[0, 1, 2], [0, 2, 3]])).reshape(-1, 3)
        flat = self._root if self._flat else f"{self._root}/map"
        log(flat, base.Shape("Mesh3D", vertex_positions=corners.reshape(-1, 3), triangle_indices=triangles))
        if not self._flat:
            lines = [np.vstack([cell, cell[:1]]) + np.array([0.0, 0.0, 0.004]) for cell in corners]
            shape = base.Shape("LineStrips3D", strips=lines, colors=[_LINE] * len(lines), radii=[0.004] * len(lines))
            log(f"{self._root}/grid", shape)
            self._legend(log, -float(self.half[1]) - 0.22)

    def frames(self, t_ns: base.Integers, s: Mapping[str, base.Reals]) -> list[base.Columns]:
        """Pressures as colours, and the pressure centres."""
        maps = [surface.maps(s) for surface in self._points.surfaces]
        cells = np.concatenate([pressed.reshape(len(t_ns), -1) for pressed in maps], axis=1)
        corners = np.repeat(pressure.colours(cells, self._points.scale), 4, axis=1)
        coloured = base.Shape("Mesh3D", vertex_colors=corners.reshape(-1, 3))
        if self._flat:
            return [base.Columns(self._root, t_ns, coloured)]
        centres = np.array(
            [
                [(*(self._unit * (np.array(surface.centre(now)) + moved)), 0.03) for now in pressed]
                for surface, pressed, moved in zip(self._points.surfaces, maps, self._moved)
            ]
        )
        count = len(maps) * len(t_ns)
        marks = base.Shape(
            "Points3D", positions=centres.transpose(1, 0, 2).reshape(-1, 3), colors=[_CENTRE] * count,
            radii=[0.035] * count,
        )  # fmt: skip
        return [base.Columns(f"{self._root}/map", t_ns, coloured), base.Columns(f"{self._root}/centre", t_ns, marks)]

    def _legend(self, log: base.Log, y: float) -> None:
        """Send the colour scale at height `y`, and beside it the meaning of white."""
        count, low, high = 64, -1.0, 0.4
        x = np.linspace(low, high, count + 1)
        bars = [(x[i + a], y + b, 0.0) for i in range(count) for a, b in ((0, 0), (1, 0), (1, 0.09), (0, 0.09))]
        bars += [(0.9 + a, y + b, 0.0) for a, b in ((0, 0), (0.1, 0), (0.1, 0.09), (0, 0.09))]
        shades = pressure.colours(np.append((np.arange(count) + 0.5) / count, 0.0), 1.0)
        first = 4 * np.arange(count + 1)[:, None, None]
        mesh = base.Shape(
            "Mesh3D",
            vertex_positions=bars,
            vertex_colors=np.repeat(shades, 4, axis=0),
            triangle_indices=(first + np.array([[0, 1, 2], [0, 2, 3]])).reshape(-1, 3),
        )
        log(f"{self._root}/scale", mesh)
        top = 1e-6 * self._points.scale
        labels = ["0", f"{top / 2:g}", f"{top:g} MPa and more", "open"]
        places = [(low, y - 0.1, 0.0), (0.5 * (low + high), y - 0.1, 0.0), (high, y - 0.1, 0.0), (0.95, y - 0.1, 0.0)]
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
        self._points, self._cells = points, Cells(points, "rig/contacts")

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
            texts = [
                f"{surface.name}: {force:.0f} N, {100.0 * share:.0f} % in contact"
                for force, share in zip((pressed @ surface.area).tolist(), (pressed > 0.0).mean(axis=1).tolist())
            ]
            word = base.word(t_ns, place, texts, [_GREY] * len(t_ns))
            words.append(word._replace(path=f"rig/word/{surface.name}"))
        return [*self._cells.frames(t_ns, s), *words]
