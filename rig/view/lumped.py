"""The moving pictures of north and disc_slider: variants of those of the belt and the pendulum.

The moving picture of the belt rig: a mass on a running belt, a spring to a wall.

The moving picture of the pendulum rig: an arm above a rotating disc, its shoe on the disc, a spring to a post.

The moving picture of the rig four_dof, from the side: body 2 on the belt, body 1 beside it, body 3 above it.

Springs connect the bodies to each other and to the frame; the inclined spring connects body 2 to a post. Motion across
the belt is magnified less than motion along it, as in `rig.view.lumped`.

The moving picture of the tip of a clamped beam: the beam hangs from its clamp, its tip rubs on the disc.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, Self

import numpy as np

from rig.model.assembly import Assembly
from rig.model.system import System
from rig.picture import OnBelt, OnDisc
from rig.scenes.scene import Scene
from rig.view import base

_PITCH = 0.25
_BELT = 1.5
GAP = 0.17
ACROSS = 0.25  # magnification of motion across the belt, as a fraction of that along it


class Belt(base.Picture):
    """The mass on the belt, from the side; x is the direction of the belt."""

    eye = (0.2, -2.5, 1.3)
    target = (0.0, 0.0, 0.12)

    def __init__(self, scale: base.Scale, drawn: OnBelt | None = None) -> None:
        self._drawn = drawn or OnBelt()
        self.surface = self._drawn.surface
        self.forces = self._drawn.friction, self._drawn.normal
        super().__init__(scale)

    def static(self, log: base.Log) -> None:
        """See `Picture.static`."""
        log(
            "rig/rollers",
            base.Shape(
                "Cylinders3D",
                lengths=[0.9, 0.9],
                radii=[0.15, 0.15],
                centers=[(-_BELT, 0, -0.16), (_BELT, 0, -0.16)],
                quaternions=[base.LYING, base.LYING],
                colors=[base.STEEL],
            ),
        )
        log(
            "rig/belt",
            base.Shape(
                "Boxes3D",
                half_sizes=[(_BELT, 0.42, 0.01)] * 2,
                centers=[(0, 0, -0.01), (0, 0, -0.31)],
                colors=[base.DISC],
            ),
        )
        places = np.arange(-_BELT, _BELT - _PITCH / 2, _PITCH)
        lines = [np.array([(x, -0.42, 0.006), (x, 0.42, 0.006)]) for x in places]
        log("rig/marks", base.Shape("LineStrips3D", strips=lines, colors=[base.MARK], radii=[0.006]))
        half, centre, lean = (0.2, 0.2, 0.17), (0.0, 0.0, 0.19), self._drawn.lean
        if lean:
            half, centre = (0.06, 0.06, 0.4), (-0.26, 0.0, 0.32)
        turn: dict[str, Any] = {"quaternions": [(0.0, -np.sin(lean), 0.0, np.cos(lean))]} if lean else {}
        log("rig/mass/body", base.Shape("Boxes3D", half_sizes=[half], centers=[centre], **turn))
        log(
            "rig/mass/friction",
            base.Shape("Arrows3D", origins=[(0, -0.27, 0.04)], colors=[self.friction], radii=[0.018]),
        )
        log("rig/wall", base.Shape.box((0.03, 0.35, 0.3), (-1.25, 0, 0.32)))

    def _placed(self, s: Mapping[str, base.Reals]) -> dict[str, Any]:
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

    def _frames(
        self, t_ns: base.Integers, s: Mapping[str, base.Reals], modes: base.Integers, ran: base.Reals
    ) -> list[base.Columns]:
        zoom, colours = self.scale.motion, base.coloured(modes)
        x = zoom * s[self._drawn.along] if self._drawn.along else np.zeros(len(t_ns))
        zero = np.zeros_like(x)
        tips = np.stack((x - 0.2, zero, zero + 0.2), axis=1)
        heads = np.stack((x, zero, zero + 0.37), axis=1)
        texts = self._contact_text(modes, s[self._drawn.friction], s[self._drawn.normal])
        return [
            base.Columns(
                "rig/marks", t_ns, base.Shape("Transform3D", translation=base.along(0, np.mod(zoom * ran, _PITCH)))
            ),
            base.Columns("rig/mass", t_ns, base.Shape("Transform3D", **self._placed(s))),
            base.Columns("rig/mass/body", t_ns, base.Shape("Boxes3D", colors=colours)),
            base.Columns(
                "rig/mass/friction",
                t_ns,
                base.Shape("Arrows3D", vectors=base.along(0, s[self._drawn.friction] / self.scale.force * 0.6)),
            ),
            base.load(t_ns, heads, s[self._drawn.normal] / self.scale.force * 0.25, self.normal),
            base.spring(t_ns, base.zigzag(np.broadcast_to((-1.22, 0.0, 0.2), tips.shape), tips, flat=False)),
            base.word(t_ns, (0.0, 0.0, 1.02), texts, colours),
        ]


_ARM = 0.8
_PENDULUM_POST = np.array((0.55, -0.75, 0.2))


def disc(log: base.Log) -> None:
    """Send a disc of radius one that turns about the z axis, with marks."""
    turns = np.linspace(0.0, 2.0 * np.pi, 24, endpoint=False)
    rays = np.stack((np.cos(turns), np.sin(turns), np.full(24, 0.02) / 0.99), axis=1)
    spokes = [np.stack((ray * (0.93, 0.93, 1.0), ray * (0.99, 0.99, 1.0))) for ray in rays]
    spokes += [np.stack((ray * (0.3, 0.3, 1.0), ray * (0.99, 0.99, 1.0))) for ray in rays[::8]]
    log(
        "rig/disc", base.Shape("Cylinders3D", lengths=[0.08], radii=[1.0], centers=[(0, 0, -0.025)], colors=[base.DISC])
    )
    log("rig/disc/marks", base.Shape("LineStrips3D", strips=spokes, colors=[base.MARK], radii=[0.006]))


class Pendulum(base.Picture):
    """The pendulum of the papers, seen obliquely from above.

    Arm and disc turn about z, and the radius of the disc is one length.
    """

    eye = (1.5, 0.9, 1.2)
    target = (0.12, -0.02, 0.08)

    def __init__(self, scale: base.Scale, drawn: OnDisc | None = None) -> None:
        self._drawn = drawn or OnDisc()
        self.surface = self._drawn.surface
        self.forces = self._drawn.friction, self._drawn.normal
        super().__init__(scale)

    def static(self, log: base.Log) -> None:
        """See `Picture.static`."""
        disc(log)
        log(
            "rig/pendulum/shaft",
            base.Shape("Cylinders3D", lengths=[0.5], radii=[0.07], centers=[(0, 0, 0.25)], colors=[base.STEEL]),
        )
        log("rig/pendulum/arm", base.Shape.box((_ARM / 2, 0.035, 0.03), (_ARM / 2, 0, 0.2)))
        log("rig/pendulum/shoe", base.Shape("Boxes3D", half_sizes=[(0.07, 0.06, 0.075)], centers=[(_ARM, 0, 0.1)]))
        log(
            "rig/pendulum/friction",
            base.Shape("Arrows3D", origins=[(_ARM + 0.1, 0, 0.06)], colors=[self.friction], radii=[0.016]),
        )
        log("rig/post", base.Shape.box((0.04, 0.04, 0.15), _PENDULUM_POST - (0, 0, 0.05)))

    def _frames(
        self, t_ns: base.Integers, s: Mapping[str, base.Reals], modes: base.Integers, ran: base.Reals
    ) -> list[base.Columns]:
        zoom, colours = self.scale.motion, base.coloured(modes)
        angles = zoom * s[self._drawn.angle]
        tips = np.stack((0.55 * np.cos(angles), 0.55 * np.sin(angles), np.full_like(angles, 0.2)), axis=1)
        friction = base.along(1, s[self._drawn.friction] / self.scale.force * 0.5)
        heads = np.stack((_ARM * np.cos(angles), _ARM * np.sin(angles), np.full_like(angles, 0.24)), axis=1)
        return [
            base.Columns("rig/disc", t_ns, base.Shape("Transform3D", quaternion=base.about(2, zoom * ran))),
            base.Columns("rig/pendulum", t_ns, base.Shape("Transform3D", quaternion=base.about(2, angles))),
            base.Columns("rig/pendulum/shoe", t_ns, base.Shape("Boxes3D", colors=colours)),
            base.Columns("rig/pendulum/friction", t_ns, base.Shape("Arrows3D", vectors=friction)),
            base.load(t_ns, heads, s[self._drawn.normal] / self.scale.force * 0.25, self.normal),
            base.spring(t_ns, base.zigzag(np.broadcast_to(_PENDULUM_POST, tips.shape), tips, flat=True)),
            base.word(
                t_ns,
                (0.0, 0.0, 0.72),
                self._contact_text(modes, s[self._drawn.friction], s[self._drawn.normal]),
                colours,
            ),
        ]


_PLACE = 0.83  # radius of the slider
_STAND = np.array((_PLACE, -0.9, 0.3))


class Tilting(Belt):
    """The body of the rig north, which moves towards the surface and rotates about its centre."""

    def _placed(self, s: Mapping[str, base.Reals]) -> dict[str, Any]:
        down, half = self.scale.motion * s["displacement"], 0.5 * self.scale.motion * s["tilt"]
        zero = np.zeros_like(down)
        return {
            "translation": np.stack((zero, zero, GAP - down), axis=1),
            "quaternion": np.stack((zero, np.sin(half), zero, np.cos(half)), axis=1),
        }


class Slider(Pendulum):
    """A slider on a rotating flexible disc; it moves along the disc and up and down.

    The rotation of the disc is not magnified: at the magnification of the motion it would be a blur.
    """

    def static(self, log: base.Log) -> None:
        """See `Picture.static`."""
        disc(log)
        log("rig/pendulum/shoe", base.Shape("Boxes3D", half_sizes=[(0.09, 0.08, 0.1)], centers=[(_PLACE, 0, 0.13)]))
        log(
            "rig/pendulum/friction",
            base.Shape("Arrows3D", origins=[(_PLACE + 0.13, 0, 0.06)], colors=[self.friction], radii=[0.016]),
        )
        log("rig/post", base.Shape.box((0.04, 0.04, 0.2), _STAND - (0, 0, 0.05)))

    def _frames(
        self, t_ns: base.Integers, s: Mapping[str, base.Reals], modes: base.Integers, ran: base.Reals
    ) -> list[base.Columns]:
        zoom = self.scale.motion
        angles, up = zoom * s["displacement"] / _PLACE, zoom * ACROSS * s["height"] + GAP
        place = np.stack((_PLACE * np.cos(angles), _PLACE * np.sin(angles), up), axis=1)
        drawn = {columns.path: columns for columns in super()._frames(t_ns, {**s, "angle": angles}, modes, ran)}
        turn = base.Shape("Transform3D", quaternion=base.about(2, angles), translation=base.along(2, up))
        side = place + np.array((0.0, -0.08, 0.13))
        drawn["rig/disc"] = base.Columns("rig/disc", t_ns, base.Shape("Transform3D", quaternion=base.about(2, ran)))
        drawn["rig/pendulum"] = base.Columns("rig/pendulum", t_ns, turn)
        drawn["rig/load"] = base.load(
            t_ns, place + np.array((0.0, 0.0, 0.23)), s["normal_force"] / self.scale.force * 0.25, self.normal
        )
        drawn["rig/spring"] = base.spring(t_ns, base.zigzag(np.broadcast_to(_STAND, side.shape), side, flat=True))
        return list(drawn.values())


_SIDE = np.array((-0.72, 0.0, GAP + 0.19))  # rest position of the centre of body 1
_TOP = np.array((0.0, 0.0, GAP + 0.8))  # rest position of the centre of body 3
_HALF = 0.12
_WALL = np.array((-1.22, 0.0, _SIDE[2]))
_CEILING = np.array((0.0, 0.0, 1.5))
_BODIES_POST = np.array((-0.62, 0.3, 0.9))


class ThreeBodies(Belt):
    """Three bodies and five springs; the arrow of the load on body 2 is beside body 3."""

    eye = (0.1, -3.1, 1.5)
    target = (-0.1, 0.0, 0.5)

    def __init__(self, scale: base.Scale) -> None:
        """Use half of the usual magnification, because bodies 1 and 2 move towards each other."""
        super().__init__(scale._replace(motion=base.round_down(0.5 * scale.motion)), OnBelt(up="height", lifted=True))

    def static(self, log: base.Log) -> None:
        """See `Picture.static`."""
        super().static(log)
        for name, half, place in (
            ("body_1", (_HALF, _HALF, _HALF), _SIDE),
            ("body_3", (_HALF, _HALF, _HALF), _TOP),
            ("ceiling", (0.35, 0.35, 0.03), _CEILING),
            ("post", (0.03, 0.03, 0.45), _BODIES_POST - (0.0, 0.0, 0.45)),
        ):
            log(f"rig/{name}", base.Shape.box(half, place))

    def _frames(
        self, t_ns: base.Integers, s: Mapping[str, base.Reals], modes: base.Integers, ran: base.Reals
    ) -> list[base.Columns]:
        drawn = {columns.path: columns for columns in super()._frames(t_ns, s, modes, ran)}
        slider = self._placed(s)["translation"] + (0.0, 0.0, 0.19)
        side = base.along(0, self.scale.motion * s["body_1_displacement"])
        top = base.along(2, self.scale.motion * ACROSS * s["body_3_height"])
        count = len(t_ns)

        def still(place: base.Reals) -> base.Reals:
            return np.broadcast_to(place, (count, 3))

        along_x, upright = np.array((1.0, 0.0, 0.0)), np.array((0.0, 0.0, 1.0))
        ends = (
            (still(_WALL), _SIDE + side - _HALF * along_x, False),
            (_SIDE + side + _HALF * along_x, slider - 0.2 * along_x, False),
            (slider + np.array((-0.15, 0.2, 0.1)), still(_BODIES_POST), False),
            (slider + 0.17 * upright, _TOP + top - _HALF * upright, False),
            (_TOP + top + _HALF * upright, still(_CEILING), False),
        )
        springs = [base.zigzag(begin, end, flat) for begin, end, flat in ends]
        drawn["rig/spring"] = base.spring(t_ns, *springs)
        for name, moved in (("body_1", side), ("body_3", top)):
            drawn[f"rig/{name}"] = base.Columns(f"rig/{name}", t_ns, base.Shape("Transform3D", translation=moved))
        drawn["rig/load"] = base.load(
            t_ns, slider + np.array((0.15, 0.0, 0.18)), s["normal_force"] / self.scale.force * 0.25, self.normal
        )
        texts = self._contact_text(modes, s["friction_force"], s["normal_force"])
        drawn["rig/word"] = base.word(t_ns, (0.55, 0.0, 1.2), texts, base.coloured(modes))
        return list(drawn.values())


_REACH = 0.5  # largest displacement of the tip in the picture [lengths]
_CLAMP, _TIP = np.array((-0.12, 0.0, 0.9)), np.array((0.0, 0.0, 0.1))


def scale(system: System) -> base.Scale:
    """The scale for a rig: static friction, with the normal force that it leaves, deflects it by `_REACH` at most."""
    patch, normal, count = system.patches[0], system.normals[0], len(system.coordinates)
    load = float(normal.row @ system.start)
    mu = patch.law.at_rest(load)
    force = mu * load
    push = normal.direction + mu * patch.direction
    bent = np.linalg.solve(system.stiffness - np.outer(push, normal.row[:count]), patch.direction * force)
    reach = abs(float(patch.direction @ bent))
    return base.Scale(base.round_down(_REACH / reach) if reach else 1.0, force or 1.0)


class Tip(Belt):
    """The beam and its tip from the side; the disc moves to the right.

    The beam has the static shape for a force at its tip; higher vibration modes are not drawn.
    """

    eye = (0.1, -2.9, 1.3)
    target = (-0.05, 0.0, 0.42)

    @classmethod
    def of(cls, scene: Scene, assembly: Assembly, system: System) -> Self:
        """See `Picture.of`."""
        return cls(scale(system))

    def static(self, log: base.Log) -> None:
        """See `Picture.static`."""
        super().static(log)
        log("rig/mass/body", base.Shape("Boxes3D", half_sizes=[(0.07, 0.16, 0.05)], centers=[(0, 0, 0.06)]))
        log("rig/wall", base.Shape.box((0.2, 0.3, 0.09), (-0.12, 0.0, 0.99)))

    def _frames(
        self, t_ns: base.Integers, s: Mapping[str, base.Reals], modes: base.Integers, ran: base.Reals
    ) -> list[base.Columns]:
        drawn = {columns.path: columns for columns in super()._frames(t_ns, s, modes, ran)}
        x = self.scale.motion * s["displacement"]
        share = np.linspace(0.0, 1.0, 16)[:, None]
        bent = 0.5 * share[:, 0] ** 2 * (3.0 - share[:, 0])  # shape of a clamped beam under a force at its end
        strips = np.tile(_CLAMP + share * (_TIP - _CLAMP), (len(x), 1, 1))
        strips[:, :, 0] += x[:, None] * bent
        drawn["rig/spring"] = base.spring(t_ns, strips, radius=0.03)
        heads = np.stack((x + 0.2, np.zeros_like(x), np.full_like(x, 0.02)), axis=1)
        drawn["rig/load"] = base.load(t_ns, heads, s["normal_force"] / self.scale.force * 0.25, self.normal)
        return list(drawn.values())
