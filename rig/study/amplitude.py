"""The amplitude index: how large a steady vibration is, from what an instrument has measured.

    A = (1 / n) sum_i (peak_i - valley_i) / 2        over n cycles

Source: Liu and Ouyang, Mechanical Systems and Signal Processing (2022), equation 31. Whether the half is in it is not
certain there: `full` goes without.
"""

from __future__ import annotations

from itertools import pairwise
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
_BAND = 0.25
"""Share of half the range by which a signal must pass its middle, up and down: noise makes no cycles of its own."""


class Index(NamedTuple):
    """`half` and `full`: mean of half of peak to valley, and of the whole, in the unit of the signal; of `cycles`.

    `frequency` [Hz]: of these cycles. Without two passages of the middle there is no cycle: 0, and nan.
    """

    half: float
    full: float
    cycles: int
    frequency: float


def index(t: Array, x: Array) -> Index:
    """The index of signal x at times t [s], over the whole cycles in it. Leave out what has not settled."""
    middle, band = 0.5 * (x.max() + x.min()), _BAND * 0.5 * np.ptp(x)
    side = np.where(x > middle + band, 1, np.where(x < middle - band, -1, 0))
    told = np.flatnonzero(side)
    rises = told[1:][(side[told[1:]] > 0) & (side[told[:-1]] < 0)]
    if len(rises) < 2 or band == 0.0:
        return Index(0.0, 0.0, 0, float("nan"))
    full = np.mean([np.ptp(x[a : b + 1]) for a, b in pairwise(rises)])
    cycles = len(rises) - 1
    return Index(float(0.5 * full), float(full), cycles, float(cycles / (t[rises[-1]] - t[rises[0]])))
