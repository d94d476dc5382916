"""All measurements of the sensors of a plant runner, collected while it runs."""

from __future__ import annotations

import numpy as np

from rig.bench.growing_rows import GrowingRows
from rig.record.run import Samples
from rig.sensors.chain.bank import Bank


class Measurements:
    """The samples of a sensor bank from t = 0 on. The bank keeps only the last ones; call `take` before it is full.

    `length_ns`: about how long the run will be.
    """

    def __init__(self, bank: Bank, length_ns: int) -> None:
        self._bank = bank
        self._taken = [GrowingRows(1, np.float64, one.count(length_ns)) for one in bank.instants]

    def take(self) -> None:
        """Keep the samples published since the last call."""
        for i, taken in enumerate(self._taken):
            new = self._bank.since(i, taken.count)
            rows, first = taken.append(len(new))
            rows[0, first : first + len(new)] = new

    def samples(self) -> dict[str, Samples]:
        """Sensor -> its samples: times [ns], one shared array for sensors of the same rate, and values."""
        self.take()
        series = [(instants, taken.count) for instants, taken in zip(self._bank.instants, self._taken)]
        times = {one: one[0].at(np.arange(one[1])) for one in set(series)}
        return {
            name: Samples(times[one], taken.all()[0]) for name, one, taken in zip(self._bank.names, series, self._taken)
        }
