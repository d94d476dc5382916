"""What is said of a rig before it runs."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

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
