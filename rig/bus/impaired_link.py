"""A link between plant and controllers that delays, loses, duplicates and reorders messages, on purpose.

The plant computes what becomes of each message when it is sent: nothing depends on the clock, and a run in one process,
in lockstep or at the pace of the wall clock has the same links. Random numbers belong to a message, not to a sequence:
message k of a link has the four numbers that the generator Philox gives for the counter k and a key made of the seed
and the name of the link. Therefore losses of one link change nothing on another one.

    lost         u0 < loss
    latency      delay + (2 u1 - 1) jitter, uniform within +-jitter; the message arrives at the first tick not before it
    duplicated   u2 < duplicate: a second copy follows, with a latency of its own from u3
    order        a message waits for those sent before it, as in a queue, unless the link reorders

Sources: Philox: Salmon et al. (2011), "Parallel random numbers: as easy as 1, 2, 3"; the vocabulary (delay, jitter,
loss, duplicate, reorder) is that of the network emulator netem of Linux.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import asdict, dataclass
from hashlib import sha256
from heapq import heappop, heappush

import numpy as np
from numpy.typing import NDArray

_BLOCK = 256
"""Messages whose random numbers are drawn at once; it has no influence on the numbers."""


@dataclass
class LinkCounts:
    """What became of the messages of one link: the sum of copies that arrive is sent - lost + duplicated."""

    sent: int = 0
    delayed: int = 0
    """Copies that arrive later than the tick at which they were sent."""
    lost: int = 0
    duplicated: int = 0
    reordered: int = 0
    """Copies that overtake one that was sent before them."""


class ImpairedLink:
    """One link. `delay_ns` >= `jitter_ns` >= 0; `loss`, `duplicate`: probabilities; `frame_ns`: one tick [ns]."""

    def __init__(
        self,
        name: str,
        seed: int,
        frame_ns: int,
        delay_ns: int = 0,
        jitter_ns: int = 0,
        loss: float = 0.0,
        duplicate: float = 0.0,
        reorder: bool = False,
    ) -> None:
        self.name = name
        self.loss = loss
        self.duplicate = duplicate
        self.reorder = reorder
        self._frame = frame_ns
        self._delay = delay_ns
        self._jitter = jitter_ns
        self.least = -(-(delay_ns - jitter_ns) // frame_ns)
        self.most = -(-(delay_ns + jitter_ns) // frame_ns)
        """Smallest and largest latency [ticks]."""
        self.counts = LinkCounts()
        self._key = np.frombuffer(sha256(f"{seed} {name}".encode()).digest()[:16], dtype=np.uint64)
        self._first = -1
        self._drawn = np.zeros((0, 4))
        self._last = 0
        """The tick at which the last of the copies sent so far arrives."""

    def numbers(self, first: int, count: int) -> NDArray[np.float64]:
        """The random numbers [count, 4] of messages `first` and following, uniform in [0, 1)."""
        counter = np.array([first, 0, 0, 0], dtype=np.uint64)
        raw = np.random.Philox(key=self._key, counter=counter).random_raw(4 * count)
        return np.asarray((raw >> np.uint64(11)).reshape(count, 4) * 2.0**-53, np.float64)

    def arrivals(self, number: int, tick: int) -> list[int]:
        """Ticks at which the copies of message `number`, sent at `tick`, arrive: none if it is lost."""
        counts = self.counts
        counts.sent += 1
        lost, late, twice, again = self._of(number)
        if lost < self.loss:
            counts.lost += 1
            return []
        latencies = [self._latency(late)]
        if twice < self.duplicate:
            counts.duplicated += 1
            latencies.append(self._latency(again))
        ticks = []
        for latency in latencies:
            at = tick + latency
            if at < self._last:
                if self.reorder:
                    counts.reordered += 1
                else:
                    at = self._last
            self._last = max(self._last, at)
            counts.delayed += at > tick
            ticks.append(at)
        return ticks

    def loses(self, number: int) -> bool:
        """Whether message `number` is lost; counts nothing."""
        return float(self.numbers(number, 1)[0, 0]) < self.loss

    def _latency(self, u: float) -> int:
        """The latency of a copy with the random number `u` [ticks]."""
        ns = self._delay - self._jitter + int(u * (2 * self._jitter + 1))
        return -(-ns // self._frame)

    def _of(self, number: int) -> Sequence[float]:
        first = number - number % _BLOCK
        if first != self._first:
            self._drawn = self.numbers(first, _BLOCK)
            self._first = first
        return self._drawn[number - first].tolist()  # type: ignore[no-any-return]


class HeardSensor:
    """What controllers receive from one sensor over a link, tick by tick. `latest`: the sample that arrived last."""

    def __init__(self, link: ImpairedLink) -> None:
        self.link = link
        self.latest = float("nan")
        self._under_way: list[tuple[int, int, Sequence[float]]] = []
        self._posted = 0

    def tick(self, tick: int, samples: Sequence[float]) -> list[float]:
        """Send the `samples` that were published in the frame before `tick`; return those that arrive at it, in order.

        Call it at every tick. A frame without samples sends no message.
        """
        if len(samples):
            for at in self.link.arrivals(tick, tick):
                heappush(self._under_way, (at, self._posted, samples))
                self._posted += 1
        arrived: list[float] = []
        while self._under_way and self._under_way[0][0] <= tick:
            arrived.extend(heappop(self._under_way)[2])
        if arrived:
            self.latest = arrived[-1]
        return arrived


def counters(links: Sequence[ImpairedLink]) -> dict[str, dict[str, int]]:
    """Name of each link -> what became of its messages."""
    return {link.name: asdict(link.counts) for link in links}
