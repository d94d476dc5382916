"""Runs a command of a lesson and compares its report with the numbers that the page expects."""

from __future__ import annotations

import json
import subprocess
import sys
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from rig.child_process import STEPS
from rig.errors import WorkerError
from rig.lessons.page import EXIT_CODE, Command, Expected

LONGEST_S = 600.0
"""Longest time that a command may take [s]."""
_WRITES = ("--out", "--figure", "--csv")


@dataclass(frozen=True)
class Outcome:
    """What a command gave. `report`: its JSON report, None without one; `notes`: what it wrote on standard error."""

    code: int
    report: Any
    notes: str


@dataclass(frozen=True)
class Found:
    """A number of a report beside the one that the page expects. `value`: None if the report has no such place."""

    expected: Expected
    value: Any
    agrees: bool

    @property
    def text(self) -> str:
        """The value with its unit, for a reader."""
        if self.value is None:
            return "nothing"
        shown = f"{self.value:.6g}" if isinstance(self.value, float) else str(self.value)
        return f"{shown} {self.expected.unit}".strip()


def attempt(command: Command, folder: Path) -> Outcome:
    """Run `command` in `folder`, with a report as JSON; files of an earlier run of it are replaced.

    The command is a process in a session of its own: on Ctrl-C it is asked to stop and has time to complete what it
    writes. Raises WorkerError after `LONGEST_S`.
    """
    words = [*command.words, "--json"]
    if any(word in _WRITES for word in words) and "--force" not in words:
        words.append("--force")
    process = subprocess.Popen(
        [sys.executable, "-P", "-m", "rig", *words],
        cwd=folder,
        stdin=subprocess.DEVNULL,
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
        start_new_session=True,
    )
    try:
        printed, notes = process.communicate(timeout=LONGEST_S)
    except subprocess.TimeoutExpired:
        _end(process)
        raise WorkerError(f"{command.text}: no end within {LONGEST_S:g} s, and therefore stopped") from None
    except KeyboardInterrupt:
        _end(process)
        raise
    try:
        report = json.loads(printed)
    except ValueError:
        report = None
    return Outcome(process.returncode, report, notes)


def _end(process: subprocess.Popen[str]) -> None:
    """End a command and wait for it: by Ctrl-C first, so that it keeps what it has done."""
    for number, patience in STEPS:
        process.send_signal(number)
        try:
            process.communicate(timeout=patience)
        except subprocess.TimeoutExpired:
            continue
        return


def compare(command: Command, outcome: Outcome) -> list[Found]:
    """The expected numbers beside those that were found; the exit code 0 is expected unless the page says otherwise."""
    expected = list(command.expected)
    if EXIT_CODE not in (one.place for one in expected):
        expected.insert(0, Expected("exit code", EXIT_CODE, 0.0, "", 0.0))
    return [_found(one, outcome) for one in expected]


def _found(expected: Expected, outcome: Outcome) -> Found:
    value = outcome.code if expected.place == EXIT_CODE else at(outcome.report, expected.place)
    if isinstance(value, bool):
        value = "yes" if value else "no"
    if isinstance(expected.value, str) or not isinstance(value, int | float):
        return Found(expected, value, value == expected.value)
    return Found(expected, value, abs(value - expected.value) <= expected.tolerance)


def at(report: Any, place: str) -> Any:
    """What a report has at a place such as `modes.0.growth`; None if there is no such place."""
    for step in place.split("."):
        try:
            report = report[int(step)] if isinstance(report, list) else report[step]
        except (KeyError, IndexError, TypeError, ValueError):
            return None
    return report
