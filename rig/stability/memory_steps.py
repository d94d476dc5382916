"""How fast the internal states of friction laws change in slip, which limits the steps of explicit methods.

Bristles relax at a rate that grows with the slip speed, sigma0 w / g(w) for LuGre, so that the state at the start says
little: there a contact that moves with its belt does not slip. The eigenvalues are therefore those at slip speeds up to
the fastest that is expected, with the internal states of steady slip and of the moment after its reversal. States that
a contact passes in between may be faster, but it leaves them within a step or two (measured: `elasto_plastic`).

A contact that does not stick creeps instead, at a speed that nobody knows before the run, and friction that is steep in
slow slip is stiff there: a N / (m w) for rate and state friction. Where steady slip is not stable such a contact comes
to creep, and the eigenvalues at rest count too.

The fastest slip is estimated, not bounded. A surface of speed V that carries a body releases it at V, so that the
undamped structure swings back at V or, if this is faster, at the speed of its motion from the start. Static friction
that is released moves the structure like a step of force:

    w = |V| + hypot(max(|V|, sum_i |a_i| (eta_i'^2 + omega_i^2 (eta_i - f_i / omega_i^2)^2)^0.5),
                    mu N sum_i a_i^2 / omega_i)

with a_i = t . phi_i, eta_i and f_i the shares of vibration mode i in the sliding direction t, the state and the forces
at the start, and mu the largest coefficient of steady slip. Where falling friction feeds a vibration beyond this, slip
is faster: the energy residual of the run tells it.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from rig.errors import Singular
from rig.model.formulation import ModeSet
from rig.model.singular import assembled
from rig.model.system import System
from rig.solve.records import STICK
from rig.stability.linearisation import linearised, own_law, sliding_key, steady

Array = NDArray[np.float64]
_SLOW = np.geomspace(1e-6, 1.0, 7)  # shares of a slip speed at which the largest coefficient is looked for
_NEUTRAL = 1e-10  # share of the largest eigenvalue: growth up to this is rounding
_SPEEDS = np.geomspace(0.1, 1.0, 8)  # shares of the fastest slip. # chosen: rates grow with the speed, or not at all


class FastestMemory(NamedTuple):
    """The largest |lambda| [1/s] of laws with memory, and the slip speed [m/s] at which it is found."""

    rate: float
    speed: float


def start_loads(system: System) -> Array:
    """The normal force of each patch at the start [patch], at least 0 N."""
    loads = np.zeros(len(system.patches))
    for normal in system.normals:
        loads[normal.patch] += max(float(normal.row @ system.start), 0.0)
    return loads


def fastest_slips(system: System) -> Array:
    """The fastest slip speed that is expected of each patch [m/s]."""
    from scipy.linalg import eigh

    nq = len(system.coordinates)
    x = system.start
    loads = start_loads(system)
    squares, shapes = eigh(0.5 * (system.stiffness + system.stiffness.T), system.mass)
    omega = np.sqrt(np.maximum(squares, 0.0))
    swings = omega > 0.0
    pressed = sum((n.direction * float(n.row @ x) for n in system.normals), np.zeros(nq))
    eta = shapes.T @ (system.mass @ x[:nq])
    rate = shapes.T @ (system.mass @ x[nq : 2 * nq])
    pushed = shapes.T @ (system.force @ x + pressed)
    away = np.zeros(nq)
    away[swings] = omega[swings] * eta[swings] - pushed[swings] / omega[swings]
    fastest = np.zeros(len(system.patches))
    for p, row in enumerate(system.slip_rows):
        along = row[nq : 2 * nq] @ shapes
        velocities = np.s_[nq : 2 * nq]
        surface = abs(float(np.delete(row, velocities) @ np.delete(x, velocities)))
        swing = max(surface, float(np.abs(along) @ np.hypot(rate, away)))
        most = max(law.over(swing * _SLOW, loads[p]).max() for law in system.laws(p))
        release = most * loads[p] * float((along[swings] ** 2 / omega[swings]).sum())
        fastest[p] = surface + float(np.hypot(swing, release))
    return fastest


def fastest_memory(system: System, keys: Iterator[int]) -> FastestMemory:
    """The fastest eigenvalue that laws with memory have at the start, in slip and in creep, in the mode sets `keys`."""
    best = FastestMemory(0.0, 0.0)
    remembering = [p for p, patch in enumerate(system.patches) if patch.memory]
    if not remembering:
        return best
    slips = fastest_slips(system)
    creeps = _comes_to_creep(system, remembering)
    for key in keys:
        modes = assembled(system, key)
        for speed, x in _states(system, modes, slips, remembering, creeps):
            A = linearised(system, modes, x, own_law(system, modes))[0]
            rate = float(np.abs(np.linalg.eigvals(A)).max())
            best = max(best, FastestMemory(rate, speed))
    return best


def _states(
    system: System, modes: ModeSet, slips: Array, remembering: list[int], creeps: bool
) -> Iterator[tuple[float, Array]]:
    """The largest slip speed of a contact with memory and the state: at the start, and in slip of a mode set.

    Nothing for a mode set in which a run never is: a contact that does not stick is stuck, or slips backwards.
    """
    nq = len(system.coordinates)
    kinds = system.modes(modes.key)[0]
    if any(kinds[p] == STICK and system.patches[p].law.presliding for p in remembering):
        return
    slipping = [p for p in remembering if modes.sigma[p]]
    begins = modes.sigma[slipping] * (system.slip_rows[slipping] @ system.start)
    if np.all(begins >= 0.0):
        yield float(begins.max(initial=0.0)), system.start
    velocities = system.slip_rows[slipping, nq : 2 * nq]

    def at_slip(speeds: Array) -> Array:
        x = system.start.copy()
        lacking = modes.sigma[slipping] * speeds - system.slip_rows[slipping] @ x
        x[nq : 2 * nq] += np.linalg.pinv(velocities) @ lacking
        return x

    if creeps:
        yield 0.0, at_slip(np.zeros(len(slipping)))
    for share in _SPEEDS.tolist() if slipping else []:
        x = at_slip(share * slips[slipping])
        loads = modes.load @ x
        for direction in (1.0, -1.0):
            for p in slipping:
                law = system.law(p, modes.key)
                sigma = float(modes.sigma[p])
                assert law.formula is not None
                steady = law.formula.steady(law.numbers, share * float(slips[p]), float(loads[p]))
                along = np.array([state.along for state in law.states])
                x[list(system.patches[p].memory)] = np.where(along, direction * sigma * steady, steady)
            yield share * float(slips[slipping].max()), x


def _comes_to_creep(system: System, remembering: list[int]) -> bool:
    """Whether a contact does not stick, and steady sliding does not exist or is not stable."""
    if not any(system.patches[p].law.presliding for p in remembering):
        return False
    try:
        at = steady(system, sliding_key(system))
    except Singular:
        return True
    rates = at.eigenvalues()
    return not at.exists or bool(rates.real.max(initial=0.0) > _NEUTRAL * np.abs(rates).max(initial=0.0))
