"""What is said of a rig before it runs, and who may say it: the solver of every rig, an effect of its own."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import dataclass
from typing import TYPE_CHECKING, Literal

if TYPE_CHECKING:
    from rig.model.system import System

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
