"""The worst rig of a design: three levels of each uncertain value, then ascents from the five best.

Corners alone miss it: the worst rig can lie inside of the box. Of more than five values, two levels of all are tried,
and three levels of the five with the largest influence.
"""

from __future__ import annotations

import itertools
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from rig.analysis.robust.growth import Growth, NoSliding
from rig.analysis.robust.tasks import Region, Tasks

Array = NDArray[np.float64]
_ALL = 5  # most values of which all have three levels
_STARTS = 5
_APART = 0.15  # of the box, by which starts differ in a value


class Worst(NamedTuple):
    """The worst rig `u` [uncertain] of a design, with its `growth` [1/s] and frequency `hertz`.

    `rigs` [k, uncertain]: where the ascents ended, the worst first, with `growths` [k] and frequencies `tones` [k].
    """

    u: Array
    growth: float
    hertz: float
    rigs: Array
    growths: Array
    tones: Array


def whole(count: int) -> Region:
    """Return the region of the stated box of `count` values."""
    return Region(np.zeros(count), np.ones(count))


def levels(growth: Growth, x: Array, region: Region) -> Array:
    """Return the rigs [k, uncertain] from which a search for the worst one begins."""
    low, high = region
    m = len(low)
    middle = 0.5 * (low + high)
    if m <= _ALL:
        each = [sorted({low[i], middle[i], high[i]}) for i in range(m)]
        return np.array([*itertools.product(*each)]).reshape(-1, m)
    corners = np.array([*itertools.product(*zip(low, high))])
    first = np.argsort(-_influence(growth, x, middle) * (high - low), kind="stable")[:_ALL]
    grid = np.array([*itertools.product(*([low[i], middle[i], high[i]] for i in first))])
    inner = np.tile(middle, (len(grid), 1))
    inner[:, first] = grid
    return np.vstack([corners, inner])


def _influence(growth: Growth, x: Array, u: Array) -> Array:
    """The sizes of the gradients of the growth over each uncertain value."""
    try:
        pieces = growth.pieces(x, u, of_rig=True, kept=1)
    except NoSliding:
        return np.ones(len(u))
    return np.asarray(np.max([np.abs(piece.slope) for piece in pieces], axis=0))


def worst(tasks: Tasks, x: Array, region: Region | None = None, seeds: Array | None = None) -> Worst:
    """Return the worst rig of design x [free] in a region; `seeds` [k, uncertain]: rigs that are tried as well."""
    m = len(tasks.growth.box.uncertain)
    region = whole(m) if region is None else region
    tried = [np.clip(tasks.growth.box.centre, *region)[None], levels(tasks.growth, x, region)]
    if seeds is not None:
        tried.append(np.clip(seeds, *region))
    rigs = np.unique(np.vstack(tried), axis=0)
    found = tasks.growths(x, rigs)
    return ascended(tasks, x, region, rigs, found.growth)


def ascended(tasks: Tasks, x: Array, region: Region, rigs: Array, growths: Array) -> Worst:
    """Return the worst rig that ascents from the best of `rigs` [k, uncertain] with `growths` reach."""
    width = np.maximum(region.high - region.low, 1e-300)
    starts: list[int] = []
    for i in np.argsort(-growths, kind="stable").tolist():
        if len(starts) == _STARTS:
            break
        if all(np.abs((rigs[i] - rigs[j]) / width).max() > _APART for j in starts):
            starts.append(i)
    found = tasks.ascents(x, rigs[starts], region)
    order = np.argsort(-found.growth, kind="stable")
    u, growth, hertz = found.u[order], found.growth[order], found.hertz[order]
    return Worst(u[0], float(growth[0]), float(hertz[0]), u, growth, hertz)
