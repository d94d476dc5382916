"""The condition of a trigger: one sensor or plant output beyond a level, such as "vibrometer > 0.1 m/s"."""

from __future__ import annotations

import re
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rig.bus import messages
from rig.errors import UsageError
from rig.quantities import finite
from rig.record.run_data import MEASURED, TRUE, unknown
from rig.units import with_point

_FORM = re.compile(r"(?P<bars>\|?)\s*(?P<name>[\w.\-/]+)\s*(?P<end>\|?)\s*(?P<sense>[<>])\s*(?P<level>[^<>|]+)")
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


@dataclass(frozen=True)
class Condition:
    """A condition as its user wrote it; `level` is text with a unit. `bound` relates it to the channels of a run."""

    name: str
    size: bool
    """Whether the absolute value is compared."""
    above: bool
    level: str

    @classmethod
    def read(cls, text: str) -> Condition:
        """Read "NAME > VALUE UNIT", "NAME < VALUE UNIT" or "|NAME| > VALUE UNIT". Raises UsageError."""
        form = _FORM.fullmatch(text.strip())
        if form is None or form["bars"] != form["end"]:
            raise UsageError(
                f"--trigger {text}: expected NAME > VALUE or NAME < VALUE with a unit, such as "
                '"vibrometer > 0.1 m/s"; |NAME| compares the absolute value'
            )
        return cls(
            form["name"],
            bool(form["bars"]),
            form["sense"] == ">",
            with_point(form["level"].strip(), f"--trigger {text}: the level"),
        )

    def __str__(self) -> str:
        name = f"|{self.name}|" if self.size else self.name
        return f"{name} {'>' if self.above else '<'} {self.level}"

    def bound(self, outputs: Mapping[str, str], sensors: Mapping[str, str]) -> Bound:
        """Return the condition on a channel of a run with these outputs and sensors (name -> unit).

        Raises UsageError for a name that the run does not have, and for a level whose unit does not fit.
        """
        known = {**sensors, **{TRUE * (name in sensors) + name: unit for name, unit in outputs.items()}}
        if self.name not in known:
            raise unknown(self.name, known, "run")
        unit = known[self.name]
        try:
            level = finite(self.level, unit)
        except ValueError as fault:
            raise UsageError(f"--trigger {self}: the level {fault}") from None
        if self.size and (level < 0.0 or (level == 0.0 and not self.above)):
            raise UsageError(f"--trigger {self}: an absolute value is never below 0; take a level above 0 {unit}")
        if self.name in sensors:
            return Bound(self, unit, level, MEASURED + self.name, _block)
        field = messages.field_name(self.name.removeprefix(TRUE))
        state = messages.state_type(list(outputs))

        def read(payload: bytes) -> tuple[NDArray[np.int64], NDArray[np.float64]]:
            content: Any = state.FromString(payload)
            return np.array([content.t_ns], np.int64), np.array([getattr(content, field)])

        return Bound(self, unit, level, "state", read)


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
        return np.asarray(size - self.level if self.condition.above else self.level - size)


def _block(payload: bytes) -> tuple[NDArray[np.int64], NDArray[np.float64]]:
    block: Any = messages.TYPES["Block"].FromString(payload)
    return messages.times(block), np.array(block.v, np.float64)
