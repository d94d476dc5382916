"""The outcome of a run that has ended: its summary, its recording, its exit code."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from typing import Any

from rig.bench import status
from rig.bench.timing import NOTHING_LOST
from rig.errors import ExitCode


@dataclass(frozen=True)
class Outcome:
    """The outcome of a run."""

    summary: Mapping[str, Any]
    """The summary that the plant published; if the plant died, what is known."""
    log: str = ""
    """Path of the recording."""
    account: str = ""
    """The recorder's text about the finished recording; empty if it did not finish it."""
    died: tuple[str, ...] = field(default_factory=tuple)
    """Processes that died or had to be killed, in words."""
    machine: Mapping[str, float] = field(default_factory=dict)
    """Shares of the processors' time that others took (rig.bench.machine_load)."""
    unrecorded: bool = False
    """Whether a recording was requested that is missing or incomplete."""

    def without_recording(self, why: str) -> Outcome:
        """The same outcome for a run with an incomplete recording: at best DEGRADED; `why` says what is lost."""
        reasons = [reason for reason in self.summary["reasons"] if reason != NOTHING_LOST]
        verdict = "DEGRADED" if self.summary["verdict"] == "VALID" else self.summary["verdict"]
        summary = {**self.summary, "verdict": verdict, "reasons": [*reasons, f"the recording is not complete: {why}"]}
        return replace(self, summary=summary, unrecorded=True)

    @property
    def exit_code(self) -> ExitCode:
        """The exit code of the command."""
        code = ExitCode(self.summary["exit_code"])
        return ExitCode.FAILED if self.unrecorded and code in (ExitCode.DONE, ExitCode.INTERRUPTED) else code

    def to_json(self) -> dict[str, Any]:
        """The outcome as plain values for JSON."""
        return {**self.summary, "log": self.log, "died": list(self.died), "machine": dict(self.machine)}

    def text(self) -> str:
        """The summary as text, with commands to try next."""
        broken = self.unrecorded and not self.account  # a finished file needs no recovery
        commands = ("recover",) if broken else ("report", "verify", "replay")
        following = [f"rig {command} {self.log}" for command in commands] if self.log else []
        return status.summary(self.to_json(), self.account or self.log, following)
