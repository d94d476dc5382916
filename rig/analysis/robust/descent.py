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
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from rig.analysis.robust.box import Limit
from rig.analysis.robust.growth import Growth, NoSliding, Piece

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


def penal(growth: Growth, x: Array, U: Array, limits: Sequence[Limit]) -> float:
    """Return the largest growth of design x over rigs U [k, uncertain], with a penalty for what is beyond a limit."""
    return max(growth.value(x, u)[0] for u in U) + beyond(x, limits)


def beyond(x: Array, limits: Sequence[Limit]) -> float:
    """Return the penalty [1/s] of a design for what is beyond its limits."""
    return PENALTY * sum(max(0.0, limit.excess(x)) for limit in limits)


def polish(growth: Growth, x: Array, U: Array, limits: Sequence[Limit]) -> tuple[Array, float]:
    """Return the design that a descent from x [free] reaches against rigs U [k, uncertain], and its value (`penal`)."""
    value = penal(growth, x, U, limits)
    region = _REGION
    pieces: list[Piece] | None = None
    for _ in range(_ROUNDS if len(x) and math.isfinite(value) else 0):
        if pieces is None:
            pieces = _all_pieces(growth, x, U)
        step, foretold = _program(x, pieces, limits, region)
        if step is not None:
            new = np.clip(x + step, 0.0, 1.0)
            reached = penal(growth, new, U, limits)
            gain = value - reached
            hoped = value - foretold
            if gain > _SHARE * max(hoped, 0.0) and gain > 1e-12:
                x, value, pieces = new, reached, None
                if gain > _GOOD * hoped:
                    region = min(_WIDEST, 2.0 * region)
                continue
        region *= _SHRINKS
        if region < _LEAST:
            break
    return x, value


def _all_pieces(growth: Growth, x: Array, U: Array) -> list[Piece]:
    pieces: list[Piece] = []
    for u in U:
        try:
            pieces += growth.pieces(x, u)
        except NoSliding:  # its growth is infinite: no step into it is taken
            continue
    return pieces


def _program(x: Array, pieces: Sequence[Piece], limits: Sequence[Limit], region: float) -> tuple[Array | None, float]:
    """The step of a linear program, and the value that it foretells; None if it has no solution."""
    from scipy.optimize import linprog

    rows = []
    ends = []
    for piece in pieces:
        if piece.inside:
            rows.append([*piece.slope, -1.0, 0.0])
        elif piece.rate.real > -_FAR:
            rows.append([*piece.slope, 0.0, -1.0])
        else:
            continue
        ends.append(-piece.rate.real)
    for limit in limits:
        rows.append([*limit.slope, 0.0, 0.0])
        ends.append(-limit.excess(x))
    low = np.maximum(-region, -x)
    high = np.minimum(region, 1.0 - x)
    bounds: list[tuple[float | None, float | None]] = [*zip(low.tolist(), high.tolist()), (None, None), (0.0, None)]
    if not any(piece.inside for piece in pieces):
        bounds[-2] = (0.0, None)  # nothing in the band: only growth outside of it counts
    cost = np.concatenate([np.zeros(len(x)), [1.0, PENALTY]])
    solved = linprog(cost, A_ub=np.array(rows), b_ub=np.array(ends), bounds=bounds, method="highs")
    if solved.status:
        return None, math.inf
    return np.asarray(solved.x[: len(x)]), float(solved.fun)


def ascend(growth: Growth, x: Array, u: Array, low: Array, high: Array) -> tuple[Array, float, float]:
    """Return the worst rig that an ascent of design x from rig u reaches between `low` and `high`, with its growth
    [1/s] and frequency [Hz].
    """
    best = np.clip(u, low, high)
    value, hertz = growth.value(x, best)
    for _ in range(_AGAIN):
        if math.isinf(value) and value > 0.0:
            break
        reached = _ascent(growth, x, best, low, high)
        above = growth.value(x, reached)
        if above[0] > value:
            best = reached
            value, hertz = above
        other = _other_frames(growth, x, best, low, high)
        above = growth.value(x, other) if other is not None else (-math.inf, math.nan)
        if not above[0] > value or other is None:
            break
        best = other
        value, hertz = above
    return best, value, hertz


def _ascent(growth: Growth, x: Array, u: Array, low: Array, high: Array) -> Array:
    from scipy.optimize import minimize

    def falling(at: Array) -> tuple[float, Array]:
        try:
            pieces = growth.pieces(x, np.clip(at, low, high), of_rig=True, kept=1)
        except NoSliding:
            return _NOTHING, np.zeros_like(at)
        counting = [piece for piece in pieces if piece.inside or piece.rate.real > 0.0]
        if not counting:
            return -_NOTHING, np.zeros_like(at)
        top = max(counting, key=lambda piece: piece.rate.real)
        return -top.rate.real, -top.slope

    moves = high > low
    if not moves.any():
        return u
    bounds = [*zip(low.tolist(), high.tolist())]
    found = minimize(falling, u, jac=True, bounds=bounds, method="L-BFGS-B", options=_ASCENT)
    return np.asarray(np.clip(found.x, low, high), dtype=np.float64)


def _other_frames(growth: Growth, x: Array, u: Array, low: Array, high: Array) -> Array | None:
    """The worst rig with another delay in whole frames; None if there is none."""
    tried = []
    for i, value in enumerate(growth.box.uncertain):
        if not value.step:
            continue
        width = (value.ends[1] - value.ends[0]) / value.step  # frames between the two ends of the cube
        count = min(round(width * float(high[i] - low[i])) + 1, _FRAMES)
        for share in np.linspace(low[i], high[i], count):
            other = u.copy()
            other[i] = share
            tried.append(other)
    if not tried:
        return None
    return max(tried, key=lambda other: growth.value(x, other)[0])
