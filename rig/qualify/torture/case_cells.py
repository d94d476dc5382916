"""The matrix of the torture test: its cases, each with all its cells, as a work of worker processes."""

from __future__ import annotations

import json
from collections.abc import Callable, Iterable
from dataclasses import asdict, dataclass
from functools import cached_property
from typing import Self

from rig.analysis.kernel_shapes import prepare
from rig.analysis.pool import Arrays, Progress, carry_out, packed, temporary, unpacked
from rig.errors import WorkerError
from rig.qualify.torture import case as cases
from rig.qualify.torture.case import Case
from rig.qualify.torture.cells import Cell, cells, kernel_scenes


def matrix(
    names: Iterable[str],
    quick: bool,
    report: Callable[[str], object] | None = None,
    progress: Progress | None = None,
    workers: int | None = None,
) -> list[Cell]:
    """Compute all cells of the cases `names`, the reference of each run first.

    Missing kernels are compiled before the first cell; `report` gets a line for each. `progress` counts cases.
    `workers`: processes, one for each core by default.
    """
    work = CaseCells(tuple(names), quick)
    prepare((scene for case in work.cases for scene in kernel_scenes(case, quick)), report)
    with temporary(work) as store:
        found = carry_out(work, store, workers, progress)
    return [Cell.of(raw) for unit in sorted(found) for raw in unpacked(found[unit])]


@dataclass(frozen=True)
class CaseCells:
    """The cells of the cases `names` as a work (rig.analysis.pool): each unit is one case."""

    names: tuple[str, ...]
    quick: bool
    name = "torture"
    digest = ""

    @cached_property
    def cases(self) -> list[Case]:
        """The cases; one for each scene where a case is about all of them."""
        return [one for name in self.names for one in cases.each(cases.load(name), self.quick)]

    @property
    def total(self) -> int:
        """Number of cases."""
        return len(self.cases)

    def prepare(self) -> None:
        """Nothing is compiled here: `matrix` has done it."""

    def compute(self, unit: int) -> Arrays:
        """Compute the cells of a case."""
        return packed([asdict(cell) for cell in cells(self.cases[unit], self.quick)])

    def failed(self, unit: int, why: str) -> Arrays:
        """Raise WorkerError: a case without cells has no result."""
        raise WorkerError(f"{self.cases[unit].name}: {why}")

    def to_json(self) -> str:
        """Return the work as JSON text."""
        return json.dumps({"names": self.names, "quick": self.quick})

    @classmethod
    def from_json(cls, text: str) -> Self:
        """Return the work of a text by `to_json`."""
        raw = json.loads(text)
        return cls(tuple(raw["names"]), raw["quick"])
