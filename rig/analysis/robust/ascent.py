"""The ascent from one rig of a box to one that is worse: L-BFGS-B over the gradient of the growth that counts.

Values that take whole frames have no gradient. All their frames are tried at the end of the ascent, which then goes on.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from rig.analysis.robust.growth import Growth, NoSliding

Array = NDArray[np.float64]
_ROUNDS = 15
_EVALUATIONS = 30
_FRAMES = 64  # most frames of a delay that are tried
_AGAIN = 2  # ascents, if another delay is worse
_NOTHING = -1e12  # 1/s, of a rig without a mode that counts


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
    options = {"maxiter": _ROUNDS, "maxfun": _EVALUATIONS}
    found = minimize(falling, u, jac=True, bounds=bounds, method="L-BFGS-B", options=options)
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
