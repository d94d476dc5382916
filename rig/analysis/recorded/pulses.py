"""Pulses of an input, such as blows of a hammer: where their windows begin, and the force window.

A line is subtracted first, because force transducers drift. An input is a sequence of pulses if it then exceeds a level
in at most a twentieth of its samples. The level is a tenth of the largest value, or six standard deviations of the
noise (from the median of the magnitudes) if these are more; it must be below half of the largest value.

Between its pulses the input is zero: the force window replaces what the transducer reads there, noise and drift.
Source: D. J. Ewins, Modal Testing, 2nd edition, 2000, chapter 3.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from rig.record.run import Integers, Reals

_LOUD = 0.1  # share of the largest value: a pulse exceeds it
_NOISE = 6.0  # standard deviations of the noise: a pulse exceeds these too
_CLEAR = 0.5  # share of the largest value: with a level above it noise hides the pulses
_RARE = 0.05  # share of the samples: an input that is above the level more often is no sequence of pulses
_NORMAL = 1.4826  # standard deviation over median magnitude, of normal noise
_SAMPLES_BESIDE = 4  # samples before and after a pulse, at least; and at least twice its length


class Pulses(NamedTuple):
    """Pulses in order of time: [n] sample at which the window of each begins, and the sample after the pulse."""

    begins: Integers
    ends: Integers


def pulses(x: Reals) -> Pulses | None:
    """Return the pulses of `x` (NaN: missing); None if it is not a sequence of pulses."""
    at = np.flatnonzero(np.isfinite(x))
    away = np.zeros(x.size)
    away[at] = x[at] - np.polyval(np.polyfit(at, x[at], 1), at)
    away[at] = np.abs(away[at] - np.median(away[at]))
    top = float(away.max())
    level = max(_LOUD * top, _NOISE * _NORMAL * float(np.median(away[at])))
    loud = away > level
    if not loud.any() or level > _CLEAR * top or loud.mean() > _RARE:
        return None
    first, last = np.flatnonzero(np.diff(np.concatenate(([False], loud, [False])))).reshape(-1, 2).T
    beside = max(2 * int((last - first).max()), _SAMPLES_BESIDE)
    apart = first[1:] - last[:-1] > 2 * beside  # not the bounce of one pulse
    begins = first[np.concatenate(([True], apart))] - beside
    ends = last[np.concatenate((apart, [True]))] + beside
    return Pulses(np.maximum(begins, 0), np.minimum(ends, x.size))


def force_window(x: Reals, blows: Pulses, count: int) -> Reals:
    """Return `x` without its baseline in the pulses and zero between them, in the windows of `count` samples.

    The baseline is the line through the samples of the window that follow the pulse.
    """
    force = np.zeros(x.size)
    for begin, end in zip(blows.begins.tolist(), blows.ends.tolist()):
        at = np.arange(end, min(begin + count, x.size))
        at = at[np.isfinite(x[at])]
        line = np.polyfit(at - begin, x[at], 1) if at.size > 1 else np.zeros(2)
        force[begin:end] = x[begin:end] - np.polyval(line, np.arange(end - begin))
    return force
