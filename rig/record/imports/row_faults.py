"""What is wrong with the rows of a measurement file: each kind of fault once, with its first row and their number."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from rig.errors import UsageError
from rig.printable import counted
from rig.record.run_data import Integers

NO_VALUE = "there is no value"
NO_TIME = "there is no time"
INFINITE = "the value is infinite"
NO_NUMBER = "is not a number"
OPEN_QUOTES = "its quotes do not end"
NO_CLOCK = "is not a time"
NO_TIME_OF_DAY = "is not a time of day"
FALLS = "falls"
REPEATS = "is that of the row before"
CLOSE = "is less than 1 ns after that of the row before: a recording has whole ns"
RAGGED = "has another number of values"
_KINDS = 20  # that are told; of more their number. chosen
_ROWS = 4  # that are told of a kind behind the first one, if there are no more. chosen
REMEDIES = {
    (NO_VALUE, NO_TIME, INFINITE): "--skip-missing leaves them out",
    (NO_TIME, NO_CLOCK, NO_TIME_OF_DAY, FALLS, REPEATS): "--rate RATE takes no times from the file",
    (NO_NUMBER,): "correct these cells, or leave their columns out of the map",
    (RAGGED,): "complete these rows, or remove them",
}
"""Kinds of faults and what helps against them."""


@dataclass
class _Fault:
    """A kind of fault in a column: `text` in its first row, the first `rows` and their `count`."""

    text: str
    rows: list[int] = field(default_factory=list)
    count: int = 0
    last: int = 0

    def add(self, rows: Integers) -> None:
        """Count further rows."""
        self.rows += rows[: 1 + _ROWS - len(self.rows)].tolist()
        self.count += rows.size
        self.last = max(self.last, int(rows[-1]))

    @property
    def place(self) -> tuple[int, int, int]:
        """First row, number of rows, and last row."""
        return self.rows[0], self.count, self.last

    def words(self) -> str:
        """The rows in words."""
        first, *others = self.rows
        if self.count == 1:
            return f"row {first}"
        if self.count == len(self.rows):
            return f"row {first} (and {', '.join(map(str, others))})"
        return f"row {first} (and {counted(self.count - 1, 'further row')}, the last {self.last})"


class RowFaults:
    """Collects the faults of rows: those with the same kind in the same column are counted."""

    def __init__(self, path: Path) -> None:
        self._path = path
        self._faults = dict[tuple[str, str, str], _Fault]()

    def __bool__(self) -> bool:
        return bool(self._faults)

    def note(self, rows: Integers, column: str, kind: str, text: str = "") -> None:
        """Note a fault of some rows, ascending. `column`: "" for the whole row; `text`: of the first one."""
        if len(rows):
            whole = "" if column else text
            self._faults.setdefault((kind, column, whole), _Fault(text or kind)).add(np.asarray(rows))

    def lines(self) -> list[str]:
        """A line for each kind, by the first row, and what helps: behind a single line, else below them."""
        told = [*self._lines()]
        more = [f"{self._path}: {counted(len(told) - _KINDS, 'further kind')} of faults"] if len(told) > _KINDS else []
        met = {kind for kind, _, _ in self._faults}
        remedies = [remedy for kinds, remedy in REMEDIES.items() if met.intersection(kinds)]
        if len(told) == 1:
            return ["; ".join(told + remedies)]
        return [*told[:_KINDS], *more, *remedies]

    def _lines(self) -> Iterator[str]:
        """A line for each kind; columns in which the same rows have it share one."""
        columns = dict[tuple[str, str, tuple[int, int, int]], list[str]]()
        for (kind, column, whole), fault in self._faults.items():
            columns.setdefault((kind, whole, fault.place), []).append(column)
        for (kind, whole, _), alike in sorted(columns.items(), key=lambda entry: entry[0][2]):
            fault = self._faults[kind, alike[0], whole]
            others = f" (and {counted(len(alike) - 1, 'further column')})" if len(alike) > 1 else ""
            column = f", column {alike[0]}{others}" if alike[0] else ""
            yield f"{self._path}: {fault.words()}{column}: {fault.text}"

    def raised(self) -> None:
        """Raise UsageError if there are any."""
        if self._faults:
            raise UsageError("\n".join(self.lines()))
