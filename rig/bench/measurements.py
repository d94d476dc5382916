"""Every sample that the sensors of a plant runner have published, kept while it runs."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from rig.record.run import Samples
from rig.sensors.chain.bank import Bank


class Measurements:
    """The samples of a bank from t = 0 on. The bank holds the last ones; `take` them before it is filled up."""

    def __init__(self, bank: Bank) -> None:
        self._bank = bank
        self._taken: list[list[NDArray[np.float64]]] = [[] for _ in bank.names]
        self._count = [0] * len(bank.names)

    def take(self) -> None:
        """Keep what has been published since the last call."""
        for i, taken in enumerate(self._taken):
            new = self._bank.since(i, self._count[i])
            taken.append(new.copy())
            self._count[i] += len(new)

    def samples(self) -> dict[str, Samples]:
        """What each sensor published: times [ns], which sensors of one rate share, and values."""
        self.take()
        series = list(zip(self._bank.instants, self._count))
        times = {one: one[0].at(np.arange(one[1])) for one in set(series)}
        return {
            name: Samples(times[one], np.concatenate(taken))
            for name, one, taken in zip(self._bank.names, series, self._taken)
        }
