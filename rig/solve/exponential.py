"""The exponential function, written into who waits for it.

A call of the library's takes as long as all the rest of a stage of dopri5. e^u = e^(k/16) e^r with k an integer and
|r| <= 1/32: the first from a table, the second by its series, both to rounding; r is exact.
"""

from __future__ import annotations

import numpy as np

from rig.kernel import inlined

_LEAST, _MOST = -48, 16  # beyond, the library is asked
_TABLE = np.exp(np.arange(16 * _LEAST, 16 * _MOST + 1) / 16.0)
_SHIFT = 1.5 * 2.0**52  # a number so large has no digits behind the point: adding it rounds


@inlined
def factors(u):
    """Two numbers whose product is e^u to two units in the last place; the first is there before the second."""
    if _LEAST < u < _MOST:
        k = (16.0 * u + _SHIFT) - _SHIFT
        r = u - 0.0625 * k
        s = r * r
        low = (1.0 + r) + s * (1.0 / 2.0 + r * (1.0 / 6.0))
        high = (1.0 / 24.0 + r * (1.0 / 120.0)) + s * (1.0 / 720.0 + r * (1.0 / 5040.0))
        coarse, fine = _TABLE[np.uint32(k - 16.0 * _LEAST)], low + (s * s) * high
    else:
        coarse, fine = np.exp(u), 1.0
    return coarse, fine
