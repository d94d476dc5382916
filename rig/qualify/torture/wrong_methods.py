"""Methods for contact forces that fail without a warning.

held      the structure moves exactly over a step, under the contact forces at its begin (zero-order hold). A contact
          force that is one step late is a negative damper, w^2 h / 2 for its own frequency w: energy grows at
          every step.
clipped   T = mu(|w|) N clip(w / scale, -1, 1), classical Runge-Kutta. The slope is stiff: beyond a step of about
          2 m scale / (mu N) a contact that should stick is thrown across it, to and fro, and nothing blows
          up.
stale     a film whose rows follow the slider every 50 us, not at every step: each update is a jolt, and a quiet slide
          gets lines at 20 and 40 kHz.

These are not methods of the rig; the torture test shows their failure for comparison.

A method that fails: the classical Runge-Kutta method across the sign of the slip speed, without modes and events.

T = mu(|w|) N sgn(w), N = 0 where it would pull. It locks onto one side of the belt, with any step, and its result looks
like a solution. It is not a method of the rig; the torture test shows its failure for comparison.
"""

from __future__ import annotations

import time
from collections.abc import Callable
from functools import cache, partial

import numpy as np
import scipy.linalg
from numpy.typing import NDArray

from rig.errors import UsageError
from rig.model.formulation import ModeSet, assemble
from rig.model.system import System
from rig.motion.motion import Motion
from rig.qualify.torture.case import Case, Watched
from rig.qualify.torture.results import Found, OutOfTime
from rig.solve.records import CLOSED, OPEN, SLIP_MINUS, SLIP_PLUS, STICK

Array = NDArray[np.float64]
STALE_NS = 50_000
PATIENCE = 5.0
"""Time limit of these loops in units of a cell's: they are Python, and one that is cut short shows no fault."""
Step = Callable[[Array], Array]


class _Free:
    """A rig without its contacts, x' = A x + B f, and the contact forces f at x; friction rises over `scale` [m/s]."""

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

    def forces(self, x: Array) -> Array:
        """Return normal forces, then friction forces."""
        system, loads = self.system, np.zeros(len(self.system.patches))
        normal = np.array([k.row @ x for k in system.normals])
        normal = np.where([k.opens for k in system.normals], np.maximum(normal, 0.0), normal)
        for k, force in zip(system.normals, normal.tolist()):
            loads[k.patch] += force
        speeds = system.slip_rows @ x
        mu = [patch.law.mu(abs(w)) for patch, w in zip(system.patches, speeds.tolist())]
        return np.concatenate((normal, mu * loads * np.clip(speeds / self.scale, -1.0, 1.0)))


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


@np.errstate(over="ignore", invalid="ignore")  # the motion may diverge; the result states it
def _run(way: Callable[[_Free, float], Step], case: Case, scene: Watched, until_ns: int, seconds: float) -> Found:
    """Simulate the case by one of these methods. Raises UsageError if the method cannot treat the rig, OutOfTime."""
    if case.acts:
        raise UsageError("follows no commands")
    assembly = scene.assemble()
    system = assembly.system()
    begin, step, ticks = time.thread_time(), scene.step_ns * 1e-9, until_ns // scene.step_ns
    on = way(_Free(system, scene.clock.smoothing), step)
    states = np.zeros((ticks + 1, system.n))
    states[0] = system.start
    outcome = Found()
    for tick in range(ticks):
        states[tick + 1] = on(states[tick])
        if not np.all(np.isfinite(states[tick + 1])):
            outcome.not_finite, states = 1, states[: tick + 1]
            break
        if tick % 256 == 0 and time.thread_time() - begin > seconds:
            raise OutOfTime
    outcome.slips = [np.abs(states @ system.slip_rows.T).max(axis=1, initial=0.0)]
    for name in case.expect.largest:
        row = assembly.outputs[name].row
        outcome.largest[name] = float(np.abs(states @ [row.get(state, 0.0) for state in system.names]).max())
    outcome.ticks, outcome.seconds = ticks, time.thread_time() - begin
    outcome.carrying = outcome.seconds
    return outcome


def _stale(case: Case, scene: Watched, until_ns: int, seconds: float) -> Found:
    """Simulate the case with film rows that are constant for STALE_NS. Raises UsageError without a film, OutOfTime."""
    if case.acts:
        raise UsageError("follows no commands")
    assembly = scene.assemble()
    system = assembly.system()
    if system.film is None:
        raise UsageError("needs a film under a moving slider")
    rows = [assembly.outputs[name].row for name in case.expect.ends]
    motion = Motion(system, scene.step_ns, "kick", rows, substeps=scene.clock.substeps(scene.step_ns))
    motion.advance(1)
    own, travel = motion.mode_sets.tables.film, system.names.index(system.film.travel)
    given = [(side.rows, side.rows.copy()) for side in (own.symmetric, own.antisymmetric)]
    begin, ticks, pause = time.thread_time(), until_ns // scene.step_ns, max(STALE_NS // scene.step_ns, 1)
    while motion.tick < ticks:
        place = float(motion.x[travel]) / system.film.pitch
        low = min(int(place), len(system.film.rows) - 2)
        for held, moving in given:
            held[:] = moving[low] + (place - low) * (moving[low + 1] - moving[low])
        own.below[0] = -1
        motion.advance(min(pause, ticks - motion.tick))
        if time.thread_time() - begin > seconds:
            raise OutOfTime
    outcome = Found(ticks=motion.tick, seconds=time.thread_time() - begin)
    outcome.ended = dict(zip(case.expect.ends, motion.outputs_now().tolist()))
    outcome.carrying = outcome.seconds
    return outcome


WRONG: dict[str, Callable[[Case, Watched, int, float], Found]] = {
    "held": partial(_run, _held),
    "clipped": partial(_run, _clipped),
    "stale": _stale,
}


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
    x, outcome = system.start.copy(), Found()
    slips = np.zeros((until_ns // scene.step_ns, len(system.patches)))
    for tick in range(len(slips)):
        k1 = field.rate(x)
        k2 = field.rate(x + 0.5 * step * k1)
        k3 = field.rate(x + 0.5 * step * k2)
        k4 = field.rate(x + step * k3)
        x = x + step / 6.0 * (k1 + 2.0 * (k2 + k3) + k4)
        slips[tick] = system.slip_rows @ x
        if not np.all(np.isfinite(x)):
            outcome.not_finite = 1
            break
        if tick % 256 == 0 and time.thread_time() - begin > seconds:
            raise OutOfTime
    outcome.slips = [np.abs(slips).max(axis=1)] if slips.size else []
    outcome.ticks, outcome.seconds = len(slips), time.thread_time() - begin
    outcome.carrying = outcome.seconds
    return outcome


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
