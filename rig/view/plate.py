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
_FOAM, _PROBE = (112, 98, 74), (226, 160, 60)
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

        def box(path: str, size: tuple[float, float, float], top: float, colour: tuple[int, int, int]) -> None:
            half = tuple(0.5 * length / _LENGTH for length in size)
            log(f"rig/{path}", base.Shape.box(half, (0, 0, top - half[2]), colour))

        plate, slider = self._plate, self._slider
        box("plate", (plate.length, plate.width, plate.thickness), 0.0, base.DISC)
        box("foam", (plate.length, plate.width, self._foam.thickness), -plate.thickness / _LENGTH, _FOAM)
        half = (0.5 * slider.length / _LENGTH, 0.5 * slider.width / _LENGTH, 0.5 * slider.thickness / _LENGTH)
        log(
            "rig/slider/body",
            base.Shape(
                "Boxes3D",
                half_sizes=[half],
                centers=[(0, 0, -half[2])],
                colors=[base.STEEL],
                fill_mode="transparentfillmajorwireframe" if self._cells else "solid",
            ),
        )
        log("rig/friction", base.Shape("Arrows3D", colors=[self.friction], radii=[0.016]))
        log("rig/probe", base.Shape("Points3D", positions=[(0.0, 0.0, 0.03)], colors=[_PROBE], radii=[0.035]))
        if self._film is not None and self._cells is not None:
            self._film.static(log)
            self._cells.static(log)
            ends = self._cells.half
            words = base.Shape(
                "Points3D",
                positions=[(-ends[0] + 0.1, ends[1] + 0.12, 0.0), (ends[0] - 0.3, ends[1] + 0.12, 0.0)],
                labels=["rear", "front (travels this way)"],
                colors=[_GREY] * 2,
                radii=[0.001] * 2,
                show_labels=True,
            )
            log("film/sides", words)

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
        if self._film is None or self._cells is None:
            return drawn
        place = np.stack((middle, zero, np.full_like(middle, 0.01)), axis=1)
        drawn.append(base.Columns("rig/film", t_ns, base.Shape("Transform3D", translation=place)))
        return drawn + self._film.frames(t_ns, s) + self._cells.frames(t_ns, s)

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
