"""Which units of a work wait, in which batches they go out, and how often their workers were lost."""

from __future__ import annotations

from collections import Counter, deque
from collections.abc import Iterable

_ATTEMPTS = 2
_SHARE = 2  # batches for each worker that the waiting units make at least: near the end the batches become small


class Schedule:
    """The waiting units for `workers` workers. A batch takes about `span` s, the first ones are single units.

    Units of a lost batch are sent again, each alone, so that the one that ended its worker is known.
    """

    def __init__(self, units: Iterable[int], workers: int, span: float) -> None:
        self._waiting, self._again = deque(units), deque[int]()
        self._workers, self._span = workers, span
        self._out = 0
        self._done, self._seconds = 0, 0.0
        self._lost = Counter[int]()

    @property
    def left(self) -> int:
        """Number of units that are neither done nor given up."""
        return len(self._waiting) + len(self._again) + self._out

    @property
    def waiting(self) -> bool:
        """Whether a unit waits for a worker."""
        return bool(self._waiting or self._again)

    @property
    def suspects(self) -> bool:
        """Whether the next batch is a unit whose worker was lost before."""
        return bool(self._again)

    def batch(self) -> list[int]:
        """Return the next units for a worker; none if none waits."""
        if self._again:
            found = [self._again.popleft()]
        else:
            size = 1
            if self._done:
                fits = int(self._span * self._done / max(self._seconds, 1e-9))
                size = max(1, min(fits, len(self._waiting) // (_SHARE * self._workers)))
            found = [self._waiting.popleft() for _ in range(min(size, len(self._waiting)))]
        self._out += len(found)
        return found

    def done(self, batch: list[int], seconds: float) -> None:
        """Take note that a batch is finished; it took `seconds`."""
        self._out -= len(batch)
        self._done += len(batch)
        self._seconds += seconds

    def lost(self, batch: list[int], attempts: int = 1) -> list[int]:
        """Take note that the worker of a batch was lost, after `attempts`; return the units that are given up."""
        self._out -= len(batch)
        self._lost.update(batch * attempts)
        given_up = [unit for unit in batch if self._lost[unit] >= _ATTEMPTS]
        self._again.extend(unit for unit in batch if unit not in given_up)
        return given_up
