"""Critical speeds: of the last and the first stick of a run, and the highest speed at which a tip sticks again.

A run with three stages (accelerate, hold, decelerate) shows the speeds of the last and the first stick. Without noise a
sliding rig stays on its equilibrium and leaves it late: `down` is below the speed at which sliding becomes unstable,
more so for a faster ramp. `rig modes` computes the latter speed from eigenvalues. Sticks shorter than a sample step
count too, because the events of the run show them.
Source: Liu and Ouyang, Mechanical Systems and Signal Processing (2022), the tests with three stages.

The upper critical speed of a tip whose friction drops at once: slip begins at the static limit with the speed V of the
disc. It is a damped oscillation about the sliding equilibrium. If its next velocity maximum reaches V, the tip sticks
again; otherwise it never does. Both have closed forms, and the critical speed is the largest V at which the maximum is
V. For light damping it approaches

    w_s D / sqrt(exp(4 pi zeta) - 1)       D: distance from the begin of slip to the sliding equilibrium

The disc has a constant speed here. On a ramp the last stick is up to one period of vibration away.
Source: derived; of the form of Thomsen and Fidlin, Int. J. Non-Linear Mech. 38 (2003) 389, for little damping.
"""

from __future__ import annotations

import math
from itertools import pairwise
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import brentq

from rig.errors import UsageError
from rig.model.system import System
from rig.plants.tip import Parameters
from rig.record.run import Run
from rig.record.run_list import drives
from rig.scenes.scene import Scene

_HALF = 0.5  # of the largest speed: a run that accelerates and decelerates begins and ends below it
_SCAN = 1.05  # ratio of neighbouring trial speeds
_LEAST = 1e-4  # smallest trial speed over the largest


class Stages(NamedTuple):
    """Speed of the drive [unit] at the last stick while it rises and at the first one while it falls; nan without
    stick.
    """

    up: float
    down: float
    unit: str

    def text(self) -> str:
        """Return the report as text."""
        up, down = (f"{v:.5g} {self.unit}" if v == v else "none" for v in (self.up, self.down))
        return f"last stick while the drive accelerates: {up}; first stick while it decelerates: {down}"


def stages(run: Run) -> Stages | None:
    """Return the stages of a run over the speed of its drive; None if it does not accelerate and decelerate again.

    The run must have been recorded with its contact states.
    """
    speed = next(iter(drives(run)), "")
    sticks = stuck(run) if speed else None
    if sticks is None:
        return None
    # A cut recording may hold less of one output than of another, or of the contact states.
    known = np.isfinite(run.signals[speed]) & (run.mode >= 0)
    v = run.signals[speed][known]
    sticks = sticks[known]
    time = run.time[known]
    if not v.size:
        return None
    top = np.flatnonzero(v >= v.max() * (1.0 - 1e-9))
    if max(v[0], v[-1]) > _HALF * v.max():
        return None
    moving = v > 0.0
    first, last = top[0], top[-1]
    held = sticks & moving
    begins, ends = short(run)
    up = np.concatenate([time[:first][held[:first]], ends[ends < time[first]]])
    down = np.concatenate([time[last:][held[last:]], begins[begins > time[last]]])
    last_stick = float(np.interp(up.max(), time, v)) if len(up) else math.nan
    first_stick = float(np.interp(down.min(), time, v)) if len(down) else math.nan
    return Stages(last_stick, first_stick, run.units[speed])


def short(run: Run) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return the begins and ends [s] of those sticks that lie between two contact events."""
    system = Scene.from_json(run.scene_text()).assemble().system()
    met = [event for event in run.events if event.get("kind") == "contact" and "before" in event.get("data", {})]
    known: dict[str, bool] = {}
    began = []
    ended = []
    for last, event in pairwise(met):
        before = str(event["data"]["before"])
        if before not in known:
            known[before] = _sticks_by_text(system, before)
        if known[before]:
            began.append(last["t_ns"] * 1e-9)
            ended.append(event["t_ns"] * 1e-9)
    return np.array(began), np.array(ended)


def stuck(run: Run) -> NDArray[np.bool_] | None:
    """Return whether a loaded contact sticks, at each of `run.time`; None for a run recorded without contact states.

    False where a damaged recording has lost the state.
    """
    if len(run.mode) != len(run.time):
        return None
    keys, where = np.unique(run.mode, return_inverse=True)
    system = Scene.from_json(run.scene_text()).assemble().system()
    stick = np.array([key >= 0 and bool(system.stuck(int(key))) for key in keys], np.bool_)
    return np.asarray(stick[where.ravel()])


def _sticks_by_text(system: System, words: str) -> bool:
    """The same of a mode set in words, as events name it (System.describe); False where the words leave
    contacts out.
    """
    states = words.split(", ")
    loaded = {k.patch for k in system.normals if f"{k.name} open" not in states}
    whole = not any(word.endswith(" contacts open") for word in states)
    return whole and any(f"{patch.name} stick" in states and p in loaded for p, patch in enumerate(system.patches))


def upper_speed(p: Parameters) -> float:
    """Return the upper critical speed [m/s] of a tip on an even surface; 0 if it never sticks again.

    Raises UsageError for a friction law that depends on the speed.
    """
    law = p.friction.friction()
    if not law.constant:
        raise UsageError(f"friction.law = {p.friction.law!r}: the closed form needs coulomb or constant")
    static = law.static
    kinetic = law.numbers[0]
    tip = p.at_fixed_height
    force = p.load.force
    material = tip.retardation * tip.stiffness
    stiffness = (1.0 + kinetic * tip.relief) * tip.stiffness
    damping = tip.damping + (1.0 + kinetic * tip.relief) * material
    rate = math.sqrt(stiffness / tip.mass)
    decay = 0.5 * damping / tip.mass
    if decay >= rate or static <= kinetic:  # overdamped, or no drop of friction
        return 0.0
    swing = math.sqrt(rate**2 - decay**2)
    rest = kinetic * force / stiffness

    def missing(speed: float) -> float:
        """The next velocity maximum of a slip that begins on a disc of this speed, minus that speed."""
        held = static * force - (tip.damping + (1.0 + static * tip.relief) * material) * speed
        y = held / ((1.0 + static * tip.relief) * tip.stiffness) - rest
        # y' = exp(-decay t) (speed cos(swing t) - b sin(swing t))
        b = (rate**2 * y + decay * speed) / swing
        turn = math.atan2(b * swing + decay * speed, b * decay - speed * swing) % math.pi
        peaks = (turn + i * math.pi for i in range(3))
        values = (math.exp(-decay * a / swing) * (speed * math.cos(a) - b * math.sin(a)) for a in peaks)
        return float(max(values) - speed)

    fast = rate * force * static / tip.stiffness
    while fast > 0.0 and missing(_SCAN * fast) > 0.0:
        fast *= 2.0
    slow = fast
    while slow > _LEAST * fast:
        if missing(slow) > 0.0:
            return float(brentq(missing, slow, slow * _SCAN, rtol=1e-12))
        slow /= _SCAN
    return 0.0
