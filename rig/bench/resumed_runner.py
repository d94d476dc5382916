"""A plant runner that continues a recorded run from one of its checkpoints.

Up to the checkpoint nothing is integrated: the instruments publish the recorded samples, and recorded commands count as
put into force at their ticks. So protocol, exchange and controllers do what they did and are in the state in which they
were. At the checkpoint plant and instruments take the recorded state, and from there on they are simulated.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import NamedTuple

import numpy as np

from rig.bench.checkpoint import unpacked
from rig.bench.heard import ROOM
from rig.bench.runner import PlantRunner
from rig.record.run import Samples
from rig.scenes.scene import Scene
from rig.solve.control_loop import ANSWERED, AS, COUNT, DUE, FOR, STATUS, TICK


class Resumption(NamedTuple):
    """A checkpoint at `tick`, and the recorded samples of each sensor, all of them up to there."""

    tick: int
    checkpoint: bytes
    measurements: Mapping[str, Samples]


class ResumedRunner(PlantRunner):
    """The plant of `scene`, which is simulated from a checkpoint on, in a run of `frames` frames.

    Raises ValueError or KeyError at the checkpoint if it is one of another rig, LogError if it cannot be read.
    """

    def __init__(self, scene: Scene, resumption: Resumption, frames: int) -> None:
        super().__init__(scene, truthful=True, piece=frames)
        self._resumption = resumption
        self._recorded = [resumption.measurements[name] for name in self.bank.names]
        self.state_samples.begin(resumption.tick, resumption.tick * self.frame_ns * 1e-9)

    def frames(self, most: int) -> None:
        """Play recorded samples up to the checkpoint; simulate from there on. See `PlantRunner.frames`."""
        left = self._resumption.tick - self.tick
        if left <= 0:
            super().frames(most)
            return
        count = min(most, left, self.bank.playable, ROOM)
        self.read_samples()
        self._put_into_force(self.tick + count)
        self.tick += count
        self.bank.play(self._recorded, self.t_ns)
        self._look = False
        if count == left:
            self.read_samples()
            self.resume(unpacked(self._resumption.checkpoint))

    def checkpoint(self) -> bytes:
        """See `PlantRunner.checkpoint`; empty before the own checkpoint, where plant and instruments have no state."""
        return super().checkpoint() if self.tick > self._resumption.tick else b""

    def _put_into_force(self, end: int) -> None:
        """Do what the compiled loop does with the recorded commands lent to it that are due before tick `end`."""
        controls = self.controllers
        for i in range(controls.clock[COUNT]):
            line = controls.controllers[i]
            first = int(line["oldest"])
            waiting = controls.queue[i, first : first + int(line["waiting"])]
            count = int(np.searchsorted(waiting[:, DUE], end))
            for column, of in ((TICK, DUE), (FOR, ANSWERED), (STATUS, AS)):
                controls.rows[i, :count, column] = waiting[:count, of]
            drives = slice(int(line["drives"]), int(line["driven"]))
            controls.values[:count, drives] = controls.queued[first : first + count, drives]
            line["kept"], line["oldest"], line["waiting"] = count, first + count, len(waiting) - count
