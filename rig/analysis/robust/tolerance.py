"""The largest tolerance that a design can hold: bisection over the width of the box, a robust design at each width.

The width is a factor of all ranges about their nominal values, or of one range with the others as stated. A design
holds a width if its worst rig grows by no more than the `target`, which is 0 or minus a decay.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from rig.analysis.robust.design import Designed, robust
from rig.analysis.robust.tasks import Region, Tasks

Array = NDArray[np.float64]
MOST = 64.0
"""Largest factor that is tried."""
_EXACT = 0.01  # of the factor, at which the bisection ends
_LEAST = 1e-3  # factor below which nothing can be held
_BACK = 0.98  # factor after an audit that has found a worse rig


class Tolerated(NamedTuple):
    """The largest `factor` that a design holds, and the design; `above`: the least factor that none was found for."""

    factor: float
    above: float
    design: Designed
    region: Region


def region_of(tasks: Tasks, number: int | None, factor: float) -> Region:
    """Return the box with all ranges (None), or with that of one uncertain value, `factor` times as wide."""
    centre = tasks.growth.box.centre
    factors = np.ones(len(centre))
    factors[slice(None) if number is None else number] = factor
    return Region(centre * (1.0 - factors), centre + factors * (1.0 - centre))


def tolerance(tasks: Tasks, seed: int, number: int | None, target: float, also: list[Array]) -> Tolerated | None:
    """Return the largest factor of all ranges (`number` None), or of one, at which no rig grows by more than `target`
    [1/s]; None if not even a box without width can be held.
    """

    def held(factor: float, audited: bool = False) -> Designed | None:
        region = region_of(tasks, number, factor)
        found = robust(tasks, seed, also, region, audited, target)
        if not found.worst.growth <= target:
            return None
        also.insert(0, found.x)
        return found

    low, high, best = _bracket(held)
    if best is None:
        return None
    while high - low > _EXACT * low and high > low:
        middle = 0.5 * (low + high)
        found = held(middle)
        if found is None:
            high = middle
        else:
            low, best = middle, found
    while low > _LEAST:
        found = held(low, audited=True)
        if found is not None:
            return Tolerated(low, high, found, region_of(tasks, number, low))
        high = low
        low *= _BACK
    return None


def _bracket(held: Callable[[float], Designed | None]) -> tuple[float, float, Designed | None]:
    """A factor that is held with its design, and one that is not."""
    low, high = 0.0, 1.0
    best = None
    found = held(high)
    while found is not None and high <= MOST:
        low, best = high, found
        high *= 2.0
        found = held(high)
    while best is None and high > _LEAST:
        low = 0.5 * high
        best = held(low)
        high = high if best is not None else low
    return low, high, best
