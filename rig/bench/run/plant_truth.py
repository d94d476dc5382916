"""The plant's own outputs, mode sets and events at every sample step, as the plant runner delivers them.

`Truth` keeps them. `Bands` reduces them for viewers, which would see an alias of a fast vibration in single states.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import cache
from itertools import groupby
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rig.bench.run.measurements import GrowingRows
from rig.bus import encode
from rig.bus.topics import SPAN_NS
from rig.model.system import System
from rig.motion.motion import Motion

SPANS = 20
"""Most spans in one message."""
PAIRS = 512
"""Most of the last steps that a message has for the phase portrait."""


class Truth:
    """Collects outputs, mode sets and events. `outputs` [output] and `key` (of the mode set) are those at the start.

    `steps`: about how many will come.
    """

    def __init__(self, outputs: NDArray[np.float64], key: int, step_ns: int, steps: int) -> None:
        self._step_ns = step_ns
        self._outputs = GrowingRows(len(outputs), np.float64, steps + 1)
        self._keys = GrowingRows(1, np.int64, steps + 1)
        self._outputs.append(1)[0][:, 0] = outputs
        self._keys.append(1)[0][:, 0] = key
        self._met: list[tuple[System, int, NDArray[np.int64], NDArray[np.float64]]] = []

    def keep(self, motion: Motion) -> None:
        """Append the steps in the log of a motion, as outputs computed with its present matrices."""
        steps = motion.kept
        states = motion.log.out[:steps]
        mode_sets = motion.log.modes[:steps]
        motion.write_outputs(states, mode_sets, *self._outputs.append(steps))
        keys, first = self._keys.append(steps)
        _write_keys(motion, mode_sets, keys[0, first : first + steps])

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
        contacts: list[dict[str, Any]] = []
        for _, group in groupby(self._met, lambda met: id(met[0])):
            systems, begins, events, places = zip(*group)
            describe = cache(systems[0].describe)
            happens = cache(systems[0].event_text)
            ticks = np.concatenate(events)[:, 0] + np.repeat(begins, [len(part) for part in events])
            share = np.concatenate(places)
            times = np.rint((ticks + share) * self._step_ns).astype(np.int64)
            rows = zip(times.tolist(), ticks.tolist(), share.tolist(), np.concatenate(events)[:, 1:].tolist())
            for t_ns, tick, place, (kind, owner, before) in rows:
                event = {
                    "t_ns": t_ns,
                    "tick": tick,
                    "source": "plant",
                    "kind": "contact",
                    "text": happens(kind, owner),
                    "data": {"tick": tick, "place": place, "before": describe(before)},
                }
                contacts.append(event)
        return contacts


def _write_keys(motion: Motion, mode_sets: NDArray[np.int64], keys: NDArray[np.int64]) -> None:
    """Write the keys of mode sets, which are given by their places, to `keys`."""
    known = np.array([modes.key for modes in motion.mode_sets.sets], dtype=np.int64)
    np.take(known, mode_sets, out=keys, mode="clip")  # without a copy, unlike "raise"


class Bands:
    """Sends extremes of all `outputs` over the steps of a motion to viewers, as messages of the topic `band`.

    `pair`: indices of displacement and velocity of the phase portrait, if there is one. `later(t_ns, encode, ...)`
    sends what `encode` returns; another thread may call it, so that the plant only evaluates its outputs.
    """

    def __init__(
        self, outputs: int, step_ns: int, pair: tuple[int, ...], later: Callable[..., object], frame_ns: int
    ) -> None:
        self._outputs = outputs
        self._step_ns = step_ns
        self._pair = pair
        self._later = later
        self._frame_ns = frame_ns
        self._span = max(SPAN_NS // step_ns, 1)
        self._room = SPANS * self._span
        self._first = self._count = 0
        self._empty()

    def _empty(self) -> None:
        self._values = np.empty((self._outputs, self._room))
        self._keys = np.empty(self._room, np.int64)
        self._count = 0

    def add(self, motion: Motion) -> None:
        """Take the steps of the last call of `motion.advance`. A long call has longer spans, not more of them."""
        steps = motion.kept
        if self._count + steps > self._room:
            self.put()
        if not self._count:
            self._first = motion.tick - steps
            if steps > self._room:
                self._values = np.empty((self._outputs, steps))
                self._keys = np.empty(steps, np.int64)
        mode_sets = motion.log.modes[:steps]
        at = self._count
        motion.write_outputs(motion.log.out[:steps], mode_sets, self._values, at)
        _write_keys(motion, mode_sets, self._keys[at : at + steps])
        self._count += steps
        if steps > self._room:
            self.put()

    def put(self) -> None:
        """Send what has been taken since the last call."""
        if count := self._count:
            begin, end = self._first * self._step_ns, (self._first + count) * self._step_ns
            span = max(self._span, -(-count // SPANS))
            content = self._values[:, :count], self._keys[:count], span, self._step_ns, self._pair
            self._later(end, _band, end // self._frame_ns, begin, *content)
            self._empty()


def _band(
    tick: int,
    begin_ns: int,
    values: NDArray[np.float64],
    keys: NDArray[np.int64],
    span: int,
    step_ns: int,
    pair: tuple[int, ...],
) -> bytes:
    first = np.arange(0, keys.size, span)
    last = np.minimum(first + span, keys.size)
    low, high = (by.reduceat(values, first, axis=1).T for by in (np.fmin, np.fmax))
    same = keys[:1] if (keys == keys[0]).all() else None  # the usual case, in a tenth of the time
    modes = [np.unique(keys[begin:end]) if same is None else same for begin, end in zip(first, last)]
    counts = np.array([len(present) for present in modes], np.int64)
    ends = begin_ns + last * step_ns
    recent = slice(-PAIRS, None)
    rows, at = (values[list(pair), recent].T, keys[recent]) if pair else (np.empty(0), np.empty(0, np.int64))
    return encode.band(tick, begin_ns, ends, low, high, counts, np.concatenate(modes), step_ns, rows, at)
