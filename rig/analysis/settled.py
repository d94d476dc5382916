"""When a motion has come to rest in steady sliding: measured by the physical amplitudes of the rig, not by numbers.

    |d|^2 = v^T M v + w^2 q^T M q      of the distance d = (q, v) from sliding, w = |lambda| of its least stable motion

Metres and radians weigh as they do in the kinetic energy. The scale is the standing start of a cycle: every contact
moves with its surface, the structure is unloaded. So it holds the static deflection and the speed of the drive.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from rig.stability.linearisation import Steady

Array = NDArray[np.float64]
NEAR = 1e-7
"""Of the scale. So near to stable sliding all is linear: a disturbance of this size dies away."""


class Rest:
    """Steady sliding as the place where a motion may end. `start`: the standing start [state]."""

    def __init__(self, sliding: Steady, start: Array) -> None:
        self._sliding, self._nq = sliding, len(sliding.system.coordinates)
        self._free = not sliding.load.any()
        """Nothing presses: the structure swings by itself, and comes to rest where it would slide."""
        there = sliding.exists or self._free
        rates = sliding.eigenvalues() if there else np.zeros(0, dtype=np.complex128)
        self.least = complex(rates[0]) if len(rates) else complex(math.nan, math.nan)
        self._turn = abs(self.least)
        self._scale = self._distance(start)

    @property
    def stable(self) -> bool:
        """Whether every motion about sliding decays."""
        return self.least.real < 0.0

    def share(self, x: Array) -> float:
        """The distance of state `x` from sliding, over the scale."""
        return self._distance(x) / self._scale if self._scale > 0.0 else math.inf

    def reached(self, x: Array) -> bool:
        """Whether a motion at `x`, in which nothing sticks, can only die away."""
        return self.stable and self.share(x) <= NEAR

    def text(self) -> str:
        """Why there is no limit cycle."""
        hertz = abs(self.least.imag) / (2.0 * math.pi)
        at = f" at {hertz:.6g} Hz" if hertz else ""
        what = "nothing presses a contact, and the" if self._free else "sliding is stable, its"
        return f"no limit cycle: {what} least stable motion decays with {-self.least.real:.6g} 1/s{at}"

    def _distance(self, x: Array) -> float:
        d, nq, mass = x - self._sliding.x, self._nq, self._sliding.system.mass
        q, v = d[:nq], d[nq : 2 * nq]
        return math.sqrt(max(float(v @ mass @ v + self._turn**2 * (q @ mass @ q)), 0.0))
