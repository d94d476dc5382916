"""All measurements of the sensors of a plant runner, collected while it runs."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from rig.record.run import Samples
from rig.sensors.chain.bank import Bank


class Measurements:
    """The samples of a sensor bank from t = 0 on. The bank keeps only the last ones; call `take` before it is full."""

    def __init__(self, bank: Bank) -> None:
        self._bank = bank
        self._taken: list[list[NDArray[np.float64]]] = [[] for _ in bank.names]
        self._count = [0] * len(bank.names)

    def take(self) -> None:
        """Keep the samples published since the last call."""
        for i, taken in enumerate(self._taken):
            new = self._bank.since(i, self._count[i])
            taken.append(new.copy())
            self._count[i] += len(new)

    def samples(self) -> dict[str, Samples]:
        """Sensor -> its samples: times [ns], one shared array for sensors of the same rate, and values."""
        self.take()
        series = list(zip(self._bank.instants, self._count))
        times = {one: one[0].at(np.arange(one[1])) for one in set(series)}
        return {
            name: Samples(times[one], np.concatenate(taken))
            for name, one, taken in zip(self._bank.names, series, self._taken)
        }
