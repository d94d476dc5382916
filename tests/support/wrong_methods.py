"""Methods that fail without a warning: what the torture test has to catch.

held      the structure moves exactly over a step, under the contact forces at its begin (zero-order hold). A contact
          force that is one step late is a negative damper, w^2 h / 2 for its own frequency w: energy grows at
          every step.
sign      T = mu(|w|) N sgn(w), classical Runge-Kutta across the sign, without modes and events. It locks onto one side
          of the belt, with any step, and its result looks like a solution.
"""

from __future__ import annotations

import time
from collections.abc import Callable
from functools import partial

import numpy as np
import scipy.linalg
from numpy.typing import NDArray

from rig.errors import UsageError
from rig.model.formulation import assemble
from rig.model.system import System
from rig.qualify.torture.case import Case, Watched
from rig.qualify.torture.results import OutOfTime, RunOutcome
from rig.solve.records import OPEN, STICK

Array = NDArray[np.float64]
Step = Callable[[Array], Array]


class _Free:
    """A rig without its contacts, x' = A x + B f, and the contact forces f at x; friction rises over `scale` [m/s], or
    jumps.
    """

    def __init__(self, system: System, scale: float) -> None:
        if system.products or system.sectors or system.switches or system.limiters:
            raise UsageError("supports friction and contact only")
        if any(np.any(k.inertia) for k in system.normals):
            raise UsageError("needs normal forces that do not depend on acceleration")
        self.system, self.scale = system, scale
        free = system.key([STICK] * len(system.patches), [OPEN] * len(system.normals), [])
        self.A = assemble(system, free).A
        pushes = [*(k.direction for k in system.normals), *(patch.direction for patch in system.patches)]
        nq = len(system.coordinates)
        self.B = np.zeros((system.n, len(pushes)))
        self.B[nq : 2 * nq] = np.linalg.solve(system.mass, np.array(pushes).T)
        self._rows = np.array([k.row for k in system.normals]).reshape(-1, system.n)
        self._least = np.array([0.0 if k.opens else -np.inf for k in system.normals])
        self._of = np.array([[k.patch == p for k in system.normals] for p in range(len(system.patches))], dtype=float)

    def forces(self, x: Array) -> Array:
        """Return normal forces, then friction forces."""
        normal = np.maximum(self._rows @ x, self._least)
        speeds = self.system.slip_rows @ x
        mu = [patch.law.mu(abs(w)) for patch, w in zip(self.system.patches, speeds.tolist())]
        share = np.clip(speeds / self.scale, -1.0, 1.0) if self.scale else np.where(speeds >= 0.0, 1.0, -1.0)
        return np.concatenate((normal, mu * (self._of @ normal) * share))


def _held(free: _Free, step: float) -> Step:
    """One step with the forces at its begin."""
    n, m = free.B.shape
    both = np.zeros((n + m, n + m))
    both[:n, :n], both[:n, n:] = free.A, free.B
    carried = scipy.linalg.expm(step * both)[:n]
    return lambda x: np.asarray(carried @ np.concatenate((x, free.forces(x))))


def _clipped(free: _Free, step: float) -> Step:
    """One step of the classical Runge-Kutta method."""

    def rate(x: Array) -> Array:
        return np.asarray(free.A @ x + free.B @ free.forces(x))

    def on(x: Array) -> Array:
        k1 = rate(x)
        k2 = rate(x + 0.5 * step * k1)
        k3 = rate(x + 0.5 * step * k2)
        return np.asarray(x + step / 6.0 * (k1 + 2.0 * (k2 + k3) + rate(x + step * k3)))

    return on


def _sign(free: _Free, step: float) -> Step:
    """The same with friction that jumps."""
    if free.system.film:
        raise UsageError("supports friction and contact only")
    free.scale = 0.0
    return _clipped(free, step)


@np.errstate(over="ignore", invalid="ignore")  # the motion may diverge; the result states it
def _run(way: Callable[[_Free, float], Step], case: Case, scene: Watched, until_ns: int, seconds: float) -> RunOutcome:
    """Simulate the case by one of these methods. Raises UsageError if the method cannot treat the rig, OutOfTime."""
    if case.acts:
        raise UsageError("follows no commands")
    assembly = scene.assemble()
    system = assembly.system()
    begin, step, ticks = time.thread_time(), scene.step_ns * 1e-9, until_ns // scene.step_ns
    on = way(_Free(system, scene.clock.smoothing), step)
    states = np.zeros((ticks + 1, system.n))
    states[0] = system.start
    outcome = RunOutcome()
    for tick in range(ticks):
        states[tick + 1] = on(states[tick])
        if not np.all(np.isfinite(states[tick + 1])):
            outcome.not_finite, states = 1, states[: tick + 1]
            break
        if tick % 256 == 0 and time.thread_time() - begin > seconds:
            raise OutOfTime(seconds)
    outcome.slips = [np.abs(states @ system.slip_rows.T).max(axis=1, initial=0.0)]
    for name in case.expect.largest:
        row = assembly.outputs[name].row
        outcome.largest[name] = float(np.abs(states @ [row.get(state, 0.0) for state in system.names]).max())
    outcome.ticks, outcome.seconds = ticks, time.thread_time() - begin
    outcome.carrying = outcome.seconds
    return outcome


WRONG: dict[str, Callable[[Case, Watched, int, float], RunOutcome]] = {
    "held": partial(_run, _held),
    "sign": partial(_run, _sign),
}
