"""The three-stage protocol, accelerate, hold, decelerate: up to which speed a rig sticks, and from which again.

Without noise a rig that slides sits on its equilibrium and leaves it late: `down` is below the speed at which sliding
loses its stability, the more so the faster the ramp. That speed is an eigenvalue's: `rig modes`.
Source: Liu and Ouyang, Mechanical Systems and Signal Processing (2022), the tests with three stages.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from rig.record.run import Run
from rig.scenes.scene import Scene
from rig.solve.system import CLOSED, STICK, System


class Stages(NamedTuple):
    """Speed of the drive at the last stick on the way up and at the first one on the way down; nan without any."""

    up: float
    down: float


def stages(run: Run, speed: str = "disc_speed") -> Stages:
    """The stages of a run over its output `speed`, in that output's unit."""
    system = Scene.from_json(run.scene).assemble().system()
    sticks = {int(key): _sticks(system, int(key)) for key in np.unique(run.mode)}
    stuck = np.array([sticks[int(key)] for key in run.mode])
    v = run.signals[speed]
    top = np.flatnonzero(v >= v.max() * (1.0 - 1e-9))
    moving = v > 0.0
    up = np.flatnonzero((stuck & moving)[: top[0]])
    down = np.flatnonzero((stuck & moving)[top[-1] :])
    return Stages(
        float(v[up[-1]]) if len(up) else math.nan,
        float(v[top[-1] + down[0]]) if len(down) else math.nan,
    )


def _sticks(system: System, key: int) -> bool:
    patches, normals, *_ = system.modes(key)
    loaded = {k.patch for k, mode in zip(system.normals, normals) if mode == CLOSED}
    return any(mode == STICK and p in loaded for p, mode in enumerate(patches))
