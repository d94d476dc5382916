"""The extremes of steps and samples in spans of time, so that a squeal is a band and not an alias.

Curves show the lowest and highest values of all steps and samples in spans of 1 ms or more, and gaps where messages
were lost. The viewer and the page of rig.web show the same spans.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from rig.bus import messages

Reals = NDArray[np.float64]
Integers = NDArray[np.int64]


class Spans(NamedTuple):
    """Extremes in spans of time, each of which begins where the one before ends, the first one at `begin_ns`.

    A span of which nothing is known has NaN as values, and no bits.
    """

    begin_ns: int
    ends_ns: Integers
    low: Reals
    """[name, span]"""
    high: Reals
    bits: Integers
    """Modes of a contact [contact, span], a bit for each."""

    def line(self, row: int) -> tuple[Integers, Reals]:
        """Times [ns] and values of a line that fills the band between the extremes of a name; NaN in gaps."""
        low = self.low[row]
        high = self.high[row]
        if not (low < high).any():
            return self.ends_ns, low
        begins = np.concatenate(([self.begin_ns], self.ends_ns[:-1]))
        middles = (begins + self.ends_ns) // 2
        falls = np.diff(low + high, prepend=low[0] + high[0]) < 0.0
        first = np.where(falls, high, low)
        second = np.where(falls, low, high)
        times = np.stack((middles, self.ends_ns), axis=1)
        return times.ravel(), np.stack((first, second), axis=1).ravel()


def joined(begin_ns: Integers, end_ns: Integers, low: Reals, high: Reals, bits: Integers, most: int) -> Spans:
    """Spans [name, span] joined to about `most`, but not over a gap, which becomes a span of its own."""
    count = end_ns.size
    begins_run = np.flatnonzero(begin_ns[1:] > end_ns[:-1]) + 1
    run = np.zeros(count, np.int64)
    run[begins_run] = begins_run
    place_in_run = np.arange(count) - np.maximum.accumulate(run)
    together = -(-count // most)
    first = np.flatnonzero(place_in_run % together == 0)
    last = np.append(first[1:], count) - 1
    gaps = np.flatnonzero(np.isin(first, begins_run))
    low = np.fmin.reduceat(low, first, axis=1)
    high = np.fmax.reduceat(high, first, axis=1)
    bits = np.bitwise_or.reduceat(bits, first, axis=1)
    return Spans(
        begin_ns=int(begin_ns[0]),
        ends_ns=np.insert(end_ns[last], gaps, begin_ns[first[gaps]]),
        low=np.insert(low, gaps, math.nan, axis=1),
        high=np.insert(high, gaps, math.nan, axis=1),
        bits=np.insert(bits, gaps, 0, axis=1),
    )


def of_steps(bands: Sequence[Any], outputs: int, modes: Callable[[Integers], Integers], most: int) -> Spans:
    """The extremes in messages `band`; `modes(keys)`: index of the mode [contact, key] in mode sets."""
    begin_ns = np.concatenate([[band.t0_ns, *band.ends_ns[:-1]] for band in bands])
    end_ns = np.concatenate([band.ends_ns for band in bands])
    low = np.concatenate([np.reshape(band.low, (-1, outputs)) for band in bands]).T
    high = np.concatenate([np.reshape(band.high, (-1, outputs)) for band in bands]).T
    met = modes(np.concatenate([band.modes for band in bands]).astype(np.int64))
    counts = np.concatenate([band.counts for band in bands])
    bits = np.bitwise_or.reduceat(1 << met, np.cumsum(counts) - counts, axis=1)
    return joined(begin_ns, end_ns, low, high, bits, most)


def of_samples(blocks: Sequence[Any], period_ns: int, before_ns: int | None, most: int) -> Spans:
    """The extremes of the samples in blocks; `before_ns`: time of the sample before them, if it has arrived."""
    t_ns = np.concatenate([messages.times(block) for block in blocks])
    v = np.concatenate([np.array(block.v, np.float64) for block in blocks])[None, :]
    if before_ns is None:
        before_ns = int(t_ns[0]) - period_ns
    begin_ns = np.concatenate([[before_ns], t_ns[:-1]])
    lost = t_ns - begin_ns > 1.5 * period_ns
    begin_ns[lost] = t_ns[lost] - period_ns
    return joined(begin_ns, t_ns, v, v, np.zeros(v.shape, np.int64), most)


class Steps(NamedTuple):
    """The latest steps of a plant for its phase portrait, none left out, the last one at `end_ns`."""

    end_ns: int
    step_ns: int
    x: Reals
    v: Reals
    keys: Integers
    """Number of the mode set."""


def latest(bands: Sequence[Any], most: int) -> Steps | None:
    """The last steps among messages `band` that follow one another; None if the rig has no phase portrait."""
    taken: list[Any] = []
    begin_ns = bands[-1].ends_ns[-1]
    count = 0
    for band in reversed(bands):
        if count < most and band.ends_ns[-1] == begin_ns:
            taken.insert(0, band)
            steps = len(band.pair_modes)
            count += steps
            begin_ns -= steps * band.step_ns
    if not count:
        return None
    pairs = np.concatenate([np.reshape(band.pair, (-1, 2)) for band in taken])
    x, v = pairs[-most:].T
    keys = np.concatenate([band.pair_modes for band in taken]).astype(np.int64)[-most:]
    return Steps(int(bands[-1].ends_ns[-1]), int(bands[-1].step_ns), x, v, keys)
