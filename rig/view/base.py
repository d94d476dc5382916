"""The common base of all moving pictures: their scale, the moving surface, the text beside the rig."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import TYPE_CHECKING, NamedTuple, Self

import numpy as np

from rig.model.system import System
from rig.view import contact
from rig.view.palette import LINES
from rig.view.shapes import Columns, Integers, Log, Reals

if TYPE_CHECKING:
    from rig.model.assembly import Assembly
    from rig.scenes.scene import Scene

_REACH = 0.35
"""Size of the largest expected motion in the picture [rad or lengths]."""


class Scale(NamedTuple):
    """Scale of a picture: motion is magnified `motion` times, and `force` [N] sets the length of the force arrows."""

    motion: float
    force: float


def scale_of(system: System) -> Scale:
    """The scale for a rig: 1.5 times its deflection by static friction has about the size `_REACH`."""
    if not system.patches or not system.normals:
        return Scale(10.0, 10.0)
    patch = system.patches[0]
    load = float(abs(system.normals[0].row @ system.start)) or 1.0
    force = patch.law.static * load
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
    eye: tuple[float, float, float]
    target: tuple[float, float, float]

    def __init__(self, scale: Scale) -> None:
        self.scale = scale
        self.paint({})
        self._ran, self._last_ns, self._speed = 0.0, -1, 0.0

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
        picked = {name: v[shown] for name, v in signals.items()}
        return self._frames(t_ns[shown], picked, modes[shown], ran)

    def _frames(self, t_ns: Integers, s: Mapping[str, Reals], modes: Integers, ran: Reals) -> list[Columns]:
        raise NotImplementedError

    def _run(self, t_ns: Integers, speed: Reals) -> Reals:
        """Travel of the surface at each row, by the trapezoidal rule over all states so far."""
        begin_ns, begin = (self._last_ns, self._speed) if self._last_ns >= 0 else (int(t_ns[0]), float(speed[0]))
        seconds = np.diff(t_ns, prepend=begin_ns) * 1e-9
        middle = 0.5 * (speed + np.concatenate(([begin], speed[:-1])))
        ran = self._ran + np.cumsum(np.nan_to_num(seconds * middle))
        self._ran, self._last_ns, self._speed = float(ran[-1]), int(t_ns[-1]), float(speed[-1])
        return ran

    def _contact_text(self, modes: Integers, friction: Reals, normal: Reals) -> list[str]:
        return [
            f"{contact.NAMES[mode]}   T = {force:+.1f} N   N = {load:.1f} N   motion x {self.scale.motion:g}"
            for mode, force, load in zip(modes, friction, normal)
        ]
