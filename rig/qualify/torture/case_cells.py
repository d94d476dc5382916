"""The matrix of the torture test: its cases, each with all its cells, as a work of worker processes."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import asdict
from functools import partial

from rig.analysis.kernel_shapes import prepare
from rig.analysis.pool import Arrays, Progress, Work, carry_out, packed, temporary, unpacked
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
    work = Work(partial(_cells, quick), [one for name in names for one in cases.each(cases.load(name), quick)])
    prepare((scene for case in work.items for scene in kernel_scenes(case, quick)), report)
    with temporary(work) as store:
        found = carry_out(work, store, workers, progress)
    return [Cell.of(raw) for unit in sorted(found) for raw in unpacked(found[unit])]


def _cells(quick: bool, case: Case) -> Arrays:
    return packed([asdict(cell) for cell in cells(case, quick)])
