"""What all moving pictures have in common: their scale, the surface that runs on, the text beside the rig."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import TYPE_CHECKING, NamedTuple, Self

import numpy as np

from rig.model.system import System
from rig.view import contact
from rig.view.shapes import Columns, Integers, Reals

if TYPE_CHECKING:
    import rerun as rr

    from rig.model.assembly import Assembly
    from rig.scenes.scene import Scene

_REACH = 0.35
"""What the largest expected motion measures in the picture, rad or lengths."""


class Scale(NamedTuple):
    """How large things are drawn: motion magnified `motion` times, a force of `force` [N] half a length long."""

    motion: float
    force: float


def scale_of(system: System) -> Scale:
    """From the rig: where static friction under the load of the start can pull it, half again."""
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
    """To 1, 2 or 5 times a power of ten."""
    base = 10.0 ** math.floor(math.log10(value))
    return base * max(step for step in (1.0, 2.0, 5.0) if step * base <= value * (1.0 + 1e-9))


class Picture:
    """Common to all: the surface that runs on, colours, arrows."""

    surface = "surface_speed"
    """Output that is the speed of the surface."""
    eye: tuple[float, float, float]
    target: tuple[float, float, float]

    def __init__(self, scale: Scale) -> None:
        self.scale = scale
        self._ran, self._last_ns, self._speed = 0.0, -1, 0.0

    @classmethod
    def of(cls, scene: Scene, assembly: Assembly, system: System) -> Self | None:
        """The picture of a rig; None where this drawer does not know it. `assembly`, `system`: those of the scene."""
        return cls(scale_of(system))

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

    def _said(self, modes: Integers, friction: Reals, normal: Reals) -> list[str]:
        return [
            f"{contact.NAMES[mode]}   T = {force:+.1f} N   N = {load:.1f} N   motion x {self.scale.motion:g}"
            for mode, force, load in zip(modes, friction, normal)
        ]
