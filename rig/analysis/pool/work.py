"""What a work is: numbered units, each a pure function of the work's description."""

from __future__ import annotations

import importlib
import json
from collections.abc import Callable
from typing import Any, Protocol, Self

import numpy as np
from numpy.typing import NDArray

Arrays = dict[str, NDArray[Any]]
"""The result of one unit: arrays by name."""
Progress = Callable[[int, int], object]
"""(units done, all units)."""
MOST_WORKERS = 256
"""Largest number of worker processes."""


class Work(Protocol):
    """Units `0` to `total - 1`. Worker processes restore the work from its text; its class is found by its name."""

    @property
    def name(self) -> str:
        """What the folder of the results is called, before the digest."""

    @property
    def digest(self) -> str:
        """Hash of everything that the results depend on, sources included."""

    @property
    def total(self) -> int:
        """Number of units; 0 for a work that learns its units while it runs."""

    def prepare(self) -> None:
        """Compile what all units need, before several workers ask for it. Raises RigError for a work in vain."""

    @property
    def compute(self) -> Callable[..., Arrays]:
        """Function of the number of a unit, and of the values that it is given, if any, which computes it.

        Raises RigError for a fault that ends the whole work.
        """

    def failed(self, unit: int, why: str) -> Arrays:
        """Return the result of a unit that ended its worker twice. Raises RigError if there can be none."""

    def to_json(self) -> str:
        """Return the work as JSON text, an object; `from_json` restores an equal work."""

    @classmethod
    def from_json(cls, text: str) -> Self:
        """Return the work of a text by `to_json`."""


def to_text(work: Work) -> str:
    """Return a work with the name of its class as JSON text."""
    cls = type(work)
    head = {"work": f"{cls.__module__}:{cls.__qualname__}", "digest": work.digest}
    return json.dumps(head | json.loads(work.to_json()))


def from_text(text: str) -> Work:
    """Return the work of `to_text`."""
    module, _, name = json.loads(text)["work"].partition(":")
    work: Work = getattr(importlib.import_module(module), name).from_json(text)
    return work


def packed(raw: Any) -> Arrays:
    """Return JSON values as the result of a unit."""
    return {"json": np.frombuffer(json.dumps(raw).encode(), dtype=np.uint8)}


def unpacked(arrays: Arrays) -> Any:
    """Return the values of `packed`."""
    return json.loads(arrays["json"].tobytes())
