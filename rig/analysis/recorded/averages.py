"""Averaged spectra of two channels over windows: power, cross spectrum, and how many averages are independent.

noise and vibration   Hann windows, half overlapping, each without its mean (Welch)
pulses                windows that begin shortly before each pulse and are not tapered: a taper would change the decay

Source: J. S. Bendat, A. G. Piersol, Random Data, 4th edition, 2010, chapters 6, 8 and 9.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from rig.record.run import Integers, Reals

_CHUNK = 1 << 22  # samples that are transformed at once


class Averages(NamedTuple):
    """One-sided spectra at `f` [Hz]: `sxx`, `syy` (real) and `sxy` = mean of conj(X) Y, of `windows` windows.

    `independent`: number of independent windows that have the same variance. `left_out`: windows with gaps, or that end
    after the last sample. `rest`: RMS of the output about its mean in the last tenth of the windows over that in the
    whole windows; NaN for Hann windows.
    """

    f: Reals
    sxx: Reals
    syy: Reals
    sxy: NDArray[np.complex128]
    windows: int
    independent: float
    left_out: int
    tapered: bool
    rest: float


def averaged(x: Reals, y: Reals, rate: float, count: int, begins: Integers) -> Averages:
    """Average over windows of `count` samples that begin at `begins`; without any, over half overlapping Hann windows.

    Windows with a missing sample (NaN) are left out.
    """
    from scipy.signal import get_window

    tapered = not begins.size
    weights = np.asarray(get_window("hann", count), np.float64) if tapered else np.ones(count)
    hop = count - count // 2
    places = np.arange(0, x.size - count + 1, hop) if tapered else begins[begins + count <= x.size]
    gaps = np.concatenate(([0], np.cumsum(np.isnan(x) | np.isnan(y))))
    used = places[gaps[places + count] == gaps[places]]
    lines = count // 2 + 1
    sxx = np.zeros(lines)
    syy = np.zeros(lines)
    sxy = np.zeros(lines, np.complex128)
    late = whole = 0.0
    rows = max(_CHUNK // count, 1)
    for begin in range(0, used.size, rows):
        index = used[begin : begin + rows, None] + np.arange(count)
        inputs, outputs = (v[index] - v[index].mean(axis=1, keepdims=True) for v in (x, y))
        X = np.fft.rfft(inputs * weights, axis=1)
        Y = np.fft.rfft(outputs * weights, axis=1)
        sxx += (np.abs(X) ** 2).sum(axis=0)
        syy += (np.abs(Y) ** 2).sum(axis=0)
        sxy += (X.conj() * Y).sum(axis=0)
        late += float(outputs[:, -max(count // 10, 1) :].var(axis=1).sum())
        whole += float((outputs**2).mean(axis=1).sum())
    power = float(weights @ weights)
    scale = 2.0 / (rate * power * max(used.size, 1))
    shared = float(weights[hop:] @ weights[: count - hop]) / power if tapered else 0.0
    independent = used.size / (1.0 + 2.0 * shared**2 * (1.0 - 1.0 / max(used.size, 1)))
    wanted = places if tapered else begins
    left_out = wanted.size - used.size
    rest = np.nan if tapered or not whole else float(np.sqrt(late / whole))
    f = np.asarray(np.fft.rfftfreq(count, 1.0 / rate), np.float64)
    sxx *= scale
    syy *= scale
    sxy *= scale
    return Averages(f, sxx, syy, sxy, used.size, independent, left_out, tapered, rest)
