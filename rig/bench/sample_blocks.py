"""The samples of a sensor in blocks, as they are sent on the bus.

A block covers 20 ms; samples of slower sensors are sent one by one. A message for each sample of four sensors at 1 kHz
would cost 0.1 ms of every frame (measured: seven times as many late frames), and the step contains the latest samples
anyway.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import partial

import numpy as np
from numpy.typing import NDArray

from rig.bus import encode
from rig.bus.topics import BLOCK_NS
from rig.sensors.chain.instants import Instants


class SampleBlocks:
    """The samples of one sensor, collected until a block is full.

    `share`: the length of the first block as a share of the others. With different shares the blocks of many sensors
    are not full in the same frame.
    """

    def __init__(self, instants: Instants, share: float = 1.0) -> None:
        self._instants = instants
        self._period_ns = round(instants.period_ns)
        self._whole = max(BLOCK_NS // self._period_ns, 1)
        self._size = max(round(share * self._whole), 1)
        self._kept: list[NDArray[np.float64]] = []
        self._count, self._first = 0, 0
        self.next = 0
        """Index of the first sample that is not collected yet."""

    def full_ns(self) -> int:
        """Time at which the last sample of the present block is published [ns]."""
        first = self._first if self._count else self.next
        return self._instants.instant(first + self._size - 1)

    def published(self, t_ns: int) -> int:
        """Number of samples that are published up to `t_ns` but not collected yet."""
        return max(self._instants.count(t_ns) - self.next, 0)

    def add(self, tick: int, samples: NDArray[np.float64]) -> Callable[[], bytes] | None:
        """Add the next samples; returns the function that encodes the block if it is full."""
        if not self._count:
            self._first = self.next
        self._kept.append(samples.copy())
        self._count += len(samples)
        self.next += len(samples)
        return self.block(tick) if self._count >= self._size else None

    def block(self, tick: int) -> Callable[[], bytes] | None:
        """The function that encodes as a Block what has been collected; None if nothing."""
        if not self._count:
            return None
        found = partial(_encoded, tick, self._instants, self._period_ns, self._first, self._kept)
        self._kept, self._count, self._size = [], 0, self._whole
        return found


def _encoded(tick: int, instants: Instants, period_ns: int, first: int, kept: list[NDArray[np.float64]]) -> bytes:
    gathered = kept[0] if len(kept) == 1 else np.concatenate(kept)
    times = None if instants.even else instants.at(np.arange(first, first + gathered.size))
    return encode.block(tick, instants.instant(first), period_ns, gathered, times)
