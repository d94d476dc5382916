"""The random numbers of process noise (rig.effects.noise), drawn in advance."""

from __future__ import annotations

import numpy as np

from rig.effects.noise import SIGNAL
from rig.model.system import System
from rig.sensors.chain.streams import Stream
from rig.solve.random_input import DRAWN, PLACE, RandomNumbers

ROOM = 1 << 12
_NAME = "process noise"  # no instrument can have this name, since it has a space


class Numbers:
    """Standard normal numbers, one for each frame of a run; the compiled loop takes them from `record`.

    They depend only on the seed of the scene, not on sensors or other processes.
    """

    def __init__(self, system: System, seed: int) -> None:
        self.record = RandomNumbers(np.array([-1, ROOM]), np.zeros(ROOM))
        self.seed, self._stream = seed, Stream(seed, _NAME)
        self.find(system)

    def find(self, system: System) -> None:
        """Find the noise signal in `system`, if it has one, and make a number available for its next frame."""
        self.record.at[PLACE] = system.names.index(SIGNAL) if SIGNAL in system.names else -1
        self.fill()

    def fill(self) -> None:
        """Draw new numbers when all are used up."""
        if self.record.at[PLACE] >= 0 and self.record.at[DRAWN] == ROOM:
            self._stream.noise(self.record.numbers)
            self.record.at[DRAWN] = 0

    @property
    def used(self) -> int:
        """How many numbers have been used so far."""
        return self._stream.drawn[0] - (ROOM - int(self.record.at[DRAWN]))

    def resume(self, used: int) -> None:
        """Continue after the first `used` numbers."""
        self._stream = Stream(self.seed, _NAME)
        self._stream.skip(used)
        self.record.at[DRAWN] = ROOM
        self.fill()
