"""What a work is: a pure function over numbered items."""

from __future__ import annotations

import json
from collections.abc import Callable, Mapping, Sequence
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
