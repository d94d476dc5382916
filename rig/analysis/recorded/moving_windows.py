"""Centred moving windows over the samples of a recording with gaps, and the longest period in the samples."""

from __future__ import annotations

import numpy as np

from rig.analysis.recorded.series import Series
from rig.record.run import Reals

PARTS = 16
"""Successive windows are offset by about this fraction of their length, a whole number of samples."""
_MOST_PARTS = 40  # chosen: near every length is a multiple of a number from `PARTS` to this one
FEWEST = 4
"""Fewest samples in a window."""
_KNOWN = 0.5  # share of the samples of a window that must exist
_DRIFT = 3  # lines of a spectrum
_STRONG = 0.1  # of the mean square


def moving_rms(signal: Series, length: float) -> tuple[Reals, Reals, float]:
    """Return middles [s] of windows of about `length` [s], the RMS about the mean in each, and their true length [s].

    NaN where less than half of the samples of a window exist.
    """
    parts, hop = _divided(max(round(length * signal.rate), FEWEST))
    window = parts * hop
    seconds = window / signal.rate
    ok = np.isfinite(signal.v)
    if not ok.any() or ok.size < window:
        return np.empty(0), np.empty(0), seconds
    v = np.where(ok, signal.v - np.nanmean(signal.v), 0.0)  # subtract the mean: a large one costs digits
    cuts = np.arange(0, v.size - hop + 1, hop)
    whole = cuts.size * hop
    n, first, second = (
        np.convolve(values[:whole].reshape(-1, hop).sum(axis=1), np.ones(parts), "valid")
        for values in (ok * 1.0, v, v * v)
    )
    with np.errstate(invalid="ignore", divide="ignore"):
        square = np.maximum(second / n - (first / n) ** 2, 0.0)
    rms = np.where(n >= _KNOWN * window, np.sqrt(square), np.nan)
    middles = signal.start + (np.arange(n.size) * hop + 0.5 * (window - 1)) / signal.rate
    return np.asarray(middles, np.float64), np.asarray(rms, np.float64), seconds


def moving_mean(t: Reals, v: Reals, at: Reals, length: float) -> Reals:
    """Return the mean of v over windows of `length` [s] about `at`, from its integral by the trapezium rule."""
    steps = 0.5 * (v[1:] + v[:-1]) * np.diff(t)
    integral = np.concatenate(([0.0], np.cumsum(steps)))
    begin = np.clip(at - 0.5 * length, t[0], t[-1])
    end = np.clip(at + 0.5 * length, t[0], t[-1])
    taken = np.maximum(end - begin, 1e-300)
    return np.asarray((np.interp(end, t, integral) - np.interp(begin, t, integral)) / taken)


def slowest(signal: Series) -> float:
    """Return the lowest frequency [Hz] of a strong vibration, 0 if nothing vibrates: a tenth of the mean square lies
    below it.

    The drift over the whole recording does not count. Gaps are filled with the mean.
    """
    from scipy.signal import periodogram

    ok = np.isfinite(signal.v)
    v = np.where(ok, signal.v - np.nanmean(signal.v), 0.0)
    frequencies, power = periodogram(v, signal.rate, window="hann", detrend="linear")
    power[:_DRIFT] = 0.0
    if not power.any():
        return 0.0
    below = np.cumsum(power)
    return float(frequencies[np.searchsorted(below, _STRONG * below[-1])])


def _divided(count: int) -> tuple[int, int]:
    """Number of parts of a window of about `count` samples, and the samples in each part."""
    if count <= _MOST_PARTS:
        return count, 1
    near = (count + sign * shift for shift in range(count) for sign in (1, -1))
    divisors = range(PARTS, _MOST_PARTS + 1)
    return next((parts, n // parts) for n in near for parts in divisors if n % parts == 0)
