"""Resonances of a frequency response: natural frequency and damping from a fit about each peak.

    H(s) = (c0 + c1 s + c2 s^2 + c3 s^3) / (s^2 + a1 s + a0),  s = 2 pi i f

One pole pair, real coefficients; the cubic stands for the mode's own residue, which differs between displacement,
velocity and acceleration, and for the tails of the other modes. Least squares over the lines about the peak that are
above half of its height, at least four on either side, iterated with the last denominator as weight (Sanathanan and
Koerner, IEEE Trans. Autom. Control 8, 1963), so that the error of H itself becomes least. A fit uses every line, where
the half-power method uses two.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from rig.record.run import Reals

Complex = NDArray[np.complex128]
_STANDS_OUT = 6.0  # dB above the minima beside it
_SURE = 0.1  # random error of a peak
_TRIED = 200  # peaks that are fitted, the largest ones
_MOST = 12  # resonances among them
_LINES_BESIDE = 4  # lines on either side of a peak, at least
_DEEP = 0.5  # share of the height of a peak down to which its lines are fitted
_ROUNDS = 20  # of the weighted least squares, at most; they end when the denominator stays
_FITS = 0.2  # RMS of the error of a fit over that of the response
_NARROWEST = 0.5  # lines in the bandwidth


class Resonance(NamedTuple):
    """A peak of a frequency response: `frequency` [Hz] of the damped vibration and damping ratio, as in `rig modes`.

    `at` [Hz]: the line with the largest magnitude, `magnitude` there, its `coherence` and random error. `bandwidth`
    [Hz]: between the half-power points, by the fit.
    """

    frequency: float
    damping: float
    bandwidth: float
    at: float
    magnitude: float
    coherence: float
    error: float


def resonances(f: Reals, h: Complex, coherence: Reals, error: Reals) -> tuple[Resonance, ...]:
    """Return the resonances of the response `h` at `f` [Hz], the largest peaks, in order of frequency.

    `h` is NaN at a line without excitation. A resonance is a peak 6 dB above its surroundings with a random error of at
    most 10 %, to whose lines a stable pole pair fits within 20 %, with a bandwidth of at least half a line.
    """
    from scipy.signal import find_peaks

    known = np.isfinite(h)
    lines = np.flatnonzero(known)
    size = np.where(known, np.abs(h), 0.0)
    if not size.any():
        return ()
    level = 20.0 * np.log10(np.maximum(size[lines], 1e-15 * size.max()))
    tops, _ = find_peaks(level, prominence=_STANDS_OUT)
    sure = []
    for top in lines[tops].tolist():
        beside = error[max(top - _LINES_BESIDE, 0) : top + _LINES_BESIDE + 1]  # all nan with a single window
        unsure = np.isfinite(beside).any() and max(float(error[top]), float(np.nanmedian(beside))) > _SURE
        if not unsure:
            sure.append(top)
    fitted: list[Resonance] = []
    for top in sorted(sure, key=lambda top: -size[top])[:_TRIED]:
        low, high = _about(size, known, top)
        pole = _fitted(f[low:high], h[low:high]) if high - low > 2 * _LINES_BESIDE else None
        if pole is None:
            continue
        hertz = pole.imag / (2.0 * math.pi)
        if not f[low] <= hertz <= f[high - 1]:
            continue
        bandwidth = -pole.real / math.pi
        if bandwidth >= _NARROWEST * (f[1] - f[0]):
            at_top = (float(v[top]) for v in (f, size, coherence, error))
            fitted.append(Resonance(hertz, -pole.real / abs(pole), bandwidth, *at_top))
    return tuple(sorted(fitted[:_MOST]))


def _about(size: Reals, known: NDArray[np.bool_], top: int) -> tuple[int, int]:
    """The first line of a peak and the one after its last."""

    def belongs(line: int, to: int) -> bool:
        """Whether the line `to`, beside `line`, is one of the peak: near its top, or falling and high enough."""
        if not 0 <= to < size.size or not known[to]:
            return False
        falls = size[to] >= _DEEP * size[top] and size[to] <= size[line]
        return abs(line - top) < _LINES_BESIDE or bool(falls)

    ends = []
    for step in (-1, 1):
        line = top
        while belongs(line, line + step):
            line += step
        ends.append(line)
    return ends[0], ends[1] + 1


def _fitted(f: Reals, h: Complex) -> complex | None:
    """The stable pole [1/s] with positive frequency; None without one, or if the fit is bad."""
    scale = 2.0 * math.pi * float(f.mean())
    s = 2j * math.pi * f / scale
    rows = np.stack([-h * s, -h, np.ones_like(s), s, s * s, s**3], axis=1)
    weight = np.ones(f.size)
    a1 = a0 = 0.0
    for _ in range(_ROUNDS):
        weighed = rows * weight[:, None]
        right = h * s * s * weight
        A = np.concatenate([weighed.real, weighed.imag])
        b = np.concatenate([right.real, right.imag])
        solved = np.linalg.lstsq(A, b, rcond=None)[0]
        change = abs(float(solved[0]) - a1) + abs(float(solved[1]) - a0)
        a1 = float(solved[0])
        a0 = float(solved[1])
        if change < 1e-12:
            break
        weight = 1.0 / np.maximum(np.abs(s * s + a1 * s + a0), 1e-9)
    inside = a0 - 0.25 * a1 * a1
    off = h - rows[:, 2:] @ solved[2:] / (s * s + a1 * s + a0)
    if a1 <= 0.0 or inside <= 0.0 or np.linalg.norm(off) > _FITS * np.linalg.norm(h):
        return None
    return scale * complex(-0.5 * a1, math.sqrt(inside))
