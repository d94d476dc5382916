"""The rig as a moving picture, drawn from its outputs: what rubs on what, how it moves, which forces act.

    pendulum   an arm on the axis of a rotating disc, its shoe on the disc, a spring to a post
    belt       a mass on a running belt, a spring to a wall; rigs like it are drawn by `lumped`

Motions are magnified, arm and disc (mass and belt) alike, so that in stick they move as one. The shoe has the colour of
the contact mode; arrows show friction and normal force. Geometry is sent once; a frame is a few transforms.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from rig.solve.system import System
from rig.view import contact

if TYPE_CHECKING:
    import rerun as rr

Reals = NDArray[np.float64]
Integers = NDArray[np.int64]

_STEEL, _DISC, _MARK, _SPRING = (150, 158, 170), (74, 80, 92), (214, 219, 226), (196, 200, 208)
_FRICTION, _NORMAL = (226, 74, 66), (120, 190, 120)
_REACH = 0.35
"""What the largest expected motion measures in the picture, rad or lengths."""
_ARM = 0.8
_PITCH = 0.25
_BELT = 1.5


class Columns(NamedTuple):
    """Rows of one entity: its path, the times [ns] and what rerun calls component columns."""

    path: str
    t_ns: Integers
    columns: Any


class Scale(NamedTuple):
    """How large things are drawn: motion magnified `motion` times, a force of `force` [N] half a length long."""

    motion: float
    force: float


def scale_of(system: System | None) -> Scale:
    """From the rig: where static friction under the load of the start can pull it, half again."""
    if system is None or not system.patches or not system.normals:
        return Scale(10.0, 10.0)
    patch = system.patches[0]
    load = float(abs(system.normals[0].row @ system.start)) or 1.0
    force = patch.law.static * load
    count = len(system.coordinates)
    stiffness = system.stiffness - sum(np.outer(k.direction, k.row[:count]) for k in system.normals)
    reach = float(np.abs(np.linalg.lstsq(stiffness, patch.direction * force, rcond=None)[0]).max())
    return Scale(_round_down(_REACH / (1.5 * reach)) if reach else 1.0, force or 1.0)


def _round_down(value: float) -> float:
    """To 1, 2 or 5 times a power of ten."""
    base = 10.0 ** math.floor(math.log10(value))
    return base * max(step for step in (1.0, 2.0, 5.0) if step * base <= value * (1.0 + 1e-9))


def picture_of(system: System | None, outputs: Mapping[str, str]) -> Picture | None:
    """The picture of a rig with these outputs; None if nobody has drawn one yet."""
    needed = {"displacement", "surface_speed", "friction_force", "normal_force"}
    if {"angle", "disc_speed", *needed} <= set(outputs):
        return Pendulum(scale_of(system))
    if needed <= set(outputs):
        from rig.view import lumped  # pictures that build on those here

        for mark, drawn in (("height", lumped.Lifting), ("tilt", lumped.Tilting), ("pin_displacement", lumped.Pin)):
            if mark in outputs:
                return drawn(scale_of(system))
        return Belt(scale_of(system))
    return None


class Picture:
    """Common to all: the surface that runs on, colours, arrows."""

    surface = ""
    """Output that is the speed of the surface."""
    eye: tuple[float, float, float]
    target: tuple[float, float, float]

    def __init__(self, scale: Scale) -> None:
        self.scale = scale
        self._ran, self._last_ns, self._speed = 0.0, -1, 0.0

    def static(self, rec: rr.RecordingStream) -> None:
        """Send what never changes."""
        raise NotImplementedError

    def frames(self, t_ns: Integers, signals: Mapping[str, Reals], modes: Integers, shown: Integers) -> list[Columns]:
        """Frames at the rows `shown` of the states at `t_ns`; every row counts for how far the surface has run."""
        ran = self._run(t_ns, signals[self.surface])[shown]
        picked = {name: v[shown] for name, v in signals.items()}
        return self._frames(t_ns[shown], picked, modes[shown], ran)

    def _frames(self, t_ns: Integers, s: Mapping[str, Reals], modes: Integers, ran: Reals) -> list[Columns]:
        raise NotImplementedError

    def _run(self, t_ns: Integers, speed: Reals) -> Reals:
        """How far the surface has run, by the trapezium rule over all states so far."""
        begin_ns, begin = (self._last_ns, self._speed) if self._last_ns >= 0 else (int(t_ns[0]), float(speed[0]))
        seconds = np.diff(t_ns, prepend=begin_ns) * 1e-9
        middle = 0.5 * (speed + np.concatenate(([begin], speed[:-1])))
        ran = self._ran + np.cumsum(np.nan_to_num(seconds * middle))
        self._ran, self._last_ns, self._speed = float(ran[-1]), int(t_ns[-1]), float(speed[-1])
        return ran

    def _said(self, modes: Integers, s: Mapping[str, Reals]) -> list[str]:
        return [
            f"{contact.NAMES[mode]}   T = {force:+.1f} N   N = {load:.1f} N   motion x {self.scale.motion:g}"
            for mode, force, load in zip(modes, s["friction_force"], s["normal_force"])
        ]


def _coloured(modes: Integers) -> list[tuple[int, int, int]]:
    return [contact.rgb(contact.COLOURS[mode]) for mode in modes]


def _about_z(angles: Reals) -> Reals:
    """Quaternions (x, y, z, w) of turns about the z axis."""
    zero = np.zeros_like(angles)
    return np.stack((zero, zero, np.sin(angles / 2), np.cos(angles / 2)), axis=1)


def _along(axis: int, lengths: Reals) -> Reals:
    vectors = np.zeros((lengths.size, 3))
    vectors[:, axis] = lengths
    return vectors


def _zigzag(begin: Reals, end: Reals, flat: bool) -> Reals:
    """Springs [frame, point, xyz] between points [frame, xyz], wound in the horizontal plane or upright."""
    share = np.array([0.0, 0.1, *np.linspace(0.15, 0.85, 11), 0.9, 1.0])
    side = np.array([0.0, 0.0, *np.where(np.arange(11) % 2, 0.05, -0.05), 0.0, 0.0])
    span = end - begin
    across = np.cross([0.0, 0.0, 1.0] if flat else [0.0, 1.0, 0.0], span)
    across /= np.maximum(np.linalg.norm(across, axis=1, keepdims=True), 1e-9)
    points: Reals = begin[:, None] + share[:, None] * span[:, None] + side[:, None] * across[:, None]
    return points


class Pendulum(Picture):
    """The pendulum of the papers, from above and aside; the axis of both is z, and the disc's radius is one length."""

    surface = "disc_speed"
    eye = (1.5, 0.9, 1.2)
    target = (0.12, -0.02, 0.08)

    def static(self, rec: rr.RecordingStream) -> None:
        """See `Picture.static`."""
        import rerun as rr

        log = rec.log
        log("rig", rr.ViewCoordinates.RIGHT_HAND_Z_UP, static=True)
        turns = np.linspace(0.0, 2.0 * np.pi, 24, endpoint=False)
        rays = np.stack((np.cos(turns), np.sin(turns), np.full(24, 0.02) / 0.99), axis=1)
        spokes = [np.stack((ray * (0.93, 0.93, 1.0), ray * (0.99, 0.99, 1.0))) for ray in rays]
        spokes += [np.stack((ray * (0.3, 0.3, 1.0), ray * (0.99, 0.99, 1.0))) for ray in rays[::8]]
        disc = rr.Cylinders3D(lengths=[0.08], radii=[1.0], centers=[(0, 0, -0.025)], colors=[_DISC], fill_mode="solid")
        log("rig/disc", disc, static=True)
        log("rig/disc/marks", rr.LineStrips3D(spokes, colors=[_MARK], radii=[0.006]), static=True)
        shaft = rr.Cylinders3D(lengths=[0.5], radii=[0.07], centers=[(0, 0, 0.25)], colors=[_STEEL], fill_mode="solid")
        log("rig/pendulum/shaft", shaft, static=True)
        arm = rr.Boxes3D(
            half_sizes=[(_ARM / 2, 0.035, 0.03)], centers=[(_ARM / 2, 0, 0.2)], colors=[_STEEL], fill_mode="solid"
        )
        log("rig/pendulum/arm", arm, static=True)
        shoe = rr.Boxes3D(half_sizes=[(0.07, 0.06, 0.075)], centers=[(_ARM, 0, 0.1)], fill_mode="solid")
        log("rig/pendulum/shoe", shoe, static=True)
        log("rig/pendulum/friction", rr.Arrows3D.from_fields(origins=[(_ARM + 0.1, 0, 0.06)],
                                                 colors=[_FRICTION], radii=[0.016]), static=True)  # fmt: skip
        post = rr.Boxes3D(half_sizes=[(0.04, 0.04, 0.15)], centers=[_POST - (0, 0, 0.05)], colors=[_STEEL],
                          fill_mode="solid")  # fmt: skip
        log("rig/post", post, static=True)

    def _frames(self, t_ns: Integers, s: Mapping[str, Reals], modes: Integers, ran: Reals) -> list[Columns]:
        import rerun as rr

        zoom, colours = self.scale.motion, _coloured(modes)
        angles = zoom * s["angle"]
        tips = np.stack((0.55 * np.cos(angles), 0.55 * np.sin(angles), np.full_like(angles, 0.2)), axis=1)
        friction = _along(1, s["friction_force"] / self.scale.force * 0.5)
        heads = np.stack((_ARM * np.cos(angles), _ARM * np.sin(angles), np.full_like(angles, 0.24)), axis=1)
        return [
            Columns("rig/disc", t_ns, rr.Transform3D.columns(quaternion=_about_z(zoom * ran))),
            Columns("rig/pendulum", t_ns, rr.Transform3D.columns(quaternion=_about_z(angles))),
            Columns("rig/pendulum/shoe", t_ns, rr.Boxes3D.columns(colors=colours)),
            Columns("rig/pendulum/friction", t_ns, rr.Arrows3D.columns(vectors=friction)),
            _load(t_ns, heads, s["normal_force"] / self.scale.force * 0.25),
            _spring(t_ns, _zigzag(np.broadcast_to(_POST, tips.shape), tips, flat=True)),
            _word(t_ns, (0.0, 0.0, 0.72), self._said(modes, s), colours),
        ]


