"""The plant's own quantities at every sample step, kept while it runs and worked out afterwards."""

from __future__ import annotations

from functools import cache
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rig.motion.motion import Motion

ROWS = 1 << 15


class Truth:
    """States and mode sets as the motion keeps them; `work_out` turns them into outputs before the matrices change."""

    def __init__(self, motion: Motion, steps: int, step_ns: int) -> None:
        """`motion` was made with `longest=ROWS`; a frame has `steps` steps."""
        self._steps, self._step_ns = steps, step_ns
        self._done = [motion.outputs_now()[None].copy()]
        self._keys = [np.array([motion.key])]
        self._events: list[tuple[int, NDArray[np.int64], NDArray[np.float64]]] = []
        self._told: list[dict[str, Any]] = []

    def advance(self, motion: Motion, frames: int) -> bool:
        """Carry `motion` up to so many frames on, as far as it goes in one piece, and keep it; as `Motion.advance`."""
        if motion.kept + self._steps > ROWS:
            self.work_out(motion)
        room = (ROWS - motion.kept) // self._steps
        look = motion.advance(min(frames, room) * self._steps, keep=True)
        if look and motion.event_count:
            self._events.append(motion.met())
        return look

    def work_out(self, motion: Motion) -> None:
        """Turn what was kept into outputs, with the matrices of now."""
        rows = motion.kept
        mode_sets = motion.log.modes[:rows]
        self._done.append(motion.outputs_at(motion.log.out[:rows], mode_sets))
        self._tell(motion)
        keys = np.array([modes.key for modes in motion.mode_sets.sets], dtype=np.int64)
        self._keys.append(keys[mode_sets])
        motion.kept = 0

    def outputs(self, motion: Motion) -> tuple[NDArray[np.float64], NDArray[np.int64]]:
        """All outputs [output, step] and mode sets [step] so far."""
        self.work_out(motion)
        keys = np.concatenate(self._keys)
        values, done = np.empty((self._done[0].shape[1], len(keys))), 0
        for block in self._done:
            values[:, done : done + len(block)] = block.T
            done += len(block)
        return values, keys

    def events(self, motion: Motion) -> list[dict[str, Any]]:
        """All events so far, as a recording keeps them."""
        self._tell(motion)
        return self._told

    def _tell(self, motion: Motion) -> None:
        """Put what has happened into words; a squeal has thousands of events a second between two mode sets."""
        describe, happens = cache(motion.system.describe), cache(motion.system.happens)
        for first, events, places in self._events:
            for (tick, kind, owner, before), place in zip(events.tolist(), places.tolist()):
                data = {"tick": first + tick, "place": place, "before": describe(before)}
                t_ns = round((first + tick + place) * self._step_ns)
                told = {"t_ns": t_ns, "tick": first + tick, "source": "plant", "kind": "contact"}
                self._told.append({**told, "text": happens(kind, owner), "data": data})
        self._events.clear()
