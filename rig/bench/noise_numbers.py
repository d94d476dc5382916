"""The random numbers of process noise (rig.effects.noise), drawn in advance."""

from __future__ import annotations

import numpy as np

from rig.effects.noise import SIGNAL
from rig.model.system import System
from rig.sensors.chain.streams import Stream
from rig.solve.random_input import DRAWN, PLACE, Chance

ROOM = 1 << 12
_NAME = "process noise"  # no instrument can have this name, since it has a space


class Numbers:
    """Standard normal numbers, one for each frame of a run; the compiled loop takes them from `record`.

    They depend only on the seed of the scene, not on sensors or other processes.
    """

    def __init__(self, system: System, seed: int) -> None:
        self.record = Chance(np.array([-1, ROOM]), np.zeros(ROOM))
        self._stream = Stream(seed, _NAME)
        self.find(system)

    def find(self, system: System) -> None:
        """Find the noise signal in `system`, if it has one, and make a number available for its next frame."""
        self.record.at[PLACE] = system.names.index(SIGNAL) if SIGNAL in system.names else -1
        self.fill()

    def fill(self) -> None:
        """Draw new numbers when all are used up."""
        if self.record.at[PLACE] >= 0 and self.record.at[DRAWN] == ROOM:
            self.record.numbers[:] = self._stream.noise(ROOM)
            self.record.at[DRAWN] = 0
