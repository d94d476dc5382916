"""Several figures at once, as a work of worker processes: each unit is one figure with its numbers."""

from __future__ import annotations

from collections.abc import Sequence
from functools import partial
from pathlib import Path

from rig.analysis.pool import Arrays, Progress, Work, carry_out, packed, temporary, unpacked
from rig.papers.entry import Entry, Result, entries, make
from rig.papers.numbers_file import restored, stored


def make_all(
    wanted: Sequence[Entry], folder: Path, progress: Progress | None = None, workers: int | None = None
) -> list[Result]:
    """Draw entries into `folder` (PNG, SVG) and compare numbers, in `workers` processes, by default one for each core.

    Raises WorkerError if a figure cannot be made.
    """
    work = Work(partial(_figure, folder), [entry.name for entry in wanted])
    with temporary(work) as store:
        found = carry_out(work, store, workers, progress)
    return [restored(unpacked(found[unit]), folder) for unit in sorted(found)]


def _figure(folder: Path, name: str) -> Arrays:
    """Draw a figure and compare its numbers."""
    return packed(stored(make(entries()[name], folder)))
