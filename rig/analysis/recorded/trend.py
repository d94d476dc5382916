"""The smoothing of a force whose derivative is taken: piecewise linear, which keeps the sudden begins of slips.

Source: Colas, Pustelnik, Oliver, Abry, Geminard, Vidal, Physical Review E 100 (2019) 032803; the algorithm, Kim, Koh,
Boyd, Gorinevsky, SIAM Review 51 (2009) 339.
"""

from __future__ import annotations

import math

import numpy as np

from rig.record.run import Reals

_GAP = 1e-9  # of the objective: duality gap at which the smoothing ends
_ROUNDS = 80  # at most


def trend(v: Reals, s: float) -> Reals:
    """The curve y with the smallest sum (v - y)^2 / 2 + s sum |y''|: piecewise linear. Missing samples are bridged."""
    from scipy.linalg import solveh_banded

    known = np.isfinite(v)
    if v.size < 3 or not known.any():
        return v
    v = np.interp(np.arange(v.size), np.flatnonzero(known), v[known])
    n = v.size - 2
    Dv = np.diff(v, 2)
    bands = np.zeros((3, n))
    bands[0, 2:] = 1.0
    bands[1, 1:] = -4.0
    bands[2] = 6.0

    def transposed(z: Reals) -> Reals:
        return np.asarray(np.convolve(z, (1.0, -2.0, 1.0)))

    z = np.zeros(n)  # the dual, |z| <= s
    low = np.ones(n)  # the multipliers of both bounds
    high = np.ones(n)
    t = 1e-10
    step = math.inf
    for _ in range(_ROUNDS):
        back = transposed(z)
        forth = np.diff(back, 2)
        w = Dv - (high - low)
        by_multipliers = 0.5 * float(w @ solveh_banded(bands, w)) + s * float(np.sum(high + low))
        by_dual = 0.5 * float(back @ back) + s * float(np.abs(Dv - forth).sum())
        primal = min(by_multipliers, by_dual)
        gap = primal + 0.5 * float(back @ back) - float(Dv @ z)
        if gap <= _GAP * max(abs(primal), np.finfo(float).tiny):
            break
        if step >= 0.2:
            t = max(4.0 * n / gap, 1.2 * t)
        over = z - s  # negative inside, as the next
        under = -z - s
        matrix = bands.copy()
        matrix[2] -= high / over + low / under
        dz = solveh_banded(matrix, -forth + Dv + (1.0 / over - 1.0 / under) / t)
        dhigh = -(high + (1.0 / t + dz * high) / over)
        dlow = -(low + (1.0 / t - dz * low) / under)
        step = 1.0
        for m, dm in ((high, dhigh), (low, dlow)):
            if (dm < 0.0).any():
                step = min(step, 0.99 * float(np.min(-m[dm < 0.0] / dm[dm < 0.0])))
        for _ in range(40):  # stay inside, and come closer
            new = z + step * dz
            if np.max(np.abs(new)) < s:
                break
            step *= 0.5
        z = z + step * dz
        high = high + step * dhigh
        low = low + step * dlow
    return np.asarray(v - transposed(z))
