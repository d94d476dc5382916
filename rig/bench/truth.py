"""The plant's own quantities at every sample step, kept while it runs and worked out afterwards."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from rig.solve.motion import Motion

_ROWS = 1 << 15


class Truth:
    """States and mode sets step by step; `work_out` turns them into outputs before the matrices change."""

    def __init__(self, motion: Motion, step_ns: int) -> None:
        self._step_ns = step_ns
        self._done: list[NDArray[np.float64]] = []
        self._keys: list[NDArray[np.int64]] = []
        self.events: list[dict[str, Any]] = []
        self._states = np.zeros((_ROWS, motion.system.n))
        self._slots = np.zeros(_ROWS, dtype=np.int64)
        self._states[0] = motion.x
        self._slots[0] = motion.slot
        self._rows = 1

    def add(self, motion: Motion) -> None:
        """Keep what the last call of `motion.advance` wrote."""
        log, first = motion.log, self._rows
        last = first + len(log.modes)
        if last > _ROWS:
            self.work_out(motion)
            first, last = 0, len(log.modes)
        self._states[first:last] = log.out
        self._slots[first:last] = log.modes
        self._rows = last
        if motion.event_count:
            for event in motion.events():
                t_ns = round((event.tick + event.place) * self._step_ns)
                data = {"tick": event.tick, "place": event.place, "before": motion.system.describe(event.before)}
                self.events.append(
                    {"t_ns": t_ns, "tick": event.tick, "source": "plant", "kind": "contact", "text": event.what,
                     "data": data}
                )  # fmt: skip

    def work_out(self, motion: Motion) -> None:
        """Turn what was kept into outputs, with the matrices of now."""
        rows = self._rows
        self._done.append(motion.outputs_at(self._states[:rows], self._slots[:rows]))
        keys = np.array([modes.key for modes in motion.slots.sets], dtype=np.int64)
        self._keys.append(keys[self._slots[:rows]])
        self._rows = 0
        if self._states.shape[1] != motion.system.n:
            self._states = np.zeros((_ROWS, motion.system.n))

    def outputs(self, motion: Motion) -> tuple[NDArray[np.float64], NDArray[np.int64]]:
        """All outputs [step, output] and mode sets [step] so far."""
        if self._rows:
            self.work_out(motion)
        return np.concatenate(self._done), np.concatenate(self._keys)
