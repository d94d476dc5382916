"""The result of a study, and what is done with it."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from rig.analysis.pool import Arrays
from rig.analysis.studies.dataset import dataset, save
from rig.analysis.studies.figure import draw
from rig.analysis.studies.result_data import StudyData
from rig.analysis.studies.runs import StudyRuns

if TYPE_CHECKING:
    from xarray import Dataset


class StudyResult(StudyData):
    """The result of `rig.study`. Printed, it is the report."""

    def to_xarray(self) -> Dataset:
        """Return the result as a Dataset over the dimensions of the plan, with units and provenance.

        Raises rig.errors.UsageError if xarray is not installed.
        """
        return dataset(self)

    def save(self, path: Path | str) -> None:
        """Write the Dataset as NetCDF (.nc) or Zarr (.zarr). Raises rig.errors.UsageError, OutputError."""
        save(self, Path(path))

    def draw(self, folder: Path | str) -> list[Path]:
        """Draw the figures that suit the plan into a folder (PNG), and return them."""
        return draw(self, Path(folder))

    def __repr__(self) -> str:
        return self.text()


def gathered(work: StudyRuns, found: Mapping[int, Arrays], provenance: Mapping[str, str], folder: Path) -> StudyResult:
    """Assemble the result of a study from its points."""
    order = range(work.total)
    values = np.array([found[unit]["values"] for unit in order])
    units = [one.unit for one in work.measures]
    for m, unit in enumerate(units):
        if not unit:  # a function of a Run: its first value tells the unit
            units[m] = next((str(found[k]["units"][m]) for k in order if str(found[k]["units"][m])), "1")
    reasons = tuple(str(found[unit]["reason"]) for unit in order)
    return StudyResult(work, values, tuple(units), reasons, provenance, folder)
