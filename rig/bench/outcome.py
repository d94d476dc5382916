"""What is left of a run when it has ended: its summary, its recording, an exit code."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from typing import Any

from rig.bench import status
from rig.bench.timing import NOTHING_LOST


@dataclass(frozen=True)
class Outcome:
    """A run that has ended."""

    summary: Mapping[str, Any]
    """As the plant told it; of a plant that died, what is known."""
    log: str = ""
    """The recording."""
    said: str = ""
    """What the recorder said of it when it had finished its file; empty if it did not."""
    died: tuple[str, ...] = field(default_factory=tuple)
    """Processes that ended otherwise than they should."""
    unrecorded: bool = False
    """Whether the recording that was asked for is not there, or not complete."""

    def without_recording(self, why: str) -> Outcome:
        """The outcome of a run whose recording is not complete: at best DEGRADED; `why` tells what is lost."""
        reasons = [reason for reason in self.summary["reasons"] if reason != NOTHING_LOST]
        verdict = "DEGRADED" if self.summary["verdict"] == "VALID" else self.summary["verdict"]
        told = {**self.summary, "verdict": verdict, "reasons": [*reasons, f"the recording is not complete: {why}"]}
        return replace(self, summary=told, unrecorded=True)

    @property
    def exit_code(self) -> int:
        """0 as it should be, 1 plant died or recording not complete, 3 timing invalid, 4 diverged or beyond a limit."""
        return int(self.summary["exit_code"]) or int(self.unrecorded)

    def to_json(self) -> dict[str, Any]:
        """As plain values."""
        return {**self.summary, "log": self.log, "died": list(self.died)}

    def text(self) -> str:
        """The summary in lines, with what to try next."""
        broken = self.unrecorded and not self.said  # of a finished file there is nothing to recover
        commands = ("recover",) if broken else ("verify", "replay")
        following = [f"rig {command} {self.log}" for command in commands] if self.log else []
        return status.summary(self.to_json(), self.said or self.log, following)
