"""The moving picture of the disc brake: disc, pads, calliper and carriers, which translate and rotate as in squeal.

The view is from the front and one length is a decimetre; x is the direction of the disc's surface, z its axis. Motions
are magnified by a stated factor. The plant outputs only the motion of one point, the probe. The other bodies are drawn
by the eigenvector of the growing vibration mode; x - i v / omega of the probe is its complex amplitude. Squeal is
faster than any picture, so a stroboscope selects the instants: among the states since the last frame, the one nearest
to a phase that advances at 1 Hz. The lining of a contact has the colour of the contact state; grey: open.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import NamedTuple, Self

import numpy as np
from numpy.typing import NDArray

from rig.model.assembly import Assembly
from rig.model.system import System
from rig.scenes.scene import Scene
from rig.stability.linearisation import sliding_key, steady
from rig.view import base, contact

BODIES = ("disc", "inner_pad", "outer_pad", "calliper", "free_carrier", "supporting_carrier")
_PLACES = {
    "disc": (0.0, 0.0),
    "inner_pad": (0.0, -0.225),
    "outer_pad": (0.0, 0.225),
    "calliper": (0.0, 0.0),
    "free_carrier": (-0.85, 0.0),
    "supporting_carrier": (0.85, 0.0),
}
"""Positions x, z of the centres of the bodies [lengths]."""
_BOXES = {
    "disc": [((1.35, 0.42, 0.11), (0.0, 0.05, 0.0))],
    "inner_pad": [((0.55, 0.3, 0.075), (0.0, 0.0, -0.025))],
    "outer_pad": [((0.55, 0.3, 0.075), (0.0, 0.0, 0.025))],
    "calliper": [
        ((0.42, 0.26, 0.07), (0.0, 0.0, -0.52)),
        ((0.42, 0.26, 0.07), (0.0, 0.0, 0.52)),
        ((0.42, 0.05, 0.59), (0.0, 0.56, 0.0)),
    ],
    "free_carrier": [
        ((0.08, 0.25, 0.06), (0.0, 0.0, -0.225)),
        ((0.08, 0.25, 0.06), (0.0, 0.0, 0.225)),
        ((0.05, 0.04, 0.28), (0.0, 0.56, 0.0)),
    ],
    "supporting_carrier": [
        ((0.08, 0.25, 0.06), (0.0, 0.0, -0.225)),
        ((0.08, 0.25, 0.06), (0.0, 0.0, 0.225)),
        ((0.05, 0.04, 0.28), (0.0, 0.56, 0.0)),
    ],
}
"""Half sizes and centres of boxes, relative to the centre of the body."""
_SIDES = (("inner", -0.225), ("outer", 0.225))
_SPRINGS = (
    *((("inner_pad", (side * 0.25, -0.1)), ("calliper", (side * 0.25, -0.45))) for side in (-1.0, 1.0)),
    *((("outer_pad", (side * 0.25, 0.1)), ("calliper", (side * 0.25, 0.45))) for side in (-1.0, 1.0)),
    *(((f"{pad}_pad", (-0.55, 0.0)), ("free_carrier", (0.08, z))) for pad, z in _SIDES),
    *(((f"{pad}_pad", (0.55, 0.0)), ("supporting_carrier", (-0.08, z))) for pad, z in _SIDES),
    (("free_carrier", (-0.08, 0.225)), (None, (-1.35, 0.225))),
    (("free_carrier", (-0.08, -0.225)), (None, (-1.35, -0.225))),
    (("supporting_carrier", (0.08, 0.225)), (None, (1.35, 0.225))),
    (("supporting_carrier", (0.08, -0.225)), (None, (1.35, -0.225))),
)
"""Both ends of each spring as (body, point relative to its centre); None is the ground."""
_LINING = 0.18
_THICK = 0.02
_FRONT = -0.32  # y at which springs and arrows are drawn
_PITCH = 0.3
_DRAWN = 0.13  # largest motion in the picture when the first contact just opens [lengths]
_SLOW = 1.0  # frequency at which the stroboscope shows the vibration [Hz]
Placed = Mapping[str, tuple[base.Reals, base.Reals, base.Reals]]
"""Magnified x, z [lengths] and rotation [rad] of each body, frame by frame."""


class Motion(NamedTuple):
    """A vibration mode at `omega` [rad/s]: amplitudes of x, z, phi [m, m, rad] of `BODIES` per metre of the probe."""

    shape: dict[str, tuple[complex, complex, complex]]
    omega: float
    opens: float
    """Amplitude of the probe [m] at which the first contact opens."""


def motion_of(system: System, probe: Mapping[str, float]) -> Motion:
    """The growing vibration mode or, if none grows, the one that moves the probe most.

    `probe`: coordinate -> its coefficient in the displacement of the probe.
    """
    at = steady(system, sliding_key(system))
    rates, vectors = at.eigenvectors()
    count = len(system.coordinates)
    names = list(system.names[:count])
    row = np.array([probe.get(name, 0.0) for name in names])
    vectors = vectors[:count]
    energy = np.einsum("ik,ij,jk->k", vectors.conj(), system.mass, vectors).real
    moves = np.abs(row @ vectors) / np.sqrt(np.maximum(energy, 1e-300))
    swings = rates.imag > 1.0
    grows = swings & (rates.real > 0.0)
    if grows.any():
        best = int(np.where(grows, rates.real, -np.inf).argmax())
    else:
        best = int(np.where(swings, moves, 0.0).argmax())
    vector = vectors[:, best] / (row @ vectors[:, best])

    def of(body: str, axis: str) -> complex:
        return complex(vector[names.index(f"{body}.{axis}")])

    swing = [float(abs(normal.row[:count] @ vector)) for normal in system.normals]
    opens = min(float(normal.row @ at.x) / amplitude for normal, amplitude in zip(system.normals, swing))
    shape = {body: (of(body, "x"), of(body, "z"), of(body, "phi")) for body in BODIES if body != "disc"}
    shape["disc"] = (of("disc", "x"), *disc_at_contacts(system, vector))
    return Motion(shape, float(rates[best].imag), opens)


def disc_at_contacts(system: System, vector: NDArray[np.complex128]) -> tuple[complex, complex]:
    """Amplitudes z [m] and phi [rad] of the disc between its contacts, be it rigid or bent: u_z = z - a phi at a."""
    names = list(system.names[: len(vector)])
    of_disc = np.array([name.startswith("disc.") for name in names])
    places = []
    heights = []
    for normal in system.normals:
        for pad in ("inner_pad", "outer_pad"):
            towards = normal.direction[names.index(f"{pad}.z")]
            if towards:
                places.append(-normal.direction[names.index(f"{pad}.phi")] / towards)
                heights.append(-normal.direction[of_disc] @ vector[of_disc] / towards)
    slope, height = np.polynomial.polynomial.polyfit(places, heights, 1)[::-1]
    return complex(height), complex(-slope)


class Brake(base.Picture):
    """Disc, pads, calliper and carriers under the stroboscope."""

    eye = (0.4, -2.3, 0.9)
    target = (0.0, 0.0, 0.0)

    def __init__(self, system: System, probe: Mapping[str, float]) -> None:
        self.motion = motion_of(system, probe)
        sizes = [abs(amplitude) for x, z, phi in self.motion.shape.values() for amplitude in (x, z, 0.05 * phi)]
        largest = 10.0 * self.motion.opens * max(sizes)
        load = max((abs(float(normal.row @ system.start)) for normal in system.normals), default=1.0) or 1.0
        super().__init__(base.Scale(base.round_down(_DRAWN / largest), load))
        self._contacts = [normal.name for normal in system.normals]

    @classmethod
    def of(cls, scene: Scene, assembly: Assembly, system: System) -> Self | None:
        """See `Picture.of`; None for a brake with other bodies than `BODIES`."""
        known = {f"{body}.x" for body in BODIES} <= set(system.names)
        return cls(system, assembly.outputs["displacement"].row) if known else None

    def static(self, log: base.Log) -> None:
        """See `Picture.static`."""
        for body, boxes in _BOXES.items():
            halves, centers = zip(*boxes)
            colour = base.DISC if body == "disc" else base.STEEL
            shape = base.Shape("Boxes3D", half_sizes=halves, centers=centers, colors=[colour] * len(boxes))
            log(f"rig/{body}/body", shape)
        lines = [np.array([(x, -0.375, -0.11), (x, -0.375, 0.11)]) for x in np.arange(-1.2, 1.2, _PITCH)]
        log("rig/disc/marks", base.Shape.marks(lines, 0.006))
        for name in self._contacts:
            pad, side = _where(name)
            up = -1.0 if pad == "outer_pad" else 1.0
            middle = (1.3 * side * _LINING, 0.0, 0.075 * up)
            log(f"rig/{pad}/{name}", base.Shape("Boxes3D", half_sizes=[(0.22, 0.3, _THICK)], centers=[middle]))

    def frames(
        self, t_ns: base.Integers, signals: Mapping[str, base.Reals], modes: base.Integers, shown: base.Integers
    ) -> list[base.Columns]:
        """See `Picture.frames`; the stroboscope replaces the rows `shown` by earlier ones."""
        z = signals["displacement"] - 1j * signals["velocity"] / self.motion.omega
        behind = np.angle(z * np.exp(-2j * math.pi * _SLOW * 1e-9 * t_ns))
        begins = [0, *(shown[:-1] + 1)]
        picked = [begin + int(np.abs(behind[begin : end + 1]).argmin()) for begin, end in zip(begins, shown)]
        return super().frames(t_ns, signals, modes, np.array(picked, np.int64))

    def placed(self, s: Mapping[str, base.Reals]) -> Placed:
        """The motion of each body at the states `s`."""
        z = s["displacement"] - 1j * s["velocity"] / self.motion.omega
        lengths = 10.0 * self.scale.motion
        moved = {}
        for body, (along_x, along_z, turn) in self.motion.shape.items():
            moved[body] = (
                lengths * (along_x * z).real,
                lengths * (along_z * z).real,
                self.scale.motion * (turn * z).real,
            )
        return moved

    def _frames(
        self, t_ns: base.Integers, s: Mapping[str, base.Reals], modes: base.Integers, ran: base.Reals
    ) -> list[base.Columns]:
        placed = self.placed(s)
        columns = [base.moved(f"rig/{body}", t_ns, **_transform(body, placed)) for body in placed]
        marks = base.along(0, np.mod(10.0 * ran, _PITCH))
        columns.append(base.moved("rig/disc/marks", t_ns, translation=marks))
        columns += [self._lining(name, t_ns, s, modes) for name in self._contacts]
        springs = [base.zigzag(_point(placed, a), _point(placed, b), flat=False) for a, b in _SPRINGS]
        columns.append(base.spring(t_ns, *springs, radius=0.006))
        columns += [self._pressed(name, t_ns, s, placed) for name in self._contacts]
        drag = base.along(0, 0.25 * s["friction_force"] / self.scale.force)
        columns.append(_arrows("rig/friction", t_ns, drag, _point(placed, ("inner_pad", (0.0, 0.04))), self.friction))
        columns.append(base.word(t_ns, (0.0, 0.0, 0.95), self._text(s, modes), base.coloured(modes)))
        return columns

    def _lining(
        self, name: str, t_ns: base.Integers, s: Mapping[str, base.Reals], modes: base.Integers
    ) -> base.Columns:
        """The colour of the lining of a contact."""
        pad, _ = _where(name)
        lifted = s[f"normal_force_{name}"] <= 0.0
        return base.painted(f"rig/{pad}/{name}", t_ns, base.coloured(np.where(lifted, -1, modes)))

    def _pressed(self, name: str, t_ns: base.Integers, s: Mapping[str, base.Reals], placed: Placed) -> base.Columns:
        """The arrows of the normal force at a contact."""
        pad, side = _where(name)
        up = 1.0 if pad == "outer_pad" else -1.0
        end = _point(placed, (pad, (side * _LINING, -0.11 * up)))
        force = base.along(2, up * 0.25 * np.maximum(s[f"normal_force_{name}"], 0.0) / self.scale.force)
        return _arrows(f"rig/load/{name}", t_ns, force, end, self.normal)

    def _text(self, s: Mapping[str, base.Reals], modes: base.Integers) -> list[str]:
        """Contact state, amplitude of the probe, and how the picture magnifies and slows the vibration."""
        frequency = self.motion.omega / (2.0 * math.pi)
        magnified = f"motion x {self.scale.motion:g}, {frequency:.0f} Hz shown at {_SLOW:g} Hz"
        size = 1e6 * np.hypot(s["displacement"], s["velocity"] / self.motion.omega)
        return [
            f"{contact.NAMES[mode]}   pad {micrometres:.2f} um   {magnified}" for mode, micrometres in zip(modes, size)
        ]


def _where(name: str) -> tuple[str, float]:
    """Pad and side (-1 left, 1 right) of a contact, from its name in the scene."""
    pad = "outer_pad" if name.startswith("outer") else "inner_pad"
    side = 1.0 if name.endswith("right") else -1.0
    return pad, side


def _transform(body: str, placed: Placed) -> dict[str, base.Reals]:
    """Translation and rotation of a body."""
    x, z, phi = placed[body]
    x_at_rest, z_at_rest = _PLACES[body]
    centres = np.stack((x_at_rest + x, np.zeros_like(x), z_at_rest + z), axis=1)
    return {"translation": centres, "quaternion": base.about(1, phi)}


def _point(placed: Placed, end: tuple[str | None, tuple[float, float]]) -> base.Reals:
    """Position of a point of a body [frame, xyz]."""
    body, (a, b) = end
    if body is None:
        return np.tile((a, _FRONT, b), (len(placed["disc"][0]), 1))
    x, z, phi = placed[body]
    x_at_rest, z_at_rest = _PLACES[body]
    cos = np.cos(phi)
    sin = np.sin(phi)
    moved_x = x_at_rest + x + a * cos + b * sin
    moved_z = z_at_rest + z - a * sin + b * cos
    return np.stack((moved_x, np.full_like(x, _FRONT), moved_z), axis=1)


def _arrows(path: str, t_ns: base.Integers, vectors: base.Reals, ends: base.Reals, colour: base.Colour) -> base.Columns:
    """The arrows of a force at the points `ends`."""
    count = len(t_ns)
    arrows = base.Shape("Arrows3D", vectors=vectors, origins=ends, colors=[colour] * count, radii=[0.012] * count)
    return base.Columns(path, t_ns, arrows)
