"""Several figures at once, as a work of worker processes: each unit is one figure with its numbers."""

from __future__ import annotations

import json
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Self

from rig.analysis.pool import Arrays, Progress, carry_out, packed, temporary, unpacked
from rig.errors import WorkerError
from rig.papers.entry import Entry, Result, entries, make
from rig.papers.numbers_file import restored, stored


def make_all(
    wanted: Sequence[Entry], folder: Path, progress: Progress | None = None, workers: int | None = None
) -> list[Result]:
    """Draw entries into `folder` (PNG, SVG) and compare numbers, in `workers` processes, by default one for each core.

    Raises WorkerError if a figure cannot be made.
    """
    work = Figures(tuple(entry.name for entry in wanted), str(folder))
    with temporary(work) as store:
        found = carry_out(work, store, workers, progress)
    return [restored(unpacked(found[unit]), folder) for unit in sorted(found)]


@dataclass(frozen=True)
class Figures:
    """The figures `names`, drawn into `folder`, as a work (rig.analysis.pool)."""

    names: tuple[str, ...]
    folder: str
    name = "figures"
    digest = ""

    @property
    def total(self) -> int:
        """Number of figures."""
        return len(self.names)

    def prepare(self) -> None:
        """Nothing is compiled before: the figures need different kernels."""

    def compute(self, unit: int) -> Arrays:
        """Draw a figure and compare its numbers."""
        return packed(stored(make(entries()[self.names[unit]], Path(self.folder))))

    def failed(self, unit: int, why: str) -> Arrays:
        """Raise WorkerError: there is no figure."""
        raise WorkerError(f"{self.names[unit]}: {why}")

    def to_json(self) -> str:
        """Return the work as JSON text."""
        return json.dumps({"names": self.names, "folder": self.folder})

    @classmethod
    def from_json(cls, text: str) -> Self:
        """Return the work of a text by `to_json`."""
        raw = json.loads(text)
        return cls(tuple(raw["names"]), raw["folder"])
