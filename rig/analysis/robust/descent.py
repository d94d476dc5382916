"""Descents by gradients: a design improved against a set of rigs, and from a rig to a worse one.

A design is improved by linear programs over all eigenvalues that may count, in a trust region. Each of the largest
eigenvalues of the band is a row at each rig, so that modes that cross are no trouble:

    smallest t with  Re lambda_ik + g_ik s <= t in the band,  <= 0 outside of it,  limits kept,  |s| <= Delta

s is the step of the design, g_ik the gradient of eigenvalue i of rig k. The region grows where the program foretells
the gain and shrinks where a step gains nothing.

A worse rig is found by L-BFGS-B over the gradient of the growth that counts. Values that take whole frames have no
gradient: all their frames are tried at its end, and it then goes on.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence

import numpy as np
from numpy.typing import NDArray

from rig.analysis.robust.box import Limit
from rig.analysis.robust.growth import Growth, Piece

Array = NDArray[np.float64]
PENALTY = 1e3  # 1/s of what is beyond a limit, and times the growth outside of the band
_ROUNDS = 60
_REGION = 0.2  # of the unit cube: first trust region,
_WIDEST = 0.5  # largest,
_LEAST = 1e-6  # and smallest
_FAR = 50.0  # 1/s: modes outside of the band that decay faster do not limit a step
_SHARE = 0.05  # of the foretold gain that a step must make
_GOOD = 0.5  # share from which on the region grows
_SHRINKS = 0.35
_ASCENT = {"maxiter": 15, "maxfun": 30}  # of L-BFGS-B
_FRAMES = 64  # most frames of a delay that are tried
_AGAIN = 2  # ascents, if another delay is worse
_NOTHING = -1e12  # 1/s, of a rig without a mode that counts


def beyond(x: Array, limits: Sequence[Limit]) -> float:
    """Return the penalty [1/s] of a design for what is beyond its limits."""
    return PENALTY * sum(max(0.0, limit.excess(x)) for limit in limits)


def polish(growth: Growth, x: Array, U: Array, limits: Sequence[Limit]) -> tuple[Array, float]:
    """Return the design that a descent from x [free] reaches against rigs U [k, uncertain], and its value: the largest
    growth, with a penalty for what is beyond a limit.
    """

    def of(design: Array) -> float:
        return max(growth.value(design, u)[0] for u in U) + beyond(design, limits)

    value = of(x)
    region = _REGION
    pieces: list[Piece] = []
    for _ in range(_ROUNDS if len(x) and math.isfinite(value) else 0):
        pieces = pieces or [piece for u in U for piece in growth.pieces(x, u)]
        step, foretold = _program(x, pieces, limits, region)
        new = np.clip(x + step, 0.0, 1.0)
        hoped = value - foretold
        reached = of(new) if math.isfinite(hoped) else math.inf
        gain = value - reached
        if gain > _SHARE * max(hoped, 0.0) and gain > 1e-12:
            x, value, pieces = new, reached, []
            if gain > _GOOD * hoped:
                region = min(_WIDEST, 2.0 * region)
            continue
        region *= _SHRINKS
        if region < _LEAST:
            break
    return x, value


def _program(x: Array, pieces: Sequence[Piece], limits: Sequence[Limit], region: float) -> tuple[Array, float]:
    """The step of a linear program, and the value that it foretells; infinity if it has no solution."""
    from scipy.optimize import linprog

    counting = [piece for piece in pieces if piece.inside or piece.rate.real > -_FAR]
    rows = [[*piece.slope, *((-1.0, 0.0) if piece.inside else (0.0, -1.0))] for piece in counting]
    rows += [[*limit.slope, 0.0, 0.0] for limit in limits]
    ends = [*(-piece.rate.real for piece in counting), *(-limit.excess(x) for limit in limits)]
    low = np.maximum(-region, -x)
    high = np.minimum(region, 1.0 - x)
    least = None if any(piece.inside for piece in pieces) else 0.0  # nothing in the band: growth outside of it counts
    bounds = [*zip(low.tolist(), high.tolist()), (least, None), (0.0, None)]
    cost = np.concatenate([np.zeros(len(x)), [1.0, PENALTY]])
    solved = linprog(cost, A_ub=np.array(rows), b_ub=np.array(ends), bounds=bounds, method="highs")
    if solved.status:
        return np.zeros_like(x), math.inf
    return np.asarray(solved.x[: len(x)]), float(solved.fun)


def ascend(growth: Growth, x: Array, u: Array, low: Array, high: Array) -> tuple[Array, float, float]:
    """Return the worst rig that an ascent of design x from rig u reaches between `low` and `high`, with its growth
    [1/s] and frequency [Hz].
    """

    def at(rig: Array) -> tuple[Array, float, float]:
        return rig, *growth.value(x, rig)

    best = at(np.clip(u, low, high))
    for _ in range(_AGAIN):
        if best[1] == math.inf:
            break
        best = max(best, at(_ascent(growth, x, best[0], low, high)), key=_growth)
        other = max(map(at, _other_frames(growth, best[0], low, high)), key=_growth, default=best)
        if not other[1] > best[1]:
            break
        best = other
    return best


def _growth(found: tuple[Array, float, float]) -> float:
    return found[1]


def _ascent(growth: Growth, x: Array, u: Array, low: Array, high: Array) -> Array:
    from scipy.optimize import minimize

    def falling(at: Array) -> tuple[float, Array]:
        pieces = growth.pieces(x, np.clip(at, low, high), of_rig=True, kept=1)
        if not pieces:  # its growth is infinite
            return _NOTHING, np.zeros_like(at)
        counting = [piece for piece in pieces if piece.inside or piece.rate.real > 0.0]
        if not counting:
            return -_NOTHING, np.zeros_like(at)
        top = max(counting, key=lambda piece: piece.rate.real)
        return -top.rate.real, -top.slope

    if not (high > low).any():
        return u
    bounds = [*zip(low.tolist(), high.tolist())]
    found = minimize(falling, u, jac=True, bounds=bounds, method="L-BFGS-B", options=_ASCENT)
    return np.asarray(np.clip(found.x, low, high), dtype=np.float64)


def _other_frames(growth: Growth, u: Array, low: Array, high: Array) -> Iterator[Array]:
    """The rigs with another delay in whole frames."""
    for i, value in enumerate(growth.box.uncertain):
        if value.step:
            count = min(value.frames(low[i], high[i]) + 1, _FRAMES)
            for share in np.linspace(low[i], high[i], count):
                other = u.copy()
                other[i] = share
                yield other