_POST = np.array((0.55, -0.75, 0.2))


class Belt(Picture):
    """The mass on the belt, from the side; x is the way of the belt."""

    surface = "surface_speed"
    eye = (0.2, -2.5, 1.3)
    target = (0.0, 0.0, 0.12)

    def static(self, rec: rr.RecordingStream) -> None:
        """See `Picture.static`."""
        import rerun as rr

        log = rec.log
        log("rig", rr.ViewCoordinates.RIGHT_HAND_Z_UP, static=True)
        rollers = rr.Cylinders3D(
            lengths=[0.9, 0.9], radii=[0.15, 0.15], centers=[(-_BELT, 0, -0.16), (_BELT, 0, -0.16)],
            quaternions=[_LYING, _LYING], colors=[_STEEL], fill_mode="solid",
        )  # fmt: skip
        log("rig/rollers", rollers, static=True)
        bands = rr.Boxes3D(
            half_sizes=[(_BELT, 0.42, 0.01)] * 2, centers=[(0, 0, -0.01), (0, 0, -0.31)], colors=[_DISC],
            fill_mode="solid",
        )  # fmt: skip
        log("rig/belt", bands, static=True)
        places = np.arange(-_BELT, _BELT - _PITCH / 2, _PITCH)
        lines = [np.array([(x, -0.42, 0.006), (x, 0.42, 0.006)]) for x in places]
        log("rig/marks", rr.LineStrips3D(lines, colors=[_MARK], radii=[0.006]), static=True)
        log("rig/mass/body", rr.Boxes3D(half_sizes=[(0.2, 0.2, 0.17)], centers=[(0, 0, 0.19)], fill_mode="solid"),
            static=True)  # fmt: skip
        log("rig/mass/friction", rr.Arrows3D.from_fields(origins=[(0, -0.27, 0.04)], colors=[_FRICTION],
                                             radii=[0.018]), static=True)  # fmt: skip
        wall = rr.Boxes3D(half_sizes=[(0.03, 0.35, 0.3)], centers=[(-1.25, 0, 0.32)], colors=[_STEEL],
                          fill_mode="solid")  # fmt: skip
        log("rig/wall", wall, static=True)

    def _frames(self, t_ns: Integers, s: Mapping[str, Reals], modes: Integers, ran: Reals) -> list[Columns]:
        import rerun as rr

        zoom, colours = self.scale.motion, _coloured(modes)
        x = zoom * s["displacement"]
        zero = np.zeros_like(x)
        tips = np.stack((x - 0.2, zero, zero + 0.2), axis=1)
        heads = np.stack((x, zero, zero + 0.37), axis=1)
        return [
            Columns("rig/marks", t_ns, rr.Transform3D.columns(translation=_along(0, np.mod(zoom * ran, _PITCH)))),
            Columns("rig/mass", t_ns, rr.Transform3D.columns(translation=_along(0, x))),
            Columns("rig/mass/body", t_ns, rr.Boxes3D.columns(colors=colours)),
            Columns("rig/mass/friction", t_ns,
                    rr.Arrows3D.columns(vectors=_along(0, s["friction_force"] / self.scale.force * 0.6))),
            _load(t_ns, heads, s["normal_force"] / self.scale.force * 0.25),
            _spring(t_ns, _zigzag(np.broadcast_to((-1.22, 0.0, 0.2), tips.shape), tips, flat=False)),
            _word(t_ns, (0.0, 0.0, 1.02), self._said(modes, s), colours),
        ]  # fmt: skip


_LYING = (math.sqrt(0.5), 0.0, 0.0, math.sqrt(0.5))


def _load(t_ns: Integers, heads: Reals, lengths: Reals) -> Columns:
    """The normal force, pressing down on points `heads`."""
    import rerun as rr

    down = _along(2, -np.maximum(lengths, 0.0))
    count = len(heads)
    return Columns(
        "rig/load", t_ns,
        rr.Arrows3D.columns(vectors=down, origins=heads - down, colors=[_NORMAL] * count, radii=[0.016] * count),
    )  # fmt: skip


def _spring(t_ns: Integers, strips: Reals) -> Columns:
    import rerun as rr

    count = len(strips)
    columns = rr.LineStrips3D.columns(strips=list(strips), colors=[_SPRING] * count, radii=[0.009] * count)
    return Columns("rig/spring", t_ns, columns)


def _word(t_ns: Integers, place: tuple[float, float, float], said: list[str], colours: Any) -> Columns:
    import rerun as rr

    count = len(said)
    columns = rr.Points3D.columns(
        positions=[place] * count, labels=said, colors=colours, radii=[0.001] * count, show_labels=[True] * count
    )
    return Columns("rig/word", t_ns, columns)
