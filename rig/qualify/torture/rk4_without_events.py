"""A method that fails: the classical Runge-Kutta method across the sign of the slip speed, without modes and events.

T = mu(|w|) N sgn(w), N = 0 where it would pull. It locks onto one side of the belt, with any step, and its result looks
like a solution. It is not a method of the rig; the torture test shows its failure for comparison.
"""

from __future__ import annotations

import time
from functools import cache

import numpy as np
from numpy.typing import NDArray

from rig.errors import UsageError
from rig.model.formulation import ModeSet, assemble
from rig.model.system import System
from rig.qualify.torture.case import Case
from rig.qualify.torture.case_scene import Watched
from rig.qualify.torture.outcome import Found, OutOfTime
from rig.solve.state_codes import CLOSED, OPEN, SLIP_MINUS, SLIP_PLUS

Array = NDArray[np.float64]


@np.errstate(over="ignore", invalid="ignore")  # it may diverge, which is reported
def run(case: Case, scene: Watched, until_ns: int, seconds: float) -> Found:
    """Simulate the case by Runge-Kutta across the sign. Raises UsageError if the method cannot treat the rig,
    OutOfTime.
    """
    system = scene.assemble().system()
    if case.acts:
        raise UsageError("follows no commands")
    if system.products or system.sectors or system.switches or system.limiters or system.film:
        raise UsageError("supports friction and contact only")
    if any(np.any(k.inertia) for k in system.normals):
        raise UsageError("needs normal forces that do not depend on acceleration")
    begin, step = time.thread_time(), scene.step_ns * 1e-9
    field = _Field(system)
    x, found = system.start.copy(), Found()
    slips = np.zeros((until_ns // scene.step_ns, len(system.patches)))
    for tick in range(len(slips)):
        k1 = field.rate(x)
        k2 = field.rate(x + 0.5 * step * k1)
        k3 = field.rate(x + 0.5 * step * k2)
        k4 = field.rate(x + step * k3)
        x = x + step / 6.0 * (k1 + 2.0 * (k2 + k3) + k4)
        slips[tick] = system.slip_rows @ x
        if not np.all(np.isfinite(x)):
            found.not_finite = 1
            break
        if tick % 256 == 0 and time.thread_time() - begin > seconds:
            raise OutOfTime
    found.slips = [np.abs(slips).max(axis=1)] if slips.size else []
    found.ticks, found.seconds = len(slips), time.thread_time() - begin
    found.carrying = found.seconds
    return found


class _Field:
    """x' from the signs of slip speeds and normal forces at x."""

    def __init__(self, system: System) -> None:
        self._system = system
        self._rows = np.array([k.row for k in system.normals]).reshape(-1, system.n)
        self._modes = cache(self._assembled)

    def _assembled(self, patches: tuple[int, ...], normals: tuple[int, ...]) -> tuple[ModeSet, Array]:
        modes = assemble(self._system, self._system.key(patches, normals, []))
        load = np.zeros((len(patches), self._system.n))
        for k, contact in enumerate(self._system.normals):
            if normals[k] == CLOSED:
                load[contact.patch] += modes.normal[k]
        return modes, load

    def rate(self, x: Array) -> Array:
        """Return the derivative at x."""
        w = self._system.slip_rows @ x
        patches = tuple(SLIP_PLUS if speed >= 0.0 else SLIP_MINUS for speed in w.tolist())
        force = zip(self._system.normals, (self._rows @ x).tolist())
        normals = tuple(OPEN if k.opens and value <= 0.0 else CLOSED for k, value in force)
        modes, load = self._modes(patches, normals)
        rate: Array = modes.A @ x
        for p in np.flatnonzero(modes.nonlinear).tolist():
            sigma = float(modes.sigma[p])
            rate = rate + modes.b[:, p] * (sigma * self._system.patches[p].law.mu(abs(float(w[p]))) * (load[p] @ x))
        return rate
