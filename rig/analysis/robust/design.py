"""The robust design: designs polished over a growing set of worst rigs, until no worse rig is found.

    designs from Latin hypercube points, the best of them polished against the set of rigs (rig.analysis.robust.descent)
    worst rig of the best one (rig.analysis.robust.tasks); if it is worse than stated, it joins the set
    audit: random rigs of the box; if one is worse than stated, its ascent joins the set

The nominal optimum is the same with the nominal rig alone. A tolerance is the largest width of the box that a design
holds: whose worst rig grows by no more than a target, which is 0 or minus a decay.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from rig.analysis.robust.descent import beyond
from rig.analysis.robust.tasks import Found, Region, Tasks, ascended, worst

Array = NDArray[np.float64]
FIRST = 64
"""Designs that are tried first."""
AUDIT = 10_000
"""Random rigs of the audit."""
_NOMINAL = 5  # starts of the nominal optimum that are polished,
_ROBUST = 4  # and of the robust design
_ROUNDS = 16  # worst rigs that join the set, at most
_SAME = 0.01  # of the growth: a worst rig that is worse by less is no news
_AUDITS = 3
_SURE = 1e-9
_MOST = 128.0  # largest factor of a tolerance that is tried
_EXACT = 0.01  # of the factor, at which the bisection ends
_LEAST = 1e-3  # factor below which nothing can be held
_BACK = 0.98  # factor after an audit that has found a worse rig


class Designed(NamedTuple):
    """A design x [free] with its `worst` rigs, the value that the set of `rigs` gives it, the audit, and whether no
    worse rig was found in the last round. `rounds`: (rigs in the set, value of the set, growth of the worst rig).
    """

    x: Array
    worst: Found
    stated: float
    audit: Found | None
    settled: bool
    rigs: Array
    rounds: tuple[tuple[int, float, float], ...] = ()

    @property
    def growth(self) -> float:
        """The growth [1/s] of its worst rig."""
        return float(self.worst.growth[0])


def nominal_optimum(tasks: Tasks, seed: int) -> Array:
    """Return the design [free] with the smallest growth of the nominal rig."""
    rig = tasks.growth.box.centre[None]
    X = _starts(tasks, rig, _NOMINAL, seed)
    return np.asarray(tasks.polished(X, rig)[0][0])


def robust(
    tasks: Tasks,
    seed: int,
    also: Sequence[Array],
    region: Region,
    audit: bool = True,
    target: float = -math.inf,
) -> Designed:
    """Return the design whose worst rig in a region grows least.

    `also`: designs [free] that are tried as well; `audit`: whether random rigs are. `target` [1/s]: a design whose
    worst rig grows by no more is good enough, and the search ends where the set of rigs allows none.
    """
    U = np.clip(tasks.growth.box.centre, *region)[None]
    X = np.vstack([_starts(tasks, np.unique(np.vstack([U, *region]), axis=0), _ROBUST, seed), *also])
    made: list[Designed] = []
    audits = 0
    for _ in range(_ROUNDS):
        X, values = tasks.polished(X, U)
        x, stated = X[0], float(values[0])
        bad = worst(tasks, x, region, U)
        settled = not _worse(bad, stated) or bad.growth[0] <= target
        found = None
        if settled and audit and audits < _AUDITS:
            found = audited(tasks, x, region, seed + audits)
            audits += 1
            if _worse(found, max(float(bad.growth[0]), stated, target)):
                bad = ascended(tasks, x, region, found)
                settled = False
        made.append(Designed(x, bad, stated, found, settled, U))
        if settled or stated > target > -math.inf or not math.isfinite(stated):
            break
        U = np.vstack([U, bad.u[0]])
        X = X[: max(1, len(X) - 1)]
    best = made[-1] if settled else min(made, key=lambda each: each.growth + beyond(each.x, tasks.limits))
    return best._replace(rounds=tuple((len(each.rigs), each.stated, each.growth) for each in made))


def audited(tasks: Tasks, x: Array, region: Region, seed: int) -> Found:
    """Return the growth of random rigs of a design in a region."""
    shares = tasks.growth.box.draws(np.random.default_rng([seed, 1]), AUDIT)
    return tasks.growths(x, region.low + (region.high - region.low) * shares)


def _worse(found: Found, stated: float) -> bool:
    return bool(found.growth.max() > stated + _SAME * abs(stated) + _SURE)


def _starts(tasks: Tasks, U: Array, count: int, seed: int) -> Array:
    """The best [count, free] of designs that fill the ranges, by their largest growth over rigs U and their limits."""
    from scipy.stats import qmc

    free = len(tasks.growth.box.free)
    if not free:
        return np.zeros((1, 0))
    X = qmc.LatinHypercube(free, rng=np.random.default_rng(seed)).random(FIRST)
    values = tasks.largest(X, U) + [beyond(x, tasks.limits) for x in X]
    return np.asarray(X[np.argsort(values, kind="stable")[:count]])


def region_of(tasks: Tasks, number: int | None, factor: float) -> Region:
    """Return the box with all ranges (None), or with that of one uncertain value, `factor` times as wide."""
    centre = tasks.growth.box.centre
    factors = np.ones(len(centre))
    factors[slice(None) if number is None else number] = factor
    return Region(centre * (1.0 - factors), centre + factors * (1.0 - centre))


def tolerance(
    tasks: Tasks, seed: int, number: int | None, target: float, also: Sequence[Array]
) -> tuple[float, Designed | None]:
    """Return the largest factor of all ranges (`number` None), or of one, at which no rig grows by more than `target`
    [1/s], and its design; 0 and None if not even a box without width can be held.

    The factor is found by bisection, with a robust design at each width of the box.
    """
    tried = [*also]

    def held(factor: float, audited: bool = False) -> Designed | None:
        found = robust(tasks, seed, tried, region_of(tasks, number, factor), audited, target)
        if not found.growth <= target:
            return None
        tried.insert(0, found.x)
        return found

    low, high, factor = 0.0, math.inf, 1.0
    while high - low > _EXACT * low and _LEAST < factor <= _MOST:
        if held(factor) is None:
            high = factor
        else:
            low = factor
        factor = 0.5 * (low + high) if math.isfinite(high) else 2.0 * low
    while low > _LEAST:
        found = held(low, audited=True)
        if found is not None:
            return low, found
        low *= _BACK
    return 0.0, None
