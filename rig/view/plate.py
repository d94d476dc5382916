"""The moving picture of the plate rig: a plate on foam, and the slider raised above it to show the film.

One length is 50 mm. The travel of the slider is to scale; its heave, pitch and roll and the motion of the probe (a ball
on the plate) are magnified by a stated factor. A map of the film's pressure (rig.view.pressure) lies on the
plate under the slider. A second view shows the same map from above, with its scale and the pressure centre.

The vibration is faster than any picture: each frame shows one instant, not a mean.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Self

import numpy as np

from rig.model.assembly import Assembly
from rig.model.system import System
from rig.plants.plate import Parameters
from rig.record.film_points import Points, largest_load
from rig.scenes.scene import Scene
from rig.view import base, pressure

_LENGTH = 0.05  # m
_LIFTED = 0.3  # gap in the picture between the plate and the slider, if there is a film [lengths]
_MOVED = 0.08  # largest size of the slider's static deflection in the picture [lengths]
_FOAM, _PROBE, _CENTRE = (112, 98, 74), (226, 160, 60), (240, 60, 60)
_GREY = (176, 182, 192)


def _scale(p: Parameters, system: System, force: float) -> base.Scale:
    """The scale from the slider's static deflection under the largest load `force` [N], at its initial position."""
    count = len(system.coordinates)
    K, at = system.stiffness - system.force[:, :count], list(system.names[:count]).index("z")
    if system.film is not None:
        normal = system.film.everywhere(p.slid.slider.position if p.slid else 0.0)[0]
        K = K + (system.film.stiffness * normal) @ normal.T
    deflection = abs(float(np.linalg.solve(K, force * np.eye(count)[at])[at]))
    return base.Scale(base.round_down(_MOVED * _LENGTH / deflection) if deflection else 1.0, force or 1.0)


class Plate(base.Picture):
    """Plate, foam, slider, and the film between plate and slider if it can open."""

    eye = (0.1, -2.0, 1.65)
    target = (0.0, 0.0, 0.05)

    def __init__(self, p: Parameters, points: Points | None, scale: base.Scale) -> None:
        super().__init__(scale)
        assert p.slid is not None
        assert p.foam is not None
        self._plate, self._foam, self._slider = p.plate, p.foam, p.slid.slider
        self._probe = p.probe
        self._cells = Cells(points) if points is not None else None
        self._lifted = _LIFTED if points is not None else 0.0

    @classmethod
    def of(cls, scene: Scene, assembly: Assembly, system: System) -> Self | None:
        """See `Picture.of`; None for a plate without a slider."""
        parameters = scene.parameters
        if not isinstance(parameters, Parameters) or parameters.slid is None:
            return None
        return cls(parameters, Points.of(scene), _scale(parameters, system, largest_load(scene)))

    @property
    def _rear(self) -> float:
        """Position of the plate's rear edge in the picture [lengths]."""
        return -0.5 * float(self._plate.length) / _LENGTH

    def static(self, log: base.Log) -> None:
        """See `Picture.static`."""

        def box(path: str, size: tuple[float, float, float], top: float, colour: tuple[int, int, int]) -> None:
            half = tuple(0.5 * length / _LENGTH for length in size)
            drawn = base.Shape("Boxes3D", half_sizes=[half], centers=[(0, 0, top - half[2])], colors=[colour])
            log(f"rig/{path}", drawn)

        plate, slider = self._plate, self._slider
        box("plate", (plate.length, plate.width, plate.thickness), 0.0, base.DISC)
        box("foam", (plate.length, plate.width, self._foam.thickness), -plate.thickness / _LENGTH, _FOAM)
        half = (0.5 * slider.length / _LENGTH, 0.5 * slider.width / _LENGTH, 0.5 * slider.thickness / _LENGTH)
        block = base.Shape(
            "Boxes3D",
            half_sizes=[half],
            centers=[(0, 0, -half[2])],
            colors=[base.STEEL],
            fill_mode="transparentfillmajorwireframe" if self._cells else "solid",
        )
        log("rig/slider/body", block)
        log("rig/friction", base.Shape("Arrows3D", colors=[self.friction], radii=[0.016]))
        log("rig/probe", base.Shape("Points3D", positions=[(0.0, 0.0, 0.03)], colors=[_PROBE], radii=[0.035]))
        if self._cells is not None:
            self._cells.static(log)

    def _frames(
        self, t_ns: base.Integers, s: Mapping[str, base.Reals], modes: base.Integers, ran: base.Reals
    ) -> list[base.Columns]:
        lengths = self.scale.motion / _LENGTH
        middle = self._rear + (s["position"] + 0.5 * self._slider.length) / _LENGTH
        top = self._lifted + self._slider.thickness / _LENGTH
        zero = np.zeros_like(middle)
        moved = np.stack((middle, zero, top + lengths * s["slider_displacement"]), axis=1)
        probe = np.stack(
            (zero + self._rear + self._probe.x / _LENGTH, zero + self._probe.y / _LENGTH,
             lengths * s["plate_displacement"]), axis=1,
        )  # fmt: skip
        pull = base.Shape(
            "Arrows3D",
            vectors=base.along(0, s["friction_force"] / self.scale.force * 0.8),
            origins=np.stack((middle, zero - 0.6 * self._slider.width / _LENGTH, zero + 0.03), axis=1),
        )
        drawn = [
            base.Columns("rig/slider", t_ns, base.Shape("Transform3D", translation=moved, quaternion=self._turned(s))),
            base.Columns("rig/probe", t_ns, base.Shape("Transform3D", translation=probe)),
            base.Columns("rig/friction", t_ns, pull),
            base.load(t_ns, moved, s["normal_force"] / self.scale.force * 0.25, self.normal),
            base.word(t_ns, (0.0, 0.0, 1.1), self._text(s), [_GREY] * len(t_ns)),
        ]
        return drawn + (self._cells.frames(t_ns, s, middle) if self._cells is not None else [])

    def _turned(self, s: Mapping[str, base.Reals]) -> base.Reals:
        """Quaternions of the magnified pitch about y and roll about x."""
        pitch, roll = (0.5 * self.scale.motion * s[f"{name}_displacement"] for name in ("pitch", "roll"))
        turned = np.stack((roll, pitch, np.zeros_like(roll), np.ones_like(roll)), axis=1)
        return np.asarray(turned / np.linalg.norm(turned, axis=1)[:, None])

    def _text(self, s: Mapping[str, base.Reals]) -> list[str]:
        closed = s.get("contact_fraction", np.ones_like(s["position"]))
        return [
            f"at {1e3 * x:.1f} mm   N = {n:.0f} N   T = {t:+.0f} N   {100 * share:.0f} % in contact   "
            f"motion x {self.scale.motion:,.0f}".replace(",", " ")
            for x, n, t, share in zip(s["position"], s["normal_force"], s["friction_force"], closed)
        ]


