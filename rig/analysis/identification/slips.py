"""The detector of slips in a column of a recording or of a model: begins of slips and measures of their cycles.

The slip signal u = 1 - r / s of a column, r its rate (of a velocity its value), s that in stick, is 0 in stick. A slip
counts where u exceeds .8; it begins and ends where u passes .3, as in rig.analysis.recorded.stick_slip. Without stick,
u is how far the column lies below its middle. The same code reads a measurement and the periods of a model, so that its
filter is a part of both.
"""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import numpy as np

from rig.record.run import Reals

MEASURES = ("period", "stick", "motion", "drop", "level", "peak")
_LOGARITHMS = [0, 1, 2, 3, 5]  # measures that are logarithms; a level may be negative
_LOW = 0.3  # slip signal at begin and end of a slip
_HIGH = 0.8  # slip signal that a slip exceeds


class Slips(NamedTuple):
    """Slips of a column: their begins [s] and the measures of the cycle that each ends, [cycle, MEASURES]."""

    begins: Reals
    measures: Reals


def noise_of(v: Reals) -> float:
    """Standard deviation of the noise of samples of a smooth signal, at least that of its rounding."""
    known = v[np.isfinite(v)]
    third = np.diff(known, 3)
    spread = 0.0
    if third.size:
        usual = float(np.median(np.abs(third - np.median(third))))
        spread = 1.4826 * usual / math.sqrt(20.0)
    steps = np.abs(np.diff(known))
    held = np.count_nonzero(steps == 0.0)
    changes = steps[steps > 0.0]
    step = float(changes.min()) if changes.size else 0.0
    rounded = step / math.sqrt(12.0) if held > 0.02 * steps.size else 0.0
    return max(spread, rounded, 1e-9 * float(np.ptp(known)), 1e-300)


def window(noise: float, rate: float, slope: float, motion: float) -> int:
    """Samples (odd) over which a derivative is taken: its noise stays below a tenth of the slope, if that fits."""
    wanted = (12.0 * (noise * rate / (0.1 * abs(slope))) ** 2) ** (1.0 / 3.0) if slope else 5.0
    most = max(0.33 * motion * rate, 5.0)
    return int(np.clip(wanted, 5.0, most)) | 1


def slips(v: Reals, rate: float, start: float, slope: float, velocity: bool, n: int) -> Slips | None:
    """The slips of samples at `rate` from `start` on; None with less than three.

    `slope`: rate in stick; NaN: the middle of the column. `n`: window of the filter.
    """
    from scipy.ndimage import median_filter
    from scipy.signal import savgol_filter

    calm = median_filter(v, 5, mode="nearest")
    smooth = savgol_filter(calm, n, 2)
    if math.isnan(slope):
        low, high = np.percentile(smooth, (2.0, 98.0))
        u = (0.5 * (low + high) - smooth) / max(0.5 * (high - low), 1e-300)
        lower = 0.0
        upper = 0.5
    else:
        speed = smooth if velocity else savgol_filter(calm, n, 2, deriv=1, delta=1.0 / rate)
        u = 1.0 - speed / slope
        lower = _LOW
        upper = _HIGH
    above = u > lower
    edges = np.diff(above.astype(np.int8))
    begins = np.flatnonzero(edges == 1)
    ends = np.flatnonzero(edges == -1)
    if begins.size < 3 or not ends.size:
        return None
    ends = ends[ends > begins[0]]
    begins = begins[: ends.size]
    tall = np.array([u[a : b + 2].max() > upper for a, b in zip(begins, ends)], bool)
    begins = begins[tall]
    ends = ends[tall]
    if begins.size < 4:
        return None
    t0 = start + _passages(u, begins, lower) / rate
    t1 = start + _passages(u, ends, lower) / rate
    up = math.copysign(1.0, slope) if not math.isnan(slope) and not velocity else 1.0
    rows = []
    for j in range(1, begins.size):
        a = begins[j]
        b = ends[j]
        before = ends[j - 1]
        first = before if math.isnan(slope) else max(a - 2, 0)  # the slip alone: what wanders in stick is no drop
        high = _peak(up * smooth[first : b + 2])
        low = -_peak(-up * smooth[a : min(b + n, smooth.size)])
        period = t0[j] - t0[j - 1]
        stick = t0[j] - t1[j - 1]
        motion = t1[j] - t0[j]
        level = up * 0.5 * (high + low)
        rows.append((period, stick, motion, high - low, level, _peak(u[max(a - 1, 0) : b + 3])))
    measures = np.array(rows)
    with np.errstate(invalid="ignore", divide="ignore"):
        measures[:, _LOGARITHMS] = np.log(measures[:, _LOGARITHMS])
    return Slips(t0[1:], measures)


def _passages(u: Reals, before: Any, value: float) -> Reals:
    """Where `u` passes a value after the samples `before` [samples], by straight lines."""
    return np.asarray(before + (value - u[before]) / (u[before + 1] - u[before]))


def _peak(v: Reals) -> float:
    """The largest value, by a parabola through three samples."""
    i = int(np.argmax(v))
    if 0 < i < v.size - 1:
        before, largest, after = v[i - 1 : i + 2]
        bend = before - 2.0 * largest + after
        if bend < 0.0:
            return float(largest - (after - before) ** 2 / (8.0 * bend))
    return float(v[i])
