"""All measurements of the sensors of a plant runner, collected while it runs.

They are kept in rows of numbers that grow without a copy of what is written to them.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from rig.record.run import Samples
from rig.sensors.chain.bank import Bank

LEAST = 1 << 12
MOST = 1 << 21
"""Limits of the columns for which there is room at first. When it is used up, it is doubled."""


class GrowingRows:
    """An array [row, column] of a type, to which columns are appended. `expected`: about how many.

    New memory costs more than what is written to it: it is touched once if the number is known.
    """

    def __init__(self, rows: int, kind: Any, expected: int) -> None:
        self._whole: NDArray[Any] = np.empty((rows, min(max(expected, LEAST), MOST)), dtype=kind)
        self.count = 0
        """Number of columns so far."""

    def append(self, columns: int) -> tuple[NDArray[Any], int]:
        """Append columns and return the array, which the caller fills, and the first new column."""
        first = self.count
        self.count += columns
        if self.count > self._whole.shape[1]:
            larger = np.empty((len(self._whole), max(2 * self._whole.shape[1], self.count)), dtype=self._whole.dtype)
            larger[:, :first] = self._whole[:, :first]
            self._whole = larger
        return self._whole, first

    def all(self) -> NDArray[Any]:
        """All columns so far: a view, each row of which is contiguous."""
        return self._whole[:, : self.count]


class Measurements:
    """The samples of a sensor bank from t = 0 on. The bank keeps only the last ones; call `take` before it is full.

    `length_ns`: about how long the run will be.
    """

    def __init__(self, bank: Bank, length_ns: int) -> None:
        self._bank = bank
        self._taken = [GrowingRows(1, np.float64, instants.count(length_ns)) for instants in bank.instants]

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
        times = {times_of: times_of[0].at(np.arange(times_of[1])) for times_of in set(series)}
        return {
            name: Samples(times[key], taken.all()[0]) for name, key, taken in zip(self._bank.names, series, self._taken)
        }
