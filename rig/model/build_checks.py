"""The findings about a rig before it runs."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

Level = Literal["info", "warning", "error"]


@dataclass(frozen=True)
class Finding:
    """One finding: its level, its text, its number (a growth rate in 1/s for a growth) and the remedy."""

    level: Level
    what: str
    number: float
    remedy: str

    def to_json(self) -> dict[str, object]:
        """The finding as plain values."""
        return dict(vars(self))
