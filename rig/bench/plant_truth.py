"""The plant's own outputs, mode sets and events at every sample step, as the plant runner delivers them."""

from __future__ import annotations

from functools import cache
from itertools import groupby
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rig.bench.growing_rows import GrowingRows
from rig.model.system import System
from rig.motion.motion import Motion


class Truth:
    """Collects outputs, mode sets and events. `outputs` [output] and `key` (of the mode set) are those at the start.

    `steps`: about how many will come.
    """

    def __init__(self, outputs: NDArray[np.float64], key: int, step_ns: int, steps: int) -> None:
        self._step_ns = step_ns
        self._outputs, self._keys = (
            GrowingRows(rows, kind, steps + 1) for rows, kind in ((len(outputs), np.float64), (1, np.int64))
        )
        self._outputs.append(1)[0][:, 0] = outputs
        self._keys.append(1)[0][:, 0] = key
        self._met: list[tuple[System, int, NDArray[np.int64], NDArray[np.float64]]] = []

    def keep(self, motion: Motion) -> None:
        """Append the steps in the log of a motion, as outputs computed with its present matrices."""
        steps = motion.kept
        states, mode_sets = motion.log.out[:steps], motion.log.modes[:steps]
        motion.write_outputs(states, mode_sets, *self._outputs.append(steps))
        keys, first = self._keys.append(steps)
        known = np.array([modes.key for modes in motion.mode_sets.sets], dtype=np.int64)
        np.take(known, mode_sets, out=keys[0, first : first + steps], mode="clip")  # without a copy, unlike "raise"

    def happened(self, system: System, first: int, events: NDArray[np.int64], places: NDArray[np.float64]) -> None:
        """Append events of `system`, as `rig.motion.motion.Motion.met` returns them."""
        self._met.append((system, first, events, places))

    def outputs(self) -> tuple[NDArray[np.float64], NDArray[np.int64]]:
        """Return all outputs [output, step] and mode sets [step] so far."""
        return self._outputs.all(), self._keys.all()[0]

    def events(self) -> list[dict[str, Any]]:
        """Return all events so far, in the form of a recording.

        A squeal has thousands of events per second between two mode sets, so the texts are cached.
        """
        found: list[dict[str, Any]] = []
        for _, group in groupby(self._met, lambda met: id(met[0])):
            systems, begins, events, places = zip(*group)
            describe, happens = cache(systems[0].describe), cache(systems[0].event_text)
            ticks = np.concatenate(events)[:, 0] + np.repeat(begins, [len(one) for one in events])
            share = np.concatenate(places)
            times = np.rint((ticks + share) * self._step_ns).astype(np.int64)
            rows = zip(times.tolist(), ticks.tolist(), share.tolist(), np.concatenate(events)[:, 1:].tolist())
            found += [
                {
                    "t_ns": t_ns,
                    "tick": tick,
                    "source": "plant",
                    "kind": "contact",
                    "text": happens(kind, owner),
                    "data": {"tick": tick, "place": place, "before": describe(before)},
                }
                for t_ns, tick, place, (kind, owner, before) in rows
            ]
        return found
