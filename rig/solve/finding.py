"""What is said of a rig before it runs, and who may say it: the solver of every rig, an effect of its own."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import dataclass
from decimal import ROUND_CEILING, ROUND_FLOOR, Context
from typing import TYPE_CHECKING, Literal

if TYPE_CHECKING:
    from rig.solve.system import System

Level = Literal["info", "warning", "error"]


@dataclass(frozen=True)
class Finding:
    """One verdict: how grave, what, the number that says so (a rate in 1/s where it is growth) and what helps."""

    level: Level
    what: str
    number: float
    remedy: str

    def to_json(self) -> dict[str, object]:
        """As plain values."""
        return dict(vars(self))


Judge = Callable[["System", float], Iterable[Finding]]
"""(system, sample step [s]) -> what an effect has to say."""


def at_most(value: float, digits: int = 2) -> str:
    """An upper limit in so many digits, rounded down: the value that is told is itself allowed."""
    return f"{float(Context(digits, ROUND_FLOOR).create_decimal_from_float(value)):.{digits}g}"


def at_least(value: float, digits: int = 2) -> str:
    """A lower limit in so many digits, rounded up: the value that is told is itself allowed."""
    return f"{float(Context(digits, ROUND_CEILING).create_decimal_from_float(value)):.{digits}g}"
