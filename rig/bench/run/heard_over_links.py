"""What controllers receive from the instruments, if links between plant and controllers are impaired.

It takes the place of the sensor bank wherever samples are passed to a controller: in this process, in the step on the
bus, in a recording that is continued. The recording keeps the measurements themselves; what was heard of them follows
from these, the seed and the tick (rig.bus.impaired_link).
"""

from __future__ import annotations

from collections import deque
from collections.abc import Mapping, Sequence

import numpy as np
from numpy.typing import NDArray

from rig.bus.impaired_link import HeardSensor, ImpairedLink
from rig.sensors.chain.bank import Bank

ROOM = 1 << 10
"""Largest number of ticks between two calls of `advance`. # chosen: a bank keeps as many samples"""


class HeardOverLinks:
    """What arrives over `links` (sensor -> link), to be read like `bank`; other sensors of it are not changed."""

    def __init__(self, bank: Bank, links: Mapping[str, ImpairedLink], frame_ns: int) -> None:
        self._bank = bank
        self._frame = frame_ns
        self._tick = -1
        self._heard = {bank.names.index(name): HeardSensor(link) for name, link in links.items()}
        # What was heard of each sensor with a link at the last ticks: latest sample, samples of the tick.
        self._past: deque[dict[int, tuple[float, list[float]]]] = deque(maxlen=ROOM + 1)

    def advance(self, tick: int) -> None:
        """Hear what arrives up to `tick`, at which the bank is; it must hold the samples since the last call."""
        if self._tick >= tick:
            return
        ticks = range(self._tick + 1, tick + 1)
        sent = {i: [self._bank.samples(i).tolist()] for i in self._heard}
        if len(ticks) > 1:
            before = [at * self._frame for at in ticks[:-1]]
            sent = {i: self._bank.published(i, before) + sent[i] for i in self._heard}
        for k, at in enumerate(ticks):
            heard = {i: sensor.tick(at, sent[i][k]) for i, sensor in self._heard.items()}
            self._past.append({i: (self._heard[i].latest, samples) for i, samples in heard.items()})
        self._tick = tick

    @property
    def latest(self) -> NDArray[np.float64]:
        """See `Bank`."""
        values = self._bank.latest.copy()
        for i, (latest, _) in self._past[-1].items():
            values[i] = latest
        return values

    @property
    def fresh(self) -> NDArray[np.int64]:
        """See `Bank`."""
        counts = self._bank.fresh.copy()
        for i, (_, samples) in self._past[-1].items():
            counts[i] = len(samples)
        return counts

    def samples(self, i: int) -> NDArray[np.float64]:
        """See `Bank`."""
        if i not in self._heard:
            return self._bank.samples(i)
        return np.array(self._past[-1][i][1])

    def shown(self, i: int, t_ns: Sequence[int]) -> list[float]:
        """See `Bank`."""
        if i not in self._heard:
            return self._bank.shown(i, t_ns)
        return [self._at(t)[i][0] for t in t_ns]

    def published(self, i: int, t_ns: Sequence[int]) -> list[list[float]]:
        """See `Bank`."""
        if i not in self._heard:
            return self._bank.published(i, t_ns)
        return [self._at(t)[i][1] for t in t_ns]

    def _at(self, t_ns: int) -> dict[int, tuple[float, list[float]]]:
        return self._past[t_ns // self._frame - self._tick - 1]


Hearing = Bank | HeardOverLinks
"""What a controller is told: by a bank of instruments directly, or over impaired links."""
