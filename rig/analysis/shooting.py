"""Newton's method on the return map: finds a cycle for motions that approach it slowly.

    phi_T(x + d) = x + d,  f(x) . d = 0      (P - 1) d + f dT = -(phi_T(x) - x)

P: monodromy matrix, f: rate of the state at the section, in the middle of the longest slip. Events make the return map
nonlinear: a step is halved until the same events occur and the return comes closer. The result is a state to continue
from. Simulation alone then shows that it repeats, and its multipliers show that it attracts.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from rig.analysis.floquet import Return, middle, multipliers, returned
from rig.analysis.orbit import Orbit
from rig.errors import NumericsError

Array = NDArray[np.float64]
CLOSE = 1e-10  # of the size of each state: a step of Newton's method that counts as zero
_ROUGH = 1e-6  # the same if rounding, or the tolerance of dopri5, limits how close the return comes
_STILL = 1e-2  # of the size of each state: smallest motion in a period of a cycle; below it is a state of rest
_STEPS = 12
_HALVINGS = 6
_GROWS = 1e-5  # a multiplier larger than one by this belongs to an unstable cycle


@dataclass(frozen=True)
class ShootingResult:
    """The result of Newton's method: a state on the cycle, its period [s], the size of its largest multiplier."""

    x: Array
    period: float
    multiplier: float
    steps: int

    @property
    def stable(self) -> bool:
        """Whether the cycle does not repel nearby motions."""
        return self.multiplier <= 1.0 + _GROWS


def shoot(orbit: Orbit, period: float) -> ShootingResult | None:
    """Find the cycle near the present motion, which returns after about `period` [s]; None if there is none.

    The orbit advances by one period and is otherwise unchanged.
    """
    try:
        around = orbit.round(period)
        x, span = around.states[middle(orbit, around)], np.ptp(around.states, axis=0)
        at = returned(orbit, x, period, span)
        for step in range(1, _STEPS + 1):
            if at is None or np.any(np.delete(span, at.moving) > 0.0):  # driven: the period is not free
                return None
            by, later = _newton(at)
            left = float(np.linalg.norm(by))
            better = _along(orbit, at, by, later, period) if left > CLOSE else None
            if better is None:
                size = max((abs(v) for v in multipliers(at.matrix, driven=False).multipliers), default=0.0)
                moves = float(np.linalg.norm(at.flow)) * period > _STILL
                return ShootingResult(at.x, period, size, step) if left <= _ROUGH and moves else None
            x, period = better
            at = returned(orbit, x, period, span)
    except NumericsError:
        pass
    return None


def _newton(at: Return) -> tuple[Array, float]:
    """The step of the state [i] and of the period [s] that closes the linearised return map."""
    n = len(at.miss)
    A = np.zeros((n + 1, n + 1))
    A[:n, :n], A[:n, n], A[n, :n] = at.matrix - np.eye(n), at.flow, at.flow
    found = np.linalg.lstsq(A, np.append(-at.miss, 0.0), rcond=1e-13)[0]
    return found[:n], float(found[n])


def _along(orbit: Orbit, at: Return, by: Array, later: float, period: float) -> tuple[Array, float] | None:
    """State and period after the longest step with which the return comes closer and meets the same events."""
    before = _open(at, at.miss)
    for halving in range(_HALVINGS):
        share = 0.5**halving
        x, longer = at.shifted(share * by), period + share * later
        if longer <= 0.5 * period:
            continue
        end, met = orbit.carried(x, longer)
        after = _open(at, at.apart(end, x))
        if met == at.met and after < before:
            return x, longer
    return None


def _open(at: Return, miss: Array) -> float:
    """Distance of a return from closing at any period: without its part along the motion."""
    along = at.flow / max(float(np.linalg.norm(at.flow)), 1e-300)
    return float(np.linalg.norm(miss - along * (along @ miss)))
