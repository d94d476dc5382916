"""Averaged spectra of two channels over windows: power, cross spectrum, and how many averages are independent.

noise and vibration   Hann windows, half overlapping, each without its mean (Welch)
pulses                windows that begin shortly before each pulse and are not tapered: a taper would change the decay
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
    sxx, syy, sxy = np.zeros(lines), np.zeros(lines), np.zeros(lines, np.complex128)
    late = whole = 0.0
    rows = max(_CHUNK // count, 1)
    for part in (used[a : a + rows] for a in range(0, used.size, rows)):
        index = part[:, None] + np.arange(count)
        taken = [v[index] - v[index].mean(axis=1, keepdims=True) for v in (x, y)]
        one, other = (np.fft.rfft(v * weights, axis=1) for v in taken)
        sxx += (np.abs(one) ** 2).sum(axis=0)
        syy += (np.abs(other) ** 2).sum(axis=0)
        sxy += (one.conj() * other).sum(axis=0)
        late += float(taken[1][:, -max(count // 10, 1) :].var(axis=1).sum())
        whole += float((taken[1] ** 2).mean(axis=1).sum())
    scale = 2.0 / (rate * float(weights @ weights) * max(used.size, 1))
    shared = float(weights[hop:] @ weights[: count - hop]) / float(weights @ weights) if tapered else 0.0
    return Averages(
        np.asarray(np.fft.rfftfreq(count, 1.0 / rate), np.float64), scale * sxx, scale * syy, scale * sxy, used.size,
        used.size / (1.0 + 2.0 * shared**2 * (1.0 - 1.0 / max(used.size, 1))),
        (places if tapered else begins).size - used.size, tapered,
        np.nan if tapered or not whole else float(np.sqrt(late / whole)),
    )  # fmt: skip
