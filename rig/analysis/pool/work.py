"""What a work is, a pure function over numbered items, and the schedule of its units.

The schedule knows which units wait, in which batches they go out, and how often their workers were lost.
"""

from __future__ import annotations

import json
from collections import Counter, deque
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rig.errors import WorkerError

Arrays = dict[str, NDArray[Any]]
"""The result of one unit: arrays by name."""
Progress = Callable[[int, int], object]
"""(units done, all units)."""
MOST_WORKERS = 256
"""Largest number of worker processes."""
_ATTEMPTS = 2
_SHARE = 2  # batches for each worker that the waiting units make at least: near the end the batches become small


@dataclass(frozen=True)
class Work:
    """`function` of each of `items`; the numbers of the units are those of the items. A work can be pickled.

    function  depends on nothing but its item and the values that a unit is given; raises RigError for a fault that
              ends the whole work
    name      what the folder of the results is called, before the digest
    digest    hash of everything that the results depend on, sources included
    prepare   compiles what all units need, before several workers ask for it; raises RigError for a work in vain
    failed    function of an item and a reason: the result of an item that ended its worker twice. By default, and if
              it raises WorkerError, there can be none, and the work ends
    about     what the folder says of the work, as JSON values
    """

    function: Callable[..., Arrays]
    items: Sequence[Any]
    name: str = "work"
    digest: str = ""
    prepare: Callable[[], object] = bool
    failed: Callable[[Any, str], Arrays] | None = None
    about: Mapping[str, Any] = field(default_factory=dict)

    @property
    def total(self) -> int:
        """Number of units."""
        return len(self.items)

    def compute(self, unit: int, *given: float) -> Arrays:
        """Return the result of a unit, for the values that it is given, if any."""
        return self.function(self.items[unit], *given)

    def given_up(self, unit: int, why: str) -> Arrays:
        """Return the result of a unit that ended its worker twice. Raises WorkerError if there can be none."""
        item = self.items[unit]
        if self.failed is None:
            raise WorkerError(f"{getattr(item, 'name', item)}: {why}")
        return self.failed(item, why)


def packed(raw: Any) -> Arrays:
    """Return JSON values as the result of a unit."""
    return {"json": np.frombuffer(json.dumps(raw).encode(), dtype=np.uint8)}


def unpacked(arrays: Arrays) -> Any:
    """Return the values of `packed`."""
    return json.loads(arrays["json"].tobytes())


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
            units = [self._again.popleft()]
        else:
            size = 1
            if self._done:
                fits = int(self._span * self._done / max(self._seconds, 1e-9))
                size = max(1, min(fits, len(self._waiting) // (_SHARE * self._workers)))
            units = [self._waiting.popleft() for _ in range(min(size, len(self._waiting)))]
        self._out += len(units)
        return units

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
