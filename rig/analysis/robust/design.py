"""The robust design: designs polished over a growing set of worst rigs, until no worse rig is found.

    designs from Latin hypercube points, the best of them polished against the set of rigs (rig.analysis.robust.descent)
    worst rig of the best one (rig.analysis.robust.worst); if it is worse than stated, it joins the set
    audit: random rigs of the box; if one is worse than stated, its ascent joins the set

The nominal optimum is the same with the nominal rig alone. A tolerance is the largest width of the box that a design
holds: whose worst rig grows by no more than a target, which is 0 or minus a decay.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from rig.analysis.robust.descent import beyond
from rig.analysis.robust.tasks import Found, Region, Tasks
from rig.analysis.robust.worst import Worst, ascended, whole, worst

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
_MOST = 64.0  # largest factor of a tolerance that is tried
_EXACT = 0.01  # of the factor, at which the bisection ends
_LEAST = 1e-3  # factor below which nothing can be held
_BACK = 0.98  # factor after an audit that has found a worse rig


class Designed(NamedTuple):
    """A design x [free] with its worst rig, the value that the set of rigs gives it, the audit, and whether no worse
    rig was found in the last round. `rounds`: (rigs in the set, value of the set, growth of the worst rig).
    """

    x: Array
    worst: Worst
    stated: float
    audit: Found | None
    settled: bool
    rigs: Array
    rounds: tuple[tuple[int, float, float], ...]


def nominal_optimum(tasks: Tasks, seed: int) -> Array:
    """Return the design [free] with the smallest growth of the nominal rig."""
    rig = tasks.growth.box.centre[None]
    X = _starts(tasks, rig, _NOMINAL, seed)
    return np.asarray(tasks.polished(X, rig)[0][0])


def robust(
    tasks: Tasks,
    seed: int,
    also: Sequence[Array] = (),
    region: Region | None = None,
    audit: bool = True,
    target: float = -math.inf,
) -> Designed:
    """Return the design whose worst rig in a region (by default the stated box) grows least.

    `also`: designs [free] that are tried as well; `audit`: whether random rigs are. `target` [1/s]: a design whose
    worst rig grows by no more is good enough, and the search ends where the set of rigs allows none.
    """
    box = tasks.growth.box
    region = whole(len(box.uncertain)) if region is None else region
    centre = np.clip(box.centre, *region)
    first = np.unique(np.array([centre, region.low, region.high]), axis=0)
    X = np.vstack([_starts(tasks, first, _ROBUST, seed), *also])
    U = centre[None]
    rounds: list[tuple[int, float, float]] = []
    best: Designed | None = None
    audits = 0
    for _ in range(_ROUNDS):
        X, values = tasks.polished(X, U)
        x, stated = X[0], float(values[0])
        bad = worst(tasks, x, region, U)
        settled = not _worse(bad.growth, stated) or bad.growth <= target
        found = None
        if settled and audit and audits < _AUDITS:
            found = audited(tasks, x, region, seed + audits)
            audits += 1
            if _worse(float(found.growth.max()), max(bad.growth, stated, target)):
                bad = ascended(tasks, x, region, found.u, found.growth)
                settled = False
        rounds.append((len(U), stated, bad.growth))
        made = Designed(x, bad, stated, found, settled, U, tuple(rounds))
        if best is None or settled or _value(made, tasks) < _value(best, tasks):
            best = made
        if settled or stated > target > -math.inf or not math.isfinite(stated):
            break
        U = np.vstack([U, bad.u])
        X = X[: max(1, len(X) - 1)]
    assert best is not None
    return best._replace(rounds=tuple(rounds))


def _value(made: Designed, tasks: Tasks) -> float:
    return made.worst.growth + beyond(made.x, tasks.limits)


def audited(tasks: Tasks, x: Array, region: Region, seed: int) -> Found:
    """Return the growth of random rigs of a design in a region."""
    shares = tasks.growth.box.draws(np.random.default_rng([seed, 1]), AUDIT)
    return tasks.growths(x, region.low + (region.high - region.low) * shares)


def _worse(growth: float, stated: float) -> bool:
    return growth > stated + _SAME * abs(stated) + _SURE


def _starts(tasks: Tasks, U: Array, count: int, seed: int) -> Array:
    """The best [count, free] of designs that fill the ranges, by their largest growth over rigs U and their limits."""
    from scipy.stats import qmc

    if not tasks.growth.box.free:
        return np.zeros((1, 0))
    chance = np.random.default_rng(seed)
    X = qmc.LatinHypercube(len(tasks.growth.box.free), rng=chance).random(FIRST)
    every = tasks.growths(np.repeat(X, len(U), axis=0), np.tile(U, (len(X), 1)))
    values = every.growth.reshape(len(X), len(U)).max(axis=1)
    values = values + [beyond(x, tasks.limits) for x in X]
    return np.asarray(X[np.argsort(values, kind="stable")[:count]])


def region_of(tasks: Tasks, number: int | None, factor: float) -> Region:
    """Return the box with all ranges (None), or with that of one uncertain value, `factor` times as wide."""
    centre = tasks.growth.box.centre
    factors = np.ones(len(centre))
    factors[slice(None) if number is None else number] = factor
    return Region(centre * (1.0 - factors), centre + factors * (1.0 - centre))


def tolerance(
    tasks: Tasks, seed: int, number: int | None, target: float, also: list[Array]
) -> tuple[float, Designed | None]:
    """Return the largest factor of all ranges (`number` None), or of one, at which no rig grows by more than `target`
    [1/s], and its design; 0 and None if not even a box without width can be held.

    The factor is found by bisection, with a robust design at each width of the box.
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
        return 0.0, None
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
            return low, found
        low *= _BACK
    return 0.0, None


def _bracket(held: Callable[[float], Designed | None]) -> tuple[float, float, Designed | None]:
    """A factor that is held with its design, and one that is not."""
    low, high = 0.0, 1.0
    best = None
    found = held(high)
    while found is not None and high <= _MOST:
        low, best = high, found
        high *= 2.0
        found = held(high)
    while best is None and high > _LEAST:
        low = 0.5 * high
        best = held(low)
        high = high if best is not None else low
    return low, high, best
