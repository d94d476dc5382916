"""Samples at even times: their places on the grid, the gaps between them, and short gaps bridged by straight lines."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from rig.errors import UsageError
from rig.record.run_data import Integers, Reals, Samples

BRIDGED = 4  # samples: the longest gap that a line bridges
_UNEVEN = 0.01  # of a period: times are rounded to nanoseconds, and a period is 1 us at least


@dataclass(frozen=True)
class Grid:
    """Samples `v` [n] every `period_ns`, at `t_ns` [n]; missing ones are NaN, their times are computed."""

    t_ns: Integers
    v: Reals
    period_ns: float

    @property
    def rate(self) -> float:
        """Samples per second [Hz]."""
        return 1e9 / self.period_ns


def places(t_ns: Integers) -> Integers:
    """Return the index of each sample from its time [ns], the first being 0; samples may be missing, times are
    rounded.
    """
    gaps = np.diff(t_ns)
    if not gaps.size:
        return np.zeros(t_ns.size, np.int64)
    period = gaps[gaps < 1.5 * gaps.min()].mean()
    return np.concatenate([[0], np.cumsum(np.rint(gaps / period))]).astype(np.int64)


def period(t_ns: Integers) -> float:
    """Return the time between two samples [ns]; 0 for less than two, and for times that do not increase."""
    return float(t_ns[-1] - t_ns[0]) / float(places(t_ns)[-1]) if t_ns.size > 1 and increasing(t_ns) else 0.0


def increasing(t_ns: Integers) -> bool:
    """Return whether each time is later than the one before."""
    return bool((np.diff(t_ns) > 0).all())


def grid(name: str, samples: Samples) -> Grid:
    """Return the samples of `name` on their grid. Raises UsageError for less than two, and for times that are
    uneven or do not increase.
    """
    t_ns, v = samples
    if t_ns.size < 2:
        count = f"{t_ns.size} sample{'s' * (t_ns.size != 1)}"
        raise UsageError(f"{name}: the recording has {count} of it; a rate needs at least two")
    if not increasing(t_ns):
        raise UsageError(f"{name}: its times do not increase; export it without --rate, and not as wav")
    at, step = places(t_ns), period(t_ns)
    if np.abs(t_ns - t_ns[0] - at * step).max() > _UNEVEN * step:
        raise UsageError(f"{name}: its times are not evenly spaced; export it without --rate, and not as wav")
    times = t_ns[0] + np.rint(np.arange(at[-1] + 1) * step).astype(np.int64)
    times[at] = t_ns
    values = np.full(times.size, np.nan)
    values[at] = v
    return Grid(times, values, step)


def gaps(v: Reals) -> list[tuple[int, int]]:
    """Return the gaps: index of the first missing (not finite) sample and of the sample after the last one."""
    edges = np.flatnonzero(np.diff(np.concatenate(([False], ~np.isfinite(v), [False]))))
    return [(int(a), int(b)) for a, b in edges.reshape(-1, 2)]


def bridge(v: Reals) -> tuple[Reals, int]:
    """Interpolate gaps of up to `BRIDGED` samples linearly; return the samples and the number of interpolated ones."""
    v, count = v.copy(), 0
    known = np.flatnonzero(np.isfinite(v))
    values = v[known]
    for a, b in gaps(v):
        if b - a <= BRIDGED and 0 < a and b < v.size:
            v[a:b] = np.interp(np.arange(a, b), known, values)
            count += b - a
    return v, count
