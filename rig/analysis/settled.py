"""Test whether a motion has come to rest in steady sliding, with the kinetic energy as a norm.

    |d|^2 = v^T M v + w^2 q^T M q      of the distance d = (q, v) from sliding, w = |lambda| of its least stable mode

The mass matrix makes metres and radians comparable. The scale is the standing start of a cycle: every contact moves
with its surface, the structure is unloaded. So the scale contains the static deflection and the speed of the drive.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from rig.stability.linearisation import Steady

Array = NDArray[np.float64]
NEAR = 1e-7
"""Share of the scale. This close to stable sliding the rig is linear: a disturbance of this size decays."""


class Rest:
    """Steady sliding as the state in which a motion may end. `start`: the standing start [state]."""

    def __init__(self, sliding: Steady, start: Array) -> None:
        self._sliding, self._nq = sliding, len(sliding.system.coordinates)
        self._free = not sliding.load.any()
        """True if no contact is loaded: the structure vibrates freely and comes to rest where it would slide."""
        there = sliding.exists or self._free
        rates = sliding.eigenvalues() if there else np.zeros(0, dtype=np.complex128)
        self.least = complex(rates[0]) if len(rates) else complex(math.nan, math.nan)
        self._turn = abs(self.least)
        self._scale = self._distance(start)

    @property
    def stable(self) -> bool:
        """Whether every mode of sliding decays."""
        return self.least.real < 0.0

    def share(self, x: Array) -> float:
        """Return the distance of state `x` from sliding, over the scale."""
        return self._distance(x) / self._scale if self._scale > 0.0 else math.inf

    def reached(self, x: Array) -> bool:
        """Return whether a motion at `x` without stick can only decay."""
        return self.stable and self.share(x) <= NEAR

    def text(self, more: str = "") -> str:
        """Return why there is no limit cycle, or none is found; `more`: a further observation."""
        hertz = abs(self.least.imag) / (2.0 * math.pi)
        at = f" at {hertz:.6g} Hz" if hertz else ""
        decays = f"least stable mode decays with {-self.least.real:.6g} 1/s{at}"
        if self._free:
            return f"no limit cycle: no contact is loaded, and the {decays}{more}"
        return (
            f"no limit cycle found from a standing start: sliding is stable, its {decays}{more}. Another start may "
            "reach one: rig map, over a range that begins or ends where the rig vibrates"
        )

    def _distance(self, x: Array) -> float:
        d, nq, mass = x - self._sliding.x, self._nq, self._sliding.system.mass
        q, v = d[:nq], d[nq : 2 * nq]
        return math.sqrt(max(float(v @ mass @ v + self._turn**2 * (q @ mass @ q)), 0.0))
