"""The numbers that the page of a lesson expects of a command, beside those that its report has."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

from rig.lessons.page import Command, Expected

EXIT_CODE = "exit code"


@dataclass(frozen=True)
class Compared:
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


def compare(command: Command, code: int, report: Any) -> list[Compared]:
    """The expected numbers beside those of an exit code and of a report (`--json`), in the order of the page.

    Before them the exit code 0, unless the page expects another one.
    """
    expected = list(command.expected)
    if EXIT_CODE not in (row.place for row in expected):
        expected.insert(0, Expected("exit code", EXIT_CODE, 0.0, "", 0.0))
    return [_compared(row, code, report) for row in expected]


def _compared(expected: Expected, code: int, report: Any) -> Compared:
    value = code if expected.place == EXIT_CODE else at(report, expected.place)
    if isinstance(value, bool):
        value = "yes" if value else "no"
    if isinstance(expected.value, str) or not isinstance(value, int | float):
        return Compared(expected, value, value == expected.value)
    return Compared(expected, value, abs(value - expected.value) <= expected.tolerance)


def at(report: Any, place: str) -> Any:
    """What a report has at a place such as `modes.0.growth`; None if there is no such place."""
    for step in place.split("."):
        try:
            report = report[int(step)] if isinstance(report, list) else report[step]
        except (KeyError, IndexError, TypeError, ValueError):
            return None
    return report
