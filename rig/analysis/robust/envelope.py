"""The growth rate of a vibration in a run: the slope of the logarithm of its envelope.

A lightly damped mode is mixed down with its frequency, so that other tones are left out (rig.analysis.recorded.growth).
The envelope of any other mode is the root mean square over each period of it: what grows by exp(a T) in a period T has
a mean square that grows by exp(2 a T), however strong its damping is.

Samples in the middle of the evaluated span count most: beats with other modes that decay as slowly hardly change the
slope then.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from rig.analysis.recorded.growth import mixed

Array = NDArray[np.float64]
Complex = NDArray[np.complex128]
_LIGHT = 0.02  # damping ratio below which a filter of some periods changes little of the vibration
_SETTLED = 8  # samples of the mixed tone in half of its filter: nothing before them counts
_APART = 0.7  # of the distance to the next tone: half of the band
_WIDEST = 0.4  # of the frequency
_SLOW = 3.0  # times as fast a decay: a tone that decays faster leaves the band by itself
_GONE = math.log(300.0)  # of the amplitude: another mode that has decayed by so much no longer counts
_POINTS = 24  # of an envelope in a period


class Mode(NamedTuple):
    """The mode whose growth counts: its `rate` [1/s], complex, and the `others` of the rig [mode]."""

    rate: complex
    others: Complex

    @property
    def hertz(self) -> float:
        """Its frequency [Hz]."""
        return abs(self.rate.imag) / (2.0 * math.pi)

    @property
    def light(self) -> bool:
        """Whether it is damped so lightly that it can be filtered."""
        return abs(self.rate.real) < _LIGHT * abs(self.rate.imag)

    @property
    def half(self) -> float:
        """Half of the band [Hz] in which it is alone, as far as the distance of other tones allows."""
        widest = _WIDEST * self.hertz
        slow = self.others[self.others.real > self.rate.real - _SLOW * abs(self.rate.real)]
        beside = np.abs(np.abs(slow.imag) / (2.0 * math.pi) - self.hertz)
        nearest = float(beside.min(initial=math.inf))
        return min(widest, max(_APART * nearest, 0.02 * widest, abs(self.rate.real)))

    @property
    def alone(self) -> float:
        """The time [s] after a knock from which on it is alone: faster ones have decayed, and a filter has settled."""
        others = self.others
        if self.light:
            others = others[np.abs(np.abs(others.imag) / (2.0 * math.pi) - self.hertz) <= self.half]
        faster = self.rate.real - others.real
        faster = faster[faster > 0.0]
        slowest = float(faster.min(initial=math.inf))
        return _GONE / slowest + (_SETTLED / (2.0 * self.half) if self.light else 0.0)

    @property
    def slower(self) -> float:
        """Frequency [Hz] of another mode that decays more slowly and is not filtered; NaN without one."""
        slower = self.others[self.others.real > self.rate.real]
        if self.light or not len(slower):
            return math.nan
        return float(np.abs(slower[np.argmax(slower.real)].imag)) / (2.0 * math.pi)


def of_rates(rates: Complex, growth: float, hertz: float) -> Mode:
    """Return the mode with this growth [1/s] and frequency among the eigenvalues `rates`."""
    known = rates[np.isfinite(rates.real)]
    wanted = complex(growth, 2.0 * math.pi * hertz)
    i = int(np.argmin(np.abs(known - wanted)))
    itself = np.minimum(np.abs(known - known[i]), np.abs(known - known[i].conj())) <= 1e-9 * abs(known[i])
    return Mode(complex(growth, abs(known[i].imag)), known[~itself])


def envelope(v: Array, step: float, mode: Mode) -> tuple[Array, Array]:
    """Return times [s] and amplitudes of a mode in samples `v`, `step` [s] apart, that are zero at rest."""
    if mode.light:
        z, apart, _ = mixed(v, 1.0 / step, mode.hertz, mode.half)
        ends = slice(_SETTLED, len(z) - _SETTLED)
        return np.asarray(apart * np.arange(len(z))[ends]), np.asarray(np.abs(z)[ends])
    times = np.asarray(step * np.arange(len(v)), dtype=np.float64)
    if not mode.hertz:
        return times, np.abs(v)
    period = 1.0 / mode.hertz
    parts = 0.5 * step * (v[1:] ** 2 + v[:-1] ** 2)
    falls = mode.rate.real < 0.0  # summed from the small end on: differences of large sums would be rounding
    sums = np.concatenate([[0.0], np.cumsum(parts[::-1] if falls else parts)])
    square = -sums[::-1] if falls else sums
    begins = np.arange(0.0, times[-1] - period, period / _POINTS)
    power = (np.interp(begins + period, times, square) - np.interp(begins, times, square)) / period
    return begins, np.sqrt(2.0 * np.maximum(power, 0.0))


def slope(times: Array, amplitude: Array, begin: float, end: float) -> tuple[float, float]:
    """Return the slope [1/s] of the logarithm of an envelope from `begin` to `end` [s], and the deviation from it.

    Both are NaN for fewer than four samples.
    """
    inside = (times >= begin) & (times <= end) & (amplitude > 0.0)
    if inside.sum() < 4:
        return math.nan, math.nan
    t = times[inside]
    logarithm = np.log(amplitude[inside])
    weight = np.sin(np.pi * (t - t[0] + 0.5 * (t[1] - t[0])) / (t[-1] - t[0] + (t[1] - t[0])))
    fit = np.polyfit(t, logarithm, 1, w=weight)
    rest = weight * (logarithm - np.polyval(fit, t))
    return float(fit[0]), float(np.sqrt(np.sum(rest**2) / np.sum(weight**2)))
