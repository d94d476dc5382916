"""What is left of a run when it has ended: its summary, its recording, an exit code."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

from rig.bench import status


@dataclass(frozen=True)
class Outcome:
    """A run that has ended."""

    summary: Mapping[str, Any]
    """As the plant told it; of a plant that died, what is known."""
    log: str = ""
    """The recording."""
    said: str = ""
    """What the recorder said of it."""
    died: tuple[str, ...] = field(default_factory=tuple)
    """Processes that ended otherwise than they should."""
    unrecorded: bool = False
    """Whether the recording that was asked for broke off."""

    @property
    def exit_code(self) -> int:
        """0 as it should be, 1 plant or recorder died, 3 timing invalid, 4 diverged or beyond a limit."""
        return int(self.summary["exit_code"]) or int(self.unrecorded)

    def to_json(self) -> dict[str, Any]:
        """As plain values."""
        return {**self.summary, "log": self.log, "died": list(self.died)}

    def text(self) -> str:
        """The summary in lines, with what to try next."""
        following = [f"rig verify {self.log}", f"rig replay {self.log}"] if self.log else []
        return status.summary(self.to_json(), self.said or self.log, following)
