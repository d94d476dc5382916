"""The streams of a recorded run: the samples of real channels, which a new simulation of the run publishes again."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from rig.record.run import Samples
from rig.scenes.scene import Scene
from rig.sensors.chain.bank import Bank
from rig.sensors.stream import streams


class PlayedStreams:
    """The recorded `samples` of the streams of `scene`, which `apply` puts into `bank` at each tick.

    After its last sample a stream keeps this value.
    """

    def __init__(self, scene: Scene, bank: Bank, samples: Mapping[str, Samples]) -> None:
        self._bank = bank
        self._frame_ns = scene.frame_ns
        names = [name for name in streams(scene.sensors) if name in samples and samples[name].v.size]
        self._played = [(bank.names.index(name), *samples[name]) for name in names]
        changes = [t_ns[1:][np.diff(v) != 0.0] // scene.frame_ns for _, t_ns, v in self._played]
        self._changes = np.unique(np.concatenate(changes)) if changes else np.empty(0, np.int64)

    def ahead(self, tick: int) -> int | None:
        """Number of frames from `tick` on to the next change of a sample; None if there is none any more."""
        at = int(np.searchsorted(self._changes, tick, side="right"))
        return int(self._changes[at]) - tick if at < self._changes.size else None

    def apply(self, tick: int) -> None:
        """Put the samples of `tick`, at which the bank is, into it."""
        for i, t_ns, v in self._played:
            at = int(np.searchsorted(t_ns, tick * self._frame_ns, side="right")) - 1
            self._bank.give(i, float(v[max(at, 0)]))
