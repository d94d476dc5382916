"""Faulty sensors of a run: the samples that broken instruments publish in place of the true ones."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from rig.sensors.chain.bank import Bank


class FaultySensors:
    """The faults of the sensors of `bank`, which `apply` puts into its latest samples after every frame.

    A faulty sample depends on its number, on the true sample and on the one before it. So nothing has to be kept: a run
    that continues from a checkpoint has the same bits.
    """

    def __init__(self, bank: Bank, faults: Mapping[str, Any], frame_ns: int) -> None:
        self._bank = bank
        self._faults = []
        for fault in faults.values():
            i = bank.names.index(fault.sensor)
            instants = bank.instants[i]
            first = instants.count(fault.at - 1)
            end = None if fault.end is None else instants.count(fault.end - 1)
            if fault.kind == "spike" and end is None:
                end = first + 1
            begins = -(-instants.instant(first) // frame_ns)
            over = None if end is None else -(-instants.instant(max(end - 1, first)) // frame_ns)
            if end is None or end > first:
                self._faults.append((fault, i, first, end, begins, over))

    def ahead(self, tick: int) -> int | None:
        """Number of frames from `tick` on without a faulty sample; None if there is none any more."""
        left = []
        for *_, begins, over in self._faults:
            if over is None or over > tick:
                left.append(max(begins - 1 - tick, 0))
        return min(left, default=None)

    def apply(self) -> None:
        """Make the samples faulty that the bank published in the last frame."""
        bank = self._bank
        for fault, i, first, end, _, _ in self._faults:
            number = bank.first(i)
            samples = bank.samples(i)
            low = max(first, number)
            high = number + len(samples)
            if end is not None:
                high = min(end, high)
            for k in range(low, high):
                before = float(bank.since(i, k - 1)[0]) if k else 0.0
                t = (bank.instants[i].instant(k) - fault.at) * 1e-9
                samples[k - number] = _faulty(fault, float(samples[k - number]), before, t)
            if high > low:
                bank.latest[i] = samples[-1]


def _faulty(fault: Any, value: float, before: float, t: float) -> float:
    """What a sensor reads in place of `value`, `t` [s] after the beginning of its fault; `before`: its last sample."""
    if fault.kind in ("drift", "spike"):
        return value + float(fault.rate * t if fault.kind == "drift" else fault.height)
    return {"freeze": before, "dropout": 0.0, "wrong_sign": -value}[fault.kind]
