"""The exponential function, inlined into its callers.

A call of the library takes as long as the rest of a dopri5 stage. e^u = e^(k/16) e^r with an integer k and |r| <= 1/32.
The first factor comes from a table, the second from its series, both accurate to rounding; r is exact.
"""

from __future__ import annotations

import numpy as np

from rig.kernel import inlined
from rig.solve.lanes import between, pick

_LEAST, _MOST = -48, 16  # outside of this range the library function is called
_TABLE = np.exp(np.arange(16 * _LEAST, 16 * _MOST + 1) / 16.0)
_SHIFT = 1.5 * 2.0**52  # at this size a double has no fraction bits: adding it rounds to an integer


@inlined
def _step_and_rest(u):
    """The number k of the step below or above u, and e^r. `u`: a number or lanes."""
    k = (16.0 * u + _SHIFT) - _SHIFT
    r = u - 0.0625 * k
    s = r * r
    low = (1.0 + r) + s * (1.0 / 2.0 + r * (1.0 / 6.0))
    high = (1.0 / 24.0 + r * (1.0 / 120.0)) + s * (1.0 / 720.0 + r * (1.0 / 5040.0))
    return k, low + (s * s) * high


@inlined
def exponential_factors(u):
    """Two numbers whose product is e^u to two units in the last place. The first is available before the second."""
    if _LEAST < u < _MOST:
        k, fine = _step_and_rest(u)
        coarse = _TABLE[np.uint32(k - 16.0 * _LEAST)]
    else:
        coarse, fine = np.exp(u), 1.0
    return coarse, fine


@inlined
def has_lane_factors(u):
    """Whether `exponential_factors_of_lanes` serves all lanes of u."""
    return between(1.0 * _LEAST, u, 1.0 * _MOST)


@inlined
def exponential_factors_of_lanes(u):
    """The same two factors in each lane."""
    k, fine = _step_and_rest(u)
    return pick(_TABLE, k - 16.0 * _LEAST), fine
