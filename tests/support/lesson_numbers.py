"""The numbers of a lesson's page beside those that its command reports."""

from dataclasses import dataclass
from typing import Any

from rig.lessons import Command, Expected, Outcome

EXIT_CODE = "exit code"


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


def compare(command: Command, outcome: Outcome) -> list[Found]:
    """The expected numbers beside those that were found; the exit code 0 is expected unless the page says otherwise."""
    expected = list(command.expected)
    if EXIT_CODE not in (row.place for row in expected):
        expected.insert(0, Expected("exit code", EXIT_CODE, 0.0, "", 0.0))
    return [_found(row, outcome) for row in expected]


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
