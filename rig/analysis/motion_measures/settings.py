"""Settings of the integration: a method with its step or tolerance, and the series of settings that `rig cost`
measures.

exact    no setting: its step is the sample step of the scene
dopri5   tolerance                rk4   step
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from rig.model import kick_tables
from rig.model.method import METHODS, as_integrated, chosen
from rig.model.singular import assembled
from rig.model.system import System
from rig.motion.memory import SEGMENTS
from rig.scenes.scene import Scene
from rig.stability.examined_mode_sets import mode_sets
from rig.stability.step_limits import RK4_LIMIT

TIGHTEST = 1e-12  # tolerance
THEORY = {"dopri5": 5, "rk4": 4, "kick": 2}  # order of the error in the step
_FINE = 2e-3  # |lambda| h of the finest rk4 step of a series
_RUNG = 2.0  # smallest ratio of two steps of a series


@dataclass(frozen=True, order=True)
class Setting:
    """A method with its setting: `tolerance` of dopri5, `step_ns` [ns] of rk4 and kick; 0 if the method has none."""

    method: str
    tolerance: float = 0.0
    step_ns: int = 0

    def applied(self, scene: Scene) -> Scene:
        """Return the scene with this setting."""
        changes: dict[str, Any] = {"method": self.method}
        changes |= {"tolerance": self.tolerance} if self.tolerance else {}
        changes |= {"rk4_step": self.step_ns} if self.step_ns else {}
        return replace(scene, clock=scene.clock.model_copy(update=changes))

    @property
    def adapts(self) -> bool:
        """Whether the error determines its steps, except for the last one of each frame, which is cut."""
        return self.method == "dopri5"

    def __str__(self) -> str:
        if self.tolerance:
            return f"{self.method} at {self.tolerance:.0e}"
        return f"{self.method} at {self.step_ns * 1e-3:.4g} us" if self.step_ns else self.method


def of(scene: Scene, system: System) -> Setting:
    """Return the setting of a scene."""
    method = chosen(scene.clock.method, system)
    return _with_dial(method, scene.clock.tolerance, int(scene.clock.rk4_step))


def _with_dial(method: str, tolerance: float, step_ns: int) -> Setting:
    return Setting(
        method, *{"dopri5": (tolerance, 0), "rk4": (0.0, step_ns), "kick": (0.0, step_ns)}.get(method, (0.0, 0))
    )


def eligible(system: System) -> dict[str, str]:
    """Return for every method of the rig why it cannot be used for this system, "" if it can."""
    found = {}
    for method in METHODS:
        if method == "smooth":
            found[method] = "never sticks: for comparison only, rig torture shows its errors"
        elif method == "kick":
            found[method] = kick_tables.refusal(system)
        else:
            found[method] = _refused(system, method)
    if system.linear and not found.get("exact", "exact"):
        found["dopri5"] = "every mode set is linear: dopri5 would use the exact propagator"
    return found


def _refused(system: System, method: str) -> str:
    try:
        as_integrated(system, method, 0.0)
    except ValueError as error:
        return str(error)
    return ""


def fastest(system: System) -> float:
    """Return the largest eigenvalue [1/s] of the mode sets that the stability report examines."""
    return max(float(np.abs(np.linalg.eigvals(assembled(system, key).A)).max()) for key in mode_sets(system))


def ladder(method: str, scene: Scene, rate: float) -> list[Setting]:
    """Return the settings of a method to be measured, coarse to fine. `rate` [1/s]: of the fastest mode."""
    if method == "dopri5":
        return [Setting(method, 10.0**-p) for p in range(2, 12)]
    if method in ("rk4", "kick"):
        shortest = scene.frame_ns / (SEGMENTS // 2)  # finer ones would exceed the room of a frame
        return [Setting(method, step_ns=h) for h in _steps(scene.step_ns, rate, _FINE) if h >= shortest]
    return [Setting(method)]


def _steps(step_ns: int, rate: float, finest: float) -> Iterator[int]:
    """Divisors of the sample step [ns], coarse to fine, each at most half of the one before, with which rk4 is
    stable.
    """
    last = math.inf
    for count in range(1, step_ns + 1):
        h, rest = divmod(step_ns, count)
        turn = rate * h * 1e-9
        if rest or turn > RK4_LIMIT or h * _RUNG > last:
            continue
        yield h
        if turn < finest or h == 1:
            return
        last = h
