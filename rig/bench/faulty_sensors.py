"""Faults of sensors while a rig runs (rig.scenes.part_faults): what they make of samples.

A faulty sample depends on its number, on the true sample and on the one before it. So nothing has to be kept: a run
that continues from a checkpoint has the same bits.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from rig.sensors.chain.bank import Bank


class FaultySensors:
    """The faults of the sensors of `bank`, which `apply` puts into its latest samples after every frame."""

    def __init__(self, bank: Bank, faults: Mapping[str, Any], frame_ns: int) -> None:
        self._bank, self._faults = bank, []
        for fault in faults.values():
            i = bank.names.index(fault.sensor)
            instants = bank.instants[i]
            first, end = instants.count(fault.at - 1), None if fault.end is None else instants.count(fault.end - 1)
            if fault.kind == "spike" and end is None:
                end = first + 1
            begins = -(-instants.instant(first) // frame_ns)
            over = None if end is None else -(-instants.instant(max(end - 1, first)) // frame_ns)
            if end is None or end > first:
                self._faults.append((fault, i, first, end, begins, over))

    def ahead(self, tick: int) -> int | None:
        """Number of frames from `tick` on without a faulty sample; None if there is none any more."""
        found = [max(begins - 1 - tick, 0) for *_, begins, over in self._faults if over is None or over > tick]
        return min(found, default=None)

    def apply(self) -> None:
        """Make the samples faulty that the bank published in the last frame."""
        bank = self._bank
        for fault, i, first, end, _, _ in self._faults:
            number, samples = bank.first(i), bank.samples(i)
            low, high = max(first, number), number + len(samples) if end is None else min(end, number + len(samples))
            for k in range(low, high):
                before = float(bank.since(i, k - 1)[0]) if k else 0.0
                t = (bank.instants[i].instant(k) - fault.at) * 1e-9
                samples[k - number] = _faulty(fault, float(samples[k - number]), before, t)
            if high > low:
                bank.latest[i] = samples[-1]


def _faulty(fault: Any, value: float, before: float, t: float) -> float:
    """What a sensor reads in place of `value`, `t` [s] after the beginning of its fault; `before`: its last sample."""
    if fault.kind == "freeze":
        return before
    if fault.kind == "drift":
        return value + float(fault.rate) * t
    if fault.kind == "spike":
        return value + float(fault.height)
    return 0.0 if fault.kind == "dropout" else -value
