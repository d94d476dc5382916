"""The random numbers of process noise (rig.effects.noise), drawn ahead."""

from __future__ import annotations

import numpy as np

from rig.effects.noise import SIGNAL
from rig.model.system import System
from rig.sensors.chain.streams import Stream
from rig.solve.random_input import DRAWN, PLACE, Chance

ROOM = 1 << 12
_NAME = "process noise"  # no instrument has this name, as it is not one word


class Numbers:
    """Standard normal numbers, one for each frame of a run; `record` is what the compiled loop takes them from.

    They depend on the seed of the scene alone, not on who listens or on the sensors.
    """

    def __init__(self, system: System, seed: int) -> None:
        self.record = Chance(np.array([-1, ROOM]), np.zeros(ROOM))
        self._stream = Stream(seed, _NAME)
        self.find(system)

    def find(self, system: System) -> None:
        """Look where `system` has the signal, if it has one: its next frame has a number."""
        self.record.at[PLACE] = system.names.index(SIGNAL) if SIGNAL in system.names else -1
        self.fill()

    def fill(self) -> None:
        """Draw anew where all are used up."""
        if self.record.at[PLACE] >= 0 and self.record.at[DRAWN] == ROOM:
            self.record.numbers[:] = self._stream.noise(ROOM)
            self.record.at[DRAWN] = 0
