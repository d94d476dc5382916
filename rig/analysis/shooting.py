"""A cycle by Newton's method on the return map, for motions that come near to one but take long to settle.

    phi_T(x + d) = x + d,  f(x) . d = 0      (P - 1) d + f dT = -(phi_T(x) - x)

P: monodromy matrix, f: rate of the state where the return is taken, in the middle of the longest slip. Events bend the
return map; a step is taken only as far as the same events are met and the return comes closer (halving). What is found
is a state to go on from: that it repeats is then seen by simulation alone, and that it attracts, by its multipliers.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from rig.analysis.floquet import Return, middle, multipliers, returned
from rig.analysis.orbit import Orbit
from rig.errors import NumericsError

Array = NDArray[np.float64]
CLOSE = 1e-10  # of the size of each state: a step of Newton's method that is none any more
_ROUGH = 1e-6  # the same where rounding, or the tolerance of dopri5, keeps the return from coming closer
_STILL = 1e-2  # of the size of each state: motion in a period, of a rest that is no cycle
_STEPS = 12
_HALVINGS = 6
_GROWS = 1e-5  # a multiplier so far beyond one is that of an unstable cycle


@dataclass(frozen=True)
class Shot:
    """What Newton's method has found: a state on the cycle, its period [s], the size of its largest multiplier."""

    x: Array
    period: float
    multiplier: float
    steps: int

    @property
    def stable(self) -> bool:
        """Whether the cycle does not repel what is beside it."""
        return self.multiplier <= 1.0 + _GROWS


def shoot(orbit: Orbit, period: float) -> Shot | None:
    """The cycle near the motion of now, which returns after about `period` [s]; None where none is found.

    The orbit is carried on by one period, and is not changed else.
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
                return Shot(at.x, period, size, step) if left <= _ROUGH and moves else None
            x, period = better
            at = returned(orbit, x, period, span)
    except NumericsError:
        pass
    return None


def _newton(at: Return) -> tuple[Array, float]:
    """The step of the state [i] and of the period [s] that closes the return, if it were linear."""
    n = len(at.miss)
    A = np.zeros((n + 1, n + 1))
    A[:n, :n], A[:n, n], A[n, :n] = at.matrix - np.eye(n), at.flow, at.flow
    found = np.linalg.lstsq(A, np.append(-at.miss, 0.0), rcond=1e-13)[0]
    return found[:n], float(found[n])


def _along(orbit: Orbit, at: Return, by: Array, later: float, period: float) -> tuple[Array, float] | None:
    """State and period as far along a step as the return comes closer and meets the same events."""
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
    """How far a return is from closing, whatever the period: without its part along the motion."""
    along = at.flow / max(float(np.linalg.norm(at.flow)), 1e-300)
    return float(np.linalg.norm(miss - along * (along @ miss)))
