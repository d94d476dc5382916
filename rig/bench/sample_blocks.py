"""The samples of a sensor in blocks, as they are sent on the bus.

A block covers 20 ms; samples of slower sensors are sent one by one. A message for each sample of four sensors at 1 kHz
would cost 0.1 ms of every frame (measured: seven times as many late frames), and the step contains the latest samples
anyway.
"""

from __future__ import annotations

from heapq import heapify, heapreplace
from typing import Protocol

import numpy as np

from rig.bus import encode
from rig.bus.content_checks import TIMES_NS
from rig.bus.port import Session
from rig.bus.publisher import Publisher
from rig.bus.topics import BLOCK_NS
from rig.sensors.chain.instants import Instants


class Instruments(Protocol):
    """What is needed of a `rig.sensors.chain.bank.Bank`."""

    names: tuple[str, ...]
    instants: tuple[Instants, ...]

    def memory(self, i: int, number: int, most: int) -> memoryview:
        """At most `most` samples of instrument i from sample `number` on: a view, valid until they are dropped."""


class Lent:
    """Samples that wait in the memory of an instrument until they are encoded, so that the plant need not copy them."""

    __slots__ = ("_samples",)

    def __init__(self, samples: memoryview) -> None:
        self._samples: memoryview | None = samples

    def raw(self) -> bytes:
        """The bytes of the samples, once; called by the thread that encodes them."""
        while (samples := self._samples) is not None:
            raw = samples.tobytes()
            if self._samples is samples:  # else they were copied, because the memory is about to change: use the copy
                self._samples = None
                return raw
        return b""

    def keep(self) -> None:
        """Copy the samples unless they are encoded; called before their memory changes."""
        if (samples := self._samples) is not None:
            self._samples = memoryview(samples.tobytes())


class AllSamples:
    """The samples of all `instruments`, published in blocks on `session`."""

    def __init__(self, session: Session, instruments: Instruments) -> None:
        count = len(instruments.names)
        self._lent: list[Lent] = []
        self._blocks = [
            SampleBlocks(instruments, i, session.publisher(f"meas/{name}"), self._lent, (i + 1) / count)
            for i, name in enumerate(instruments.names)
        ]
        self._full = [(blocks.full_ns(), i) for i, blocks in enumerate(self._blocks)] or [(TIMES_NS, -1)]
        """Heap of the times at which blocks are full [ns], with their instruments."""
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
        """Collect the samples up to `t_ns`, and copy those not sent yet: the instruments are about to drop them."""
        for blocks in self._blocks:
            blocks.collect(tick, t_ns)
        for lent in self._lent:
            lent.keep()
        self._lent.clear()

    def put_rest(self, tick: int, t_ns: int) -> None:
        """Publish the blocks that are not full, at the end of a run."""
        for blocks in self._blocks:
            blocks.put(tick, t_ns)


class SampleBlocks:
    """The samples of instrument `i`, collected until a block is full, which `publisher` then sends.

    What is collected is added to `lent`. `share`: the length of the first block as a share of the others. With
    different shares the blocks of many instruments are not full in the same frame.
    """

    def __init__(
        self, instruments: Instruments, i: int, publisher: Publisher, lent: list[Lent], share: float = 1.0
    ) -> None:
        self._i, self._memory, self._publisher, self._lent = i, instruments.memory, publisher, lent
        self._instants = instants = instruments.instants[i]
        self._even, self._period_ns = instants.even, round(instants.period_ns)
        self._whole = max(BLOCK_NS // self._period_ns, 1)
        self._size = max(round(share * self._whole), 1)
        self._kept: list[Lent] = []
        self._first = self._next = 0
        """Numbers of the first sample of the present block, and of the first that is not collected yet."""

    def full_ns(self) -> int:
        """Time at which the last sample of the present block is published [ns]."""
        last = self._first + self._size - 1
        return last * self._period_ns if self._even else self._instants.instant(last)

    def collect(self, tick: int, t_ns: int) -> None:
        """Collect the samples that were published up to `t_ns` since the last call; publishes the block if it is full.

        The instruments may have published more: those of later frames.
        """
        end = t_ns // self._period_ns + 1 if self._even else self._instants.count(t_ns)
        if end > self._next and (new := len(samples := self._memory(self._i, self._next, end - self._next))):
            lent = Lent(samples)
            self._lent.append(lent)
            self._kept.append(lent)
            self._next += new
            if self._next - self._first >= self._size:
                self.put(tick, t_ns)

    def put(self, tick: int, t_ns: int) -> None:
        """Publish at `t_ns` what has been collected, if anything; another thread encodes it later."""
        if kept := self._kept:
            self._publisher.put_later(t_ns, _encoded, tick, self._instants, self._period_ns, self._first, kept)
            self._kept, self._first, self._size = [], self._next, self._whole


def _encoded(tick: int, instants: Instants, period_ns: int, first: int, kept: list[Lent]) -> bytes:
    raw = b"".join([samples.raw() for samples in kept])
    times = None if instants.even else instants.at(np.arange(first, first + len(raw) // 8))
    return encode.block(tick, instants.instant(first), period_ns, raw, times)
