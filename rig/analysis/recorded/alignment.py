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

_PASS, _STOP, _RIPPLE = 0.4, 0.6, 80.0  # shares of the rate of the grid; decibels
_SAME = 1e-3  # of a sample: instants that are this close are the same
_CHUNK = 1 << 21


def aligned(channels: Sequence[Series]) -> tuple[list[Series], float]:
    """Return the channels at common instants, and the frequency [Hz] up to which their spectra hold.

    A sample that depends on a missing one is missing (NaN). Raises UsageError if the channels share less than two
    instants.
    """
    grid = min(channels, key=lambda one: one.rate)
    spans = [_span(one, grid) for one in channels]
    begin, end = max(low for low, _ in spans), min(high for _, high in spans)
    if end - begin < 2:
        names = ", ".join(one.name for one in channels)
        raise UsageError(f"{names}: the time that they share is too short; take a longer range of time")
    whole = all(_in_step(one, grid) for one in channels)
    found = [_on(one, grid, begin, end) for one in channels]
    return found, (0.5 if whole else _PASS) * grid.rate


def _in_step(one: Series, grid: Series) -> bool:
    """Whether a channel is sampled at the instants of `grid`."""
    drift = abs(one.rate / grid.rate - 1.0) * max(one.v.size, grid.v.size)
    offset = (one.start - grid.start) * grid.rate
    return drift < _SAME and abs(offset - round(offset)) < _SAME


def _span(one: Series, grid: Series) -> tuple[int, int]:
    """The instants of `grid` at which a channel can be evaluated: the first, and the one after the last."""
    first = (one.start - grid.start) * grid.rate
    if _in_step(one, grid):
        return round(first), round(first) + one.v.size
    reach = _reach(one, grid)
    last = first + (one.v.size - 1 - reach) * grid.rate / one.rate
    return math.ceil(first + reach * grid.rate / one.rate), math.floor(last) + 1


def _on(one: Series, grid: Series, begin: int, end: int) -> Series:
    """A channel at the instants `begin` to `end` of `grid`."""
    start = grid.start + begin / grid.rate
    if _in_step(one, grid):
        first = begin - round((one.start - grid.start) * grid.rate)
        return replace(one, start=start, v=one.v[first : first + end - begin])
    return replace(one, rate=grid.rate, start=start, v=_filtered(one, grid, start + np.arange(end - begin) / grid.rate))


def _reach(one: Series, grid: Series) -> int:
    """Half the length of the filter [samples of the channel]."""
    from scipy.signal import kaiserord

    taps, _ = kaiserord(_RIPPLE, (_STOP - _PASS) * grid.rate / (0.5 * one.rate))
    return int(taps) // 2 + 1


def _filtered(one: Series, grid: Series, at: Reals) -> Reals:
    """The channel behind the low-pass filter at the times `at` [s]."""
    from scipy.signal import kaiser_beta
    from scipy.special import i0

    reach, beta = _reach(one, grid), kaiser_beta(_RIPPLE)
    cut = 0.5 * (_PASS + _STOP) * grid.rate / one.rate  # cycles per sample
    offsets = np.arange(-reach, reach + 1)
    place = (at - one.start) * one.rate
    middle = np.rint(place).astype(np.int64)
    made = np.empty(at.size)
    rows = max(_CHUNK // offsets.size, 1)
    for a in range(0, at.size, rows):
        part = slice(a, a + rows)
        index = middle[part, None] + offsets
        away = index - place[part, None]
        weights = np.sinc(2.0 * cut * away) * i0(beta * np.sqrt(np.maximum(1.0 - (away / (reach + 0.5)) ** 2, 0.0)))
        made[part] = (one.v[index] * weights).sum(axis=1) / weights.sum(axis=1)
    return made
