"""The condition of a trigger: one sensor or plant output beyond a level, such as "vibrometer > 0.1 m/s"."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rig.bus import messages
from rig.errors import UsageError
from rig.quantities import Condition
from rig.record.run_data import MEASURED, TRUE, unknown

MEMORY = 64 << 20
"""Memory for the messages before a firing [bytes]."""


@dataclass(frozen=True)
class Trigger:
    """What is kept around each firing of a condition: `before` and `after` it [s], in at most `most` recordings."""

    condition: Condition
    before: float
    after: float
    most: int
    memory: int = MEMORY
    """Memory for the messages before a firing [bytes]; with less than `before` in it, the recording says so."""

    def options(self) -> list[str]:
        """The options of `rig record` for this trigger."""
        times = {"--before": repr(self.before), "--after": repr(self.after), "--most": str(self.most)}
        return [f"--trigger={self.condition}", *(f"{option}={value}" for option, value in times.items())]


def condition(text: str) -> Condition:
    """Read "NAME > VALUE UNIT", "NAME < VALUE UNIT" or "|NAME| > VALUE UNIT". Raises UsageError."""
    expected = (
        'NAME > VALUE or NAME < VALUE with a unit, such as "vibrometer > 0.1 m/s"; |NAME| compares the absolute value'
    )
    return Condition.read(text, "--trigger", "<>|", expected)


@dataclass(frozen=True)
class Bound:
    """A condition on messages of `topic`, whose samples `read` returns: times [ns] and values in `unit`."""

    condition: Condition
    unit: str
    level: float
    topic: str
    read: Callable[[bytes], tuple[NDArray[np.int64], NDArray[np.float64]]]

    def beyond(self, v: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return by how much each value is beyond the level; positive where the condition holds."""
        size = np.abs(v) if self.condition.size else v
        return np.asarray(size - self.level if self.condition.sense == ">" else self.level - size)


def bound(given: Condition, outputs: Mapping[str, str], sensors: Mapping[str, str]) -> Bound:
    """Return the condition on a channel of a run with these outputs and sensors (name -> unit).

    Raises UsageError for a name that the run does not have, and for a level whose unit does not fit.
    """
    known = {**sensors, **{TRUE * (name in sensors) + name: unit for name, unit in outputs.items()}}
    if given.name not in known:
        raise unknown(given.name, known, "run")
    unit = known[given.name]
    level = given.level_in(unit, plain=False)
    if given.size and (level < 0.0 or (level == 0.0 and given.sense == "<")):
        raise UsageError(f"--trigger {given}: an absolute value is never below 0; take a level above 0 {unit}")
    if given.name in sensors:
        return Bound(given, unit, level, MEASURED + given.name, _block)
    field = messages.field_name(given.name.removeprefix(TRUE))
    state = messages.state_type(list(outputs))

    def read(payload: bytes) -> tuple[NDArray[np.int64], NDArray[np.float64]]:
        content: Any = state.FromString(payload)
        return np.array([content.t_ns], np.int64), np.array([getattr(content, field)])

    return Bound(given, unit, level, "state", read)


def _block(payload: bytes) -> tuple[NDArray[np.int64], NDArray[np.float64]]:
    block: Any = messages.TYPES["Block"].FromString(payload)
    return messages.times(block), np.array(block.v, np.float64)
