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
from rig.view import base
from rig.view.surfaces import Cells

_LENGTH = 0.05  # m
_LIFTED = 0.3  # gap in the picture between the plate and the slider, if there is a film [lengths]
_MOVED = 0.08  # largest size of the slider's static deflection in the picture [lengths]
_FOAM = (112, 98, 74)
_PROBE = (226, 160, 60)
_GREY = (176, 182, 192)


class Plate(base.Picture):
    """Plate, foam, slider, and the film between plate and slider if it can open."""

    eye = (0.1, -2.0, 1.65)
    target = (0.0, 0.0, 0.05)

    def __init__(self, p: Parameters, points: Points | None, scale: base.Scale) -> None:
        super().__init__(scale)
        assert p.slid is not None
        assert p.foam is not None
        self._plate = p.plate
        self._foam = p.foam
        self._slider = p.slid.slider
        self._probe = p.probe
        self._film = Cells(points, "rig/film", 1.0 / _LENGTH, flat=True) if points is not None else None
        self._cells = Cells(points, "film") if points is not None else None
        self.above = points is not None
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
        plate = self._plate
        slider = self._slider
        plate_size = (plate.length, plate.width, plate.thickness)
        foam_size = (plate.length, plate.width, self._foam.thickness)
        foam_top = -plate.thickness / _LENGTH
        log("rig/plate", _below(0.0, plate_size, base.DISC))
        log("rig/foam", _below(foam_top, foam_size, _FOAM))
        half = _half((slider.length, slider.width, slider.thickness))
        body = base.Shape(
            "Boxes3D",
            half_sizes=[half],
            centers=[(0, 0, -half[2])],
            colors=[base.STEEL],
            fill_mode="transparentfillmajorwireframe" if self._cells else "solid",
        )
        probe = base.Shape("Points3D", positions=[(0.0, 0.0, 0.03)], colors=[_PROBE], radii=[0.035])
        log("rig/slider/body", body)
        log("rig/friction", base.Shape("Arrows3D", colors=[self.friction], radii=[0.016]))
        log("rig/probe", probe)
        if self._film is not None and self._cells is not None:
            self._film.static(log)
            self._cells.static(log)
            log("film/sides", _sides(*self._cells.half))

    def _frames(
        self, t_ns: base.Integers, s: Mapping[str, base.Reals], modes: base.Integers, ran: base.Reals
    ) -> list[base.Columns]:
        lengths = self.scale.motion / _LENGTH
        middle = self._rear + (s["position"] + 0.5 * self._slider.length) / _LENGTH
        zero = np.zeros_like(middle)
        top = self._lifted + self._slider.thickness / _LENGTH
        height = top + lengths * s["slider_displacement"]
        slider = np.stack((middle, zero, height), axis=1)
        drawn = [
            base.moved("rig/slider", t_ns, translation=slider, quaternion=self._turned(s)),
            base.moved("rig/probe", t_ns, translation=self._probed(lengths * s["plate_displacement"])),
            base.Columns("rig/friction", t_ns, self._pull(middle, s["friction_force"])),
            self._load(t_ns, slider, s["normal_force"]),
            base.word(t_ns, (0.0, 0.0, 1.1), self._text(s), [_GREY] * len(t_ns)),
        ]
        if self._film is None or self._cells is None:
            return drawn
        place = np.stack((middle, zero, np.full_like(middle, 0.01)), axis=1)
        drawn.append(base.moved("rig/film", t_ns, translation=place))
        return drawn + self._film.frames(t_ns, s) + self._cells.frames(t_ns, s)

    def _probed(self, height: base.Reals) -> base.Reals:
        """Places of the probe on the plate at these heights."""
        zero = np.zeros_like(height)
        x = zero + self._rear + self._probe.x / _LENGTH
        y = zero + self._probe.y / _LENGTH
        return np.stack((x, y, height), axis=1)

    def _pull(self, middle: base.Reals, force: base.Reals) -> base.Shape:
        """The arrows of the friction beside the slider, whose middle is at `middle`."""
        zero = np.zeros_like(middle)
        beside = zero - 0.6 * self._slider.width / _LENGTH
        return base.Shape(
            "Arrows3D",
            vectors=base.along(0, force / self.scale.force * 0.8),
            origins=np.stack((middle, beside, zero + 0.03), axis=1),
        )

    def _turned(self, s: Mapping[str, base.Reals]) -> base.Reals:
        """Quaternions of the magnified pitch about y and roll about x."""
        half = 0.5 * self.scale.motion
        pitch = half * s["pitch_displacement"]
        roll = half * s["roll_displacement"]
        turned = np.stack((roll, pitch, np.zeros_like(roll), np.ones_like(roll)), axis=1)
        return np.asarray(turned / np.linalg.norm(turned, axis=1)[:, None])

    def _text(self, s: Mapping[str, base.Reals]) -> list[str]:
        closed = s.get("contact_fraction", np.ones_like(s["position"]))
        magnified = f"motion x {self.scale.motion:,.0f}".replace(",", " ")
        rows = zip(s["position"], s["normal_force"], s["friction_force"], closed)
        return [
            f"at {1e3 * x:.1f} mm   N = {n:.0f} N   T = {t:+.0f} N   {100 * share:.0f} % in contact   {magnified}"
            for x, n, t, share in rows
        ]


def _half(size: tuple[float, float, float]) -> tuple[float, float, float]:
    """Half of the lengths of a box of `size` [m] in the picture."""
    length, width, thickness = size
    return (0.5 * length / _LENGTH, 0.5 * width / _LENGTH, 0.5 * thickness / _LENGTH)


def _below(top: float, size: tuple[float, float, float], colour: base.Colour) -> base.Shape:
    """A box of `size` [m] below the height `top`."""
    half = _half(size)
    return base.Shape.box(half, (0, 0, top - half[2]), colour)


def _sides(x: float, y: float) -> base.Shape:
    """The names of the slider's ends over a map that reaches from -x to x and from -y to y."""
    return base.Shape(
        "Points3D",
        positions=[(-x + 0.1, y + 0.12, 0.0), (x - 0.3, y + 0.12, 0.0)],
        labels=["rear", "front (travels this way)"],
        colors=[_GREY] * 2,
        radii=[0.001] * 2,
        show_labels=True,
    )


def _scale(p: Parameters, system: System, force: float) -> base.Scale:
    """The scale from the slider's static deflection under the largest load `force` [N], at its initial position."""
    count = len(system.coordinates)
    stiffness = system.stiffness - system.force[:, :count]
    if system.film is not None:
        position = p.slid.slider.position if p.slid else 0.0
        normal = system.film.everywhere(position)[0]
        stiffness = stiffness + (system.film.stiffness * normal) @ normal.T
    heave = list(system.names[:count]).index("z")
    loads = force * np.eye(count)[heave]
    moved = np.linalg.solve(stiffness, loads)
    deflection = abs(float(moved[heave]))
    magnified = 1.0
    if deflection:
        magnified = base.round_down(_MOVED * _LENGTH / deflection)
    return base.Scale(magnified, force or 1.0)
