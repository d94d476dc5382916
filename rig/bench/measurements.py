"""Every sample that the sensors of a stand have published, kept while it runs."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from rig.record.run import Samples
from sensors.bank import Bank


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
        """What each sensor published: times [ns], values."""
        self.take()
        return {
            name: Samples(instants.at(np.arange(self._count[i])), np.concatenate(self._taken[i]))
            for i, (name, instants) in enumerate(zip(self._bank.names, self._bank.instants))
        }
