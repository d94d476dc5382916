"""Channels of different rates on one grid of times.

The grid is that of the slowest channel. A faster channel passes a low-pass filter without phase (a sinc under a Kaiser
window) and is evaluated at the instants of the grid, with any offset. With r, the rate of the grid, the filter passes
up to 0.4 r and stops from 0.6 r on, both to 1e-4. What is left above 0.5 r is folded into 0.4 r to 0.5 r. So numbers
hold up to 0.4 r. Channels that are sampled at the same instants stay as they are and hold up to 0.5 r.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from rig.analysis.recorded.series import Series
from rig.errors import UsageError
from rig.record.run import Reals

_PASS = 0.4  # share of the rate of the grid up to which the filter passes
_STOP = 0.6  # share of the rate of the grid from which on it stops: half of the band between them folds back
_RIPPLE = 80.0  # dB: deviation in the pass band and rest in the stop band, 1e-4
_SAME = 1e-3  # of a sample: instants that are this close are the same
_CHUNK = 1 << 21  # samples weighted at once, to bound the memory


def aligned(channels: Sequence[Series]) -> tuple[list[Series], float]:
    """Return the channels at common instants, and the frequency [Hz] up to which their spectra hold.

    A sample that depends on a missing one is missing (NaN). Raises UsageError if the channels share less than two
    instants.
    """
    grid = min(channels, key=lambda channel: channel.rate)
    spans = [_span(channel, grid) for channel in channels]
    begin = max(low for low, _ in spans)
    end = min(high for _, high in spans)
    if end - begin < 2:
        names = ", ".join(channel.name for channel in channels)
        raise UsageError(f"{names}: the time that they share is too short; take a longer range of time")
    whole = all(_in_step(channel, grid) for channel in channels)
    evened = [_on(channel, grid, begin, end) for channel in channels]
    return evened, (0.5 if whole else _PASS) * grid.rate


def _span(channel: Series, grid: Series) -> tuple[int, int]:
    """The instants of `grid` at which a channel can be evaluated: the first, and the one after the last."""
    first = (channel.start - grid.start) * grid.rate
    if _in_step(channel, grid):
        return round(first), round(first) + channel.v.size
    reach = _reach(channel, grid)
    last = first + (channel.v.size - 1 - reach) * grid.rate / channel.rate
    return math.ceil(first + reach * grid.rate / channel.rate), math.floor(last) + 1


def _in_step(channel: Series, grid: Series) -> bool:
    """Whether a channel is sampled at the instants of `grid`."""
    drift = abs(channel.rate / grid.rate - 1.0) * max(channel.v.size, grid.v.size)
    offset = (channel.start - grid.start) * grid.rate
    return drift < _SAME and abs(offset - round(offset)) < _SAME


def _on(channel: Series, grid: Series, begin: int, end: int) -> Series:
    """A channel at the instants `begin` to `end` of `grid`."""
    start = grid.start + begin / grid.rate
    if _in_step(channel, grid):
        first = begin - round((channel.start - grid.start) * grid.rate)
        return replace(channel, start=start, v=channel.v[first : first + end - begin])
    instants = start + np.arange(end - begin) / grid.rate
    return replace(channel, rate=grid.rate, start=start, v=_filtered(channel, grid, instants))


def _filtered(channel: Series, grid: Series, at: Reals) -> Reals:
    """The channel behind the low-pass filter at the times `at` [s]."""
    from scipy.signal import kaiser_beta
    from scipy.special import i0

    reach = _reach(channel, grid)
    beta = kaiser_beta(_RIPPLE)
    cut = 0.5 * (_PASS + _STOP) * grid.rate / channel.rate  # cycles per sample
    offsets = np.arange(-reach, reach + 1)
    place = (at - channel.start) * channel.rate
    middle = np.rint(place).astype(np.int64)
    filtered = np.empty(at.size)
    rows = max(_CHUNK // offsets.size, 1)
    for a in range(0, at.size, rows):
        part = slice(a, a + rows)
        index = middle[part, None] + offsets
        away = index - place[part, None]
        taper = i0(beta * np.sqrt(np.maximum(1.0 - (away / (reach + 0.5)) ** 2, 0.0)))
        weights = np.sinc(2.0 * cut * away) * taper
        filtered[part] = (channel.v[index] * weights).sum(axis=1) / weights.sum(axis=1)
    return filtered


def _reach(channel: Series, grid: Series) -> int:
    """Half the length of the filter [samples of the channel]."""
    from scipy.signal import kaiserord

    taps, _ = kaiserord(_RIPPLE, (_STOP - _PASS) * grid.rate / (0.5 * channel.rate))
    return int(taps) // 2 + 1
