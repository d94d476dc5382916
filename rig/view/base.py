"""The common base of all moving pictures: their elements, scale, moving surface, and the text beside the rig."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from typing import Any, NamedTuple, Self

import numpy as np
from numpy.typing import NDArray

from rig.model.assembly import Assembly
from rig.model.system import System
from rig.scenes.scene import Scene
from rig.view import contact
from rig.view.palette import LINES

Reals = NDArray[np.float64]
Integers = NDArray[np.int64]
Colour = tuple[int, int, int]
"""Red, green and blue, 0 to 255."""

STEEL = (150, 158, 170)
DISC = (74, 80, 92)
MARK = (214, 219, 226)
SPRING = (196, 200, 208)
LYING = (math.sqrt(0.5), 0.0, 0.0, math.sqrt(0.5))
"""Quaternion that turns a cylinder to the y axis."""
_REACH = 0.35  # size of the largest expected motion in the picture [rad or lengths]
_LOAD = 0.25  # length of the arrow of a normal force as large as the force of the scale [lengths]


class Shape:
    """A solid, a line, an arrow or a motion in plain data, so that rerun and the page of `rig web` can draw it.

    `kind` and the names in `fields` are those of rerun's archetypes; pictures consist of `Boxes3D`, `Cylinders3D`,
    `LineStrips3D`, `Arrows3D`, `Points3D`, `Mesh3D`, `Transform3D`. Of a shape that moves, each field has its rows
    frame by frame.
    """

    def __init__(self, kind: str, **fields: Any) -> None:
        self.kind = kind
        self.fields = fields

    @classmethod
    def box(cls, half: Any, center: Any, colour: Colour = STEEL) -> Shape:
        """A box by half of its lengths and its middle."""
        return cls("Boxes3D", half_sizes=[half], centers=[center], colors=[colour])

    @classmethod
    def arrow(cls, origin: Any, colour: Colour, radius: float) -> Shape:
        """An arrow from `origin`; its vector follows frame by frame."""
        return cls("Arrows3D", origins=[origin], colors=[colour], radii=[radius])

    @classmethod
    def marks(cls, strips: list[Any], radius: float) -> Shape:
        """Bright lines on a body, each through its points."""
        return cls("LineStrips3D", strips=strips, colors=[MARK], radii=[radius])


Log = Callable[[str, Shape], object]
"""Takes a shape that never changes, with the path of its entity."""


class Columns(NamedTuple):
    """Rows of one entity: its path, the times [ns], and a shape whose fields have the rows one after the other."""

    path: str
    t_ns: Integers
    columns: Shape


def coloured(modes: Integers) -> list[tuple[int, int, int]]:
    """The colours of contact states."""
    return [contact.rgb(contact.COLOURS[mode]) for mode in modes]


def about(axis: int, angles: Reals) -> Reals:
    """Quaternions (x, y, z, w) of rotations by `angles` [rad] about an axis (0, 1, 2)."""
    turns = np.zeros((angles.size, 4))
    turns[:, axis] = np.sin(angles / 2)
    turns[:, 3] = np.cos(angles / 2)
    return turns


def along(axis: int, lengths: Reals) -> Reals:
    """Vectors of the given lengths along an axis (0, 1, 2)."""
    vectors = np.zeros((lengths.size, 3))
    vectors[:, axis] = lengths
    return vectors


def zigzag(begin: Reals, end: Reals, flat: bool) -> Reals:
    """Springs [frame, point, xyz] between points [frame, xyz], drawn in the horizontal plane (`flat`) or upright."""
    share = np.array([0.0, 0.1, *np.linspace(0.15, 0.85, 11), 0.9, 1.0])
    side = np.array([0.0, 0.0, *np.where(np.arange(11) % 2, 0.05, -0.05), 0.0, 0.0])
    span = end - begin
    across = np.cross([0.0, 0.0, 1.0] if flat else [0.0, 1.0, 0.0], span)
    across /= np.maximum(np.linalg.norm(across, axis=1, keepdims=True), 1e-9)
    points: Reals = begin[:, None] + share[:, None] * span[:, None] + side[:, None] * across[:, None]
    return points


def moved(path: str, t_ns: Integers, **transform: Any) -> Columns:
    """The motion of an entity: `translation`, `quaternion` or both, frame by frame."""
    return Columns(path, t_ns, Shape("Transform3D", **transform))


def painted(path: str, t_ns: Integers, colours: list[Colour]) -> Columns:
    """The colour of a box, frame by frame."""
    return Columns(path, t_ns, Shape("Boxes3D", colors=colours))


def load(t_ns: Integers, heads: Reals, lengths: Reals, colour: Colour, radius: float = 0.016) -> Columns:
    """Arrows of the normal force, which end at the points `heads`."""
    down = along(2, -np.maximum(lengths, 0.0))
    count = len(heads)
    arrows = Shape("Arrows3D", vectors=down, origins=heads - down, colors=[colour] * count, radii=[radius] * count)
    return Columns("rig/load", t_ns, arrows)


def spring(t_ns: Integers, *springs: Reals, radius: float = 0.009) -> Columns:
    """Springs, each given by its points [frame, point, xyz]."""
    strips = [strip for frame in zip(*springs) for strip in frame]
    lines = Shape("LineStrips3D", strips=strips, colors=[SPRING] * len(strips), radii=[radius] * len(strips))
    return Columns("rig/spring", t_ns, lines)


def word(t_ns: Integers, place: tuple[float, float, float], texts: list[str], colours: Any) -> Columns:
    """Text at a position, one for each frame."""
    count = len(texts)
    points = Shape(
        "Points3D",
        positions=[place] * count,
        labels=texts,
        colors=colours,
        radii=[0.001] * count,
        show_labels=[True] * count,
    )
    return Columns("rig/word", t_ns, points)


class Scale(NamedTuple):
    """Scale of a picture: motion is magnified `motion` times, and `force` [N] sets the length of the force arrows."""

    motion: float
    force: float


def scale_of(system: System) -> Scale:
    """The scale for a rig: 1.5 times its deflection by the friction that holds it has about the size `_REACH`."""
    if not system.patches or not system.normals:
        return Scale(10.0, 10.0)
    patch = system.patches[0]
    load = float(abs(system.normals[0].row @ system.start)) or 1.0
    force = patch.law.at_rest(load) * load
    count = len(system.coordinates)
    stiffness = system.stiffness - sum(np.outer(k.direction, k.row[:count]) for k in system.normals)
    reach = float(np.abs(np.linalg.lstsq(stiffness, patch.direction * force, rcond=None)[0]).max())
    return Scale(round_down(_REACH / (1.5 * reach)) if reach else 1.0, force or 1.0)


def round_down(value: float) -> float:
    """Round down to 1, 2 or 5 times a power of ten."""
    base = 10.0 ** math.floor(math.log10(value))
    return base * max(step for step in (1.0, 2.0, 5.0) if step * base <= value * (1.0 + 1e-9))


class Picture:
    """Base class of all moving pictures: integrates the travel of the surface and composes the text."""

    surface = "surface_speed"
    """Name of the output that is the speed of the surface."""
    forces = "friction_force", "normal_force"
    """Names of the outputs that are drawn as arrows: friction and normal force."""
    above = False
    """Whether a second view shows the entities `film` from straight above."""
    eye: tuple[float, float, float]
    target: tuple[float, float, float]

    def __init__(self, scale: Scale) -> None:
        self.scale = scale
        self.paint({})
        self._ran = 0.0
        self._last_ns = -1
        self._speed = 0.0

    @classmethod
    def of(cls, scene: Scene, assembly: Assembly, system: System) -> Self | None:
        """The picture of a rig; None if this class cannot draw it. `assembly`, `system`: those of the scene."""
        return cls(scale_of(system))

    def paint(self, colours: Mapping[str, str]) -> None:
        """Give the arrows of the forces the colours that their outputs have in the plots (output -> "#rrggbb")."""
        self.friction, self.normal = (contact.rgb(colours.get(name, usual)) for name, usual in zip(self.forces, LINES))

    def static(self, log: Log) -> None:
        """Pass everything that never changes to `log`."""
        raise NotImplementedError

    def frames(self, t_ns: Integers, signals: Mapping[str, Reals], modes: Integers, shown: Integers) -> list[Columns]:
        """Frames at the rows `shown` of the states at `t_ns`; all rows contribute to the travel of the surface."""
        ran = self._run(t_ns, signals[self.surface])[shown]
        if not shown.size:
            return []
        return self._frames(t_ns[shown], {name: v[shown] for name, v in signals.items()}, modes[shown], ran)

    def _frames(self, t_ns: Integers, s: Mapping[str, Reals], modes: Integers, ran: Reals) -> list[Columns]:
        raise NotImplementedError

    def _run(self, t_ns: Integers, speed: Reals) -> Reals:
        """Travel of the surface at each row, by the trapezoidal rule over all states so far."""
        begin_ns, begin = (self._last_ns, self._speed) if self._last_ns >= 0 else (int(t_ns[0]), float(speed[0]))
        seconds = np.diff(t_ns, prepend=begin_ns) * 1e-9
        middle = 0.5 * (speed + np.concatenate(([begin], speed[:-1])))
        ran = self._ran + np.cumsum(np.nan_to_num(seconds * middle))
        self._ran = float(ran[-1])
        self._last_ns = int(t_ns[-1])
        self._speed = float(speed[-1])
        return ran

    def _friction(self, path: str, t_ns: Integers, axis: int, force: Reals, length: float) -> Columns:
        """The vectors of an arrow of friction along `axis`: `length` for the force of the scale."""
        return Columns(path, t_ns, Shape("Arrows3D", vectors=along(axis, force / self.scale.force * length)))

    def _load(self, t_ns: Integers, heads: Reals, force: Reals) -> Columns:
        """The arrows of the normal force, which end at the points `heads`."""
        return load(t_ns, heads, force / self.scale.force * _LOAD, self.normal)

    def _contact_text(self, modes: Integers, friction: Reals, normal: Reals) -> list[str]:
        return [
            f"{contact.NAMES[mode]}   T = {force:+.1f} N   N = {load:.1f} N   motion x {self.scale.motion:g}"
            for mode, force, load in zip(modes, friction, normal)
        ]
