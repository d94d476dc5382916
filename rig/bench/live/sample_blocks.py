"""The samples of a sensor in blocks, as they are sent on the bus.

A block covers 20 ms; samples of slower sensors are sent one by one. A message for each sample of four sensors at 1 kHz
would cost 0.1 ms of every frame (measured: seven times as many late frames), and the step contains the latest samples
anyway.
"""

from __future__ import annotations

from heapq import heapify, heapreplace

import numpy as np

from rig.bus import encode
from rig.bus.inbound import TIMES_NS
from rig.bus.port import Session
from rig.bus.publishers import Publisher
from rig.bus.topics import BLOCK_NS
from rig.sensors.chain.bank import Bank
from rig.sensors.chain.instants import Instants


class AllSamples:
    """The samples of all `instruments`, published in blocks on `session`."""

    def __init__(self, session: Session, instruments: Bank) -> None:
        count = len(instruments.names)
        self._blocks = [
            SampleBlocks(instruments, i, session.publisher(f"meas/{name}"), (i + 1) / count)
            for i, name in enumerate(instruments.names)
        ]
        # Heap of the times at which blocks are full [ns], with their instruments.
        self._full = [(blocks.full_ns(), i) for i, blocks in enumerate(self._blocks)] or [(TIMES_NS, -1)]
        heapify(self._full)

    @property
    def full_ns(self) -> int:
        """Time at which the next block is full [ns]."""
        return self._full[0][0]

    def gather(self, tick: int, t_ns: int) -> None:
        """Publish the blocks that are full at `tick`, which is at `t_ns`."""
        full = self._full
        while full[0][0] <= t_ns:
            i = full[0][1]
            blocks = self._blocks[i]
            blocks.collect(tick, t_ns)
            heapreplace(full, (blocks.full_ns(), i))

    def collect(self, tick: int, t_ns: int) -> None:
        """Collect the samples up to `t_ns`: the instruments are about to drop them."""
        for blocks in self._blocks:
            blocks.collect(tick, t_ns)

    def put_rest(self, tick: int, t_ns: int) -> None:
        """Publish the blocks that are not full, at the end of a run."""
        for blocks in self._blocks:
            blocks.put(tick, t_ns)


class SampleBlocks:
    """The samples of instrument `i`, collected until a block is full, which `publisher` then sends.

    `share`: the length of the first block as a share of the others. With different shares the blocks of many
    instruments are not full in the same frame.
    """

    def __init__(self, instruments: Bank, i: int, publisher: Publisher, share: float = 1.0) -> None:
        self._i = i
        self._memory = instruments.memory
        self._publisher = publisher
        self._instants = instants = instruments.instants[i]
        self._even = instants.even
        self._period_ns = round(instants.period_ns)
        self._whole = max(BLOCK_NS // self._period_ns, 1)
        self._size = max(round(share * self._whole), 1)
        self._kept: list[bytes] = []
        # Numbers of the first sample of the present block, and of the first that is not collected yet.
        self._first = self._next = 0

    def full_ns(self) -> int:
        """Time at which the last sample of the present block is published [ns]."""
        last = self._first + self._size - 1
        return last * self._period_ns if self._even else self._instants.instant(last)

    def collect(self, tick: int, t_ns: int) -> None:
        """Collect the samples that were published up to `t_ns` since the last call; publishes the block if it is full.

        The instruments may have published more: those of later frames.
        """
        end = t_ns // self._period_ns + 1 if self._even else self._instants.count(t_ns)
        if end <= self._next:
            return
        samples = self._memory(self._i, self._next, end - self._next)
        if len(samples):
            self._kept.append(samples.tobytes())
            self._next += len(samples)
            if self._next - self._first >= self._size:
                self.put(tick, t_ns)

    def put(self, tick: int, t_ns: int) -> None:
        """Publish at `t_ns` what has been collected, if anything; another thread encodes it later."""
        if kept := self._kept:
            self._publisher.put_later(t_ns, _encoded, tick, self._instants, self._period_ns, self._first, kept)
            self._kept = []
            self._first = self._next
            self._size = self._whole


def _encoded(tick: int, instants: Instants, period_ns: int, first: int, kept: list[bytes]) -> bytes:
    raw = b"".join(kept)
    times = None if instants.even else instants.at(np.arange(first, first + len(raw) // 8))
    return encode.block(tick, instants.instant(first), period_ns, raw, times)
