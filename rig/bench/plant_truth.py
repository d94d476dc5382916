"""The plant's own outputs, mode sets and events at every sample step, as the plant runner delivers them."""

from __future__ import annotations

from functools import cache
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rig.model.system import System


class Truth:
    """Collects outputs, mode sets and events. `outputs` [output] and `key` (of the mode set) are those at the start."""

    def __init__(self, outputs: NDArray[np.float64], key: int, step_ns: int) -> None:
        self._step_ns = step_ns
        self._outputs = [outputs[None].copy()]
        self._keys = [np.array([key])]
        self._met: list[tuple[System, int, NDArray[np.int64], NDArray[np.float64]]] = []

    def keep(self, outputs: NDArray[np.float64], keys: NDArray[np.int64]) -> None:
        """Append the outputs [step, output] and mode sets [step] of the next steps."""
        self._outputs.append(outputs)
        self._keys.append(keys)

    def happened(self, system: System, first: int, events: NDArray[np.int64], places: NDArray[np.float64]) -> None:
        """Append events of `system`, as `rig.motion.motion.Motion.met` returns them."""
        self._met.append((system, first, events, places))

    def outputs(self) -> tuple[NDArray[np.float64], NDArray[np.int64]]:
        """Return all outputs [output, step] and mode sets [step] so far."""
        keys = np.concatenate(self._keys)
        values, done = np.empty((self._outputs[0].shape[1], len(keys))), 0
        for block in self._outputs:
            values[:, done : done + len(block)] = block.T
            done += len(block)
        return values, keys

    def events(self) -> list[dict[str, Any]]:
        """Return all events so far, in the form of a recording.

        A squeal has thousands of events per second between two mode sets, so the texts are cached.
        """
        found: list[dict[str, Any]] = []
        described = None
        for system, first, events, places in self._met:
            if system is not described:
                described, describe, happens = system, cache(system.describe), cache(system.event_text)
            for (tick, kind, owner, before), place in zip(events.tolist(), places.tolist()):
                data = {"tick": first + tick, "place": place, "before": describe(before)}
                t_ns = round((first + tick + place) * self._step_ns)
                common = {"t_ns": t_ns, "tick": first + tick, "source": "plant", "kind": "contact"}
                found.append({**common, "text": happens(kind, owner), "data": data})
        return found
