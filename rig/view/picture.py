"""The rig as a moving picture, drawn from its outputs: what rubs on what, how it moves, which forces act.

    pendulum   an arm on the axis of a rotating disc, its shoe on the disc, a spring to a post
    belt       a mass on a running belt, a spring to a wall; rigs like these two are drawn by `lumped`
    lever      in `rig.view.lever`; three bodies on a belt in `rig.view.four_dof`; tip in `rig.view.beam`

Motions are magnified, arm and disc (mass and belt) alike, so that in stick they move as one. The shoe has the colour of
the contact mode; arrows show friction and normal force. Geometry is sent once; a frame is a few transforms.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from rig.model.system import System
from rig.view import contact
from rig.view.shapes import (
    DISC,
    FRICTION,
    LYING,
    MARK,
    STEEL,
    Columns,
    Integers,
    Reals,
    about,
    along,
    coloured,
    load,
    spring,
    word,
    zigzag,
)

if TYPE_CHECKING:
    import rerun as rr

_REACH = 0.35
"""What the largest expected motion measures in the picture, rad or lengths."""
_ARM = 0.8
_PITCH = 0.25
_BELT = 1.5


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
    return Scale(round_down(_REACH / (1.5 * reach)) if reach else 1.0, force or 1.0)


def round_down(value: float) -> float:
    """To 1, 2 or 5 times a power of ten."""
    base = 10.0 ** math.floor(math.log10(value))
    return base * max(step for step in (1.0, 2.0, 5.0) if step * base <= value * (1.0 + 1e-9))


def picture_of(
    system: System | None, outputs: Mapping[str, str], probe: Mapping[str, float] | None = None
) -> Picture | None:
    """The picture of a rig with these outputs; None if nobody has drawn one yet.

    `probe`: the row over coordinates that is the output displacement, for a rig of many bodies.
    """
    if not {"displacement", "surface_speed", "friction_force", "normal_force"} <= set(outputs):
        return None
    from rig.view import beam, brake, four_dof, lever, lumped  # pictures that build on those here

    if "clamp_force" in outputs:
        return beam.Tip(beam.scale(system))

    if system is not None and {f"{body}.x" for body in brake.BODIES} <= set(system.names):
        return brake.Brake(system, probe or {"inner_pad.x": 1.0})

    drawn: dict[str, type[Picture]] = {
        "lever_angle": lever.Lever,
        "deflection": lumped.Slider,
        "disc_speed": Pendulum,
        "body_3_height": four_dof.ThreeBodies,
        "height": lumped.Lifting,
        "tilt": lumped.Tilting,
        "pin_displacement": lumped.Pin,
    }
    return next((picture for mark, picture in drawn.items() if mark in outputs), Belt)(scale_of(system))


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


def disc(rec: rr.RecordingStream) -> None:
    """A disc of radius one that turns about the z axis, with marks."""
    import rerun as rr

    rec.log("rig", rr.ViewCoordinates.RIGHT_HAND_Z_UP, static=True)
    turns = np.linspace(0.0, 2.0 * np.pi, 24, endpoint=False)
    rays = np.stack((np.cos(turns), np.sin(turns), np.full(24, 0.02) / 0.99), axis=1)
    spokes = [np.stack((ray * (0.93, 0.93, 1.0), ray * (0.99, 0.99, 1.0))) for ray in rays]
    spokes += [np.stack((ray * (0.3, 0.3, 1.0), ray * (0.99, 0.99, 1.0))) for ray in rays[::8]]
    plate = rr.Cylinders3D(lengths=[0.08], radii=[1.0], centers=[(0, 0, -0.025)], colors=[DISC], fill_mode="solid")
    rec.log("rig/disc", plate, static=True)
    rec.log("rig/disc/marks", rr.LineStrips3D(spokes, colors=[MARK], radii=[0.006]), static=True)


class Pendulum(Picture):
    """The pendulum of the papers, from above and aside; the axis of both is z, and the disc's radius is one length."""

    surface = "disc_speed"
    eye = (1.5, 0.9, 1.2)
    target = (0.12, -0.02, 0.08)

    def static(self, rec: rr.RecordingStream) -> None:
        """See `Picture.static`."""
        import rerun as rr

        log = rec.log
        disc(rec)
        shaft = rr.Cylinders3D(lengths=[0.5], radii=[0.07], centers=[(0, 0, 0.25)], colors=[STEEL], fill_mode="solid")
        log("rig/pendulum/shaft", shaft, static=True)
        arm = rr.Boxes3D(
            half_sizes=[(_ARM / 2, 0.035, 0.03)], centers=[(_ARM / 2, 0, 0.2)], colors=[STEEL], fill_mode="solid"
        )
        log("rig/pendulum/arm", arm, static=True)
        shoe = rr.Boxes3D(half_sizes=[(0.07, 0.06, 0.075)], centers=[(_ARM, 0, 0.1)], fill_mode="solid")
        log("rig/pendulum/shoe", shoe, static=True)
        log("rig/pendulum/friction", rr.Arrows3D.from_fields(origins=[(_ARM + 0.1, 0, 0.06)],
                                                 colors=[FRICTION], radii=[0.016]), static=True)  # fmt: skip
        post = rr.Boxes3D(half_sizes=[(0.04, 0.04, 0.15)], centers=[_POST - (0, 0, 0.05)], colors=[STEEL],
                          fill_mode="solid")  # fmt: skip
        log("rig/post", post, static=True)

    def _frames(self, t_ns: Integers, s: Mapping[str, Reals], modes: Integers, ran: Reals) -> list[Columns]:
        import rerun as rr

        zoom, colours = self.scale.motion, coloured(modes)
        angles = zoom * s["angle"]
        tips = np.stack((0.55 * np.cos(angles), 0.55 * np.sin(angles), np.full_like(angles, 0.2)), axis=1)
        friction = along(1, s["friction_force"] / self.scale.force * 0.5)
        heads = np.stack((_ARM * np.cos(angles), _ARM * np.sin(angles), np.full_like(angles, 0.24)), axis=1)
        return [
            Columns("rig/disc", t_ns, rr.Transform3D.columns(quaternion=about(2, zoom * ran))),
            Columns("rig/pendulum", t_ns, rr.Transform3D.columns(quaternion=about(2, angles))),
            Columns("rig/pendulum/shoe", t_ns, rr.Boxes3D.columns(colors=colours)),
            Columns("rig/pendulum/friction", t_ns, rr.Arrows3D.columns(vectors=friction)),
            load(t_ns, heads, s["normal_force"] / self.scale.force * 0.25),
            spring(t_ns, zigzag(np.broadcast_to(_POST, tips.shape), tips, flat=True)),
            word(t_ns, (0.0, 0.0, 0.72), self._said(modes, s), colours),
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
            quaternions=[LYING, LYING], colors=[STEEL], fill_mode="solid",
        )  # fmt: skip
        log("rig/rollers", rollers, static=True)
        bands = rr.Boxes3D(
            half_sizes=[(_BELT, 0.42, 0.01)] * 2, centers=[(0, 0, -0.01), (0, 0, -0.31)], colors=[DISC],
            fill_mode="solid",
        )  # fmt: skip
        log("rig/belt", bands, static=True)
        places = np.arange(-_BELT, _BELT - _PITCH / 2, _PITCH)
        lines = [np.array([(x, -0.42, 0.006), (x, 0.42, 0.006)]) for x in places]
        log("rig/marks", rr.LineStrips3D(lines, colors=[MARK], radii=[0.006]), static=True)
        log("rig/mass/body", rr.Boxes3D(half_sizes=[(0.2, 0.2, 0.17)], centers=[(0, 0, 0.19)], fill_mode="solid"),
            static=True)  # fmt: skip
        log("rig/mass/friction", rr.Arrows3D.from_fields(origins=[(0, -0.27, 0.04)], colors=[FRICTION],
                                             radii=[0.018]), static=True)  # fmt: skip
        wall = rr.Boxes3D(half_sizes=[(0.03, 0.35, 0.3)], centers=[(-1.25, 0, 0.32)], colors=[STEEL],
                          fill_mode="solid")  # fmt: skip
        log("rig/wall", wall, static=True)

    def _frames(self, t_ns: Integers, s: Mapping[str, Reals], modes: Integers, ran: Reals) -> list[Columns]:
        import rerun as rr

        zoom, colours = self.scale.motion, coloured(modes)
        x = zoom * s["displacement"]
        zero = np.zeros_like(x)
        tips = np.stack((x - 0.2, zero, zero + 0.2), axis=1)
        heads = np.stack((x, zero, zero + 0.37), axis=1)
        return [
            Columns("rig/marks", t_ns, rr.Transform3D.columns(translation=along(0, np.mod(zoom * ran, _PITCH)))),
            Columns("rig/mass", t_ns, rr.Transform3D.columns(translation=along(0, x))),
            Columns("rig/mass/body", t_ns, rr.Boxes3D.columns(colors=colours)),
            Columns("rig/mass/friction", t_ns,
                    rr.Arrows3D.columns(vectors=along(0, s["friction_force"] / self.scale.force * 0.6))),
            load(t_ns, heads, s["normal_force"] / self.scale.force * 0.25),
            spring(t_ns, zigzag(np.broadcast_to((-1.22, 0.0, 0.2), tips.shape), tips, flat=False)),
            word(t_ns, (0.0, 0.0, 1.02), self._said(modes, s), colours),
        ]  # fmt: skip