class Cells:
    """The film's points as coloured areas: under the slider in the picture (`rig/film`) and as a map (`film`)."""

    eye = (0.0, -0.12, 1.9)
    target = (0.0, -0.12, 0.0)

    def __init__(self, points: Points) -> None:
        self._points = points
        self._unit = 2.0 / points.length  # in the map the slider is two lengths long

    def static(self, log: base.Log) -> None:
        """Send areas, lines between them, and the colour scale with its labels."""
        for path, unit in (("rig/film", 1.0 / _LENGTH), ("film/map", self._unit)):
            corners, triangles = self._shapes(unit)
            log(path, base.Shape("Mesh3D", vertex_positions=corners, triangle_indices=triangles))
        half = 0.5 * self._unit * np.array((self._points.length, self._points.width))
        grid = [np.array([(x, -half[1], 0.004), (x, half[1], 0.004)]) for x in self._edges(0)]
        grid += [np.array([(-half[0], y, 0.004), (half[0], y, 0.004)]) for y in self._edges(1)]
        log("film/grid", base.Shape("LineStrips3D", strips=grid, colors=[(60, 64, 72)], radii=[0.004]))
        self._legend(log, -half[1] - 0.22)
        words = base.Shape(
            "Points3D",
            positions=[(-half[0] + 0.1, half[1] + 0.12, 0.0), (half[0] - 0.3, half[1] + 0.12, 0.0)],
            labels=["rear", "front (travels this way)"],
            colors=[_GREY] * 2,
            radii=[0.001] * 2,
            show_labels=True,
        )
        log("film/sides", words)

    def frames(self, t_ns: base.Integers, s: Mapping[str, base.Reals], middle: base.Reals) -> list[base.Columns]:
        """Pressures as colours, and the pressure centre; `middle`: position of the slider in the picture [lengths]."""
        cells = pressure.colours(self._points.maps(s), self._points.scale).reshape(len(t_ns), -1, 3)
        corners = np.repeat(cells, 4, axis=1)

        def coloured() -> base.Shape:
            return base.Shape("Mesh3D", vertex_colors=corners.reshape(-1, 3))

        centre = np.stack((s["pressure_centre_x"], s["pressure_centre_y"]), axis=1) * self._unit
        marks = np.concatenate((centre, np.full((len(t_ns), 1), 0.03)), axis=1)
        place = np.stack((middle, np.zeros_like(middle), np.full_like(middle, 0.01)), axis=1)
        return [
            base.Columns("rig/film", t_ns, coloured()),
            base.Columns("rig/film", t_ns, base.Shape("Transform3D", translation=place)),
            base.Columns("film/map", t_ns, coloured()),
            base.Columns(
                "film/centre",
                t_ns,
                base.Shape("Points3D", positions=marks, colors=[_CENTRE] * len(t_ns), radii=[0.035] * len(t_ns)),
            ),
        ]

    def _edges(self, axis: int) -> base.Reals:
        """Borders of the areas along an axis of the map [lengths]."""
        size = (self._points.length, self._points.width)[axis] * self._unit
        return np.linspace(-0.5 * size, 0.5 * size, (self._points.along, self._points.across)[axis] + 1)

    def _shapes(self, unit: float) -> tuple[base.Reals, base.Integers]:
        """Corners [4 per point] and triangles of all areas, where one length is 1 / `unit` [m]."""
        x, y = (self._edges(axis) * unit / self._unit for axis in (0, 1))
        places = [(i, j) for i in range(self._points.along) for j in range(self._points.across)]
        corners = [(x[i + a], y[j + b], 0.0) for i, j in places for a, b in ((0, 0), (1, 0), (1, 1), (0, 1))]
        first = 4 * np.arange(len(places))[:, None, None]
        return np.array(corners), (first + np.array([[0, 1, 2], [0, 2, 3]])).reshape(-1, 3)

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
        log("film/scale", mesh)
        top = 1e-6 * self._points.scale
        labels = ["0", f"{top / 2:g}", f"{top:g} MPa and more", "open"]
        places = [(low, y - 0.1, 0.0), (0.5 * (low + high), y - 0.1, 0.0), (high, y - 0.1, 0.0), (0.95, y - 0.1, 0.0)]
        marks = base.Shape(
            "Points3D", positions=places, labels=labels, colors=[_GREY] * 4, radii=[0.001] * 4, show_labels=True
        )
        log("film/scale/words", marks)
