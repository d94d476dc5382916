"""The result of a study, and what is done with it."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, ClassVar

import numpy as np

from rig.analysis.pool import Arrays
from rig.analysis.studies.dataset import dataset, save
from rig.analysis.studies.figure import draw
from rig.analysis.studies.measures import one_unit
from rig.analysis.studies.result_data import COLUMNS, StudyData
from rig.analysis.studies.runs import StudyRuns
from rig.results import Result

if TYPE_CHECKING:
    from xarray import Dataset

__all__ = ["COLUMNS", "StudyResult", "gathered"]


class StudyResult(StudyData, Result):
    """The result of `rig.study`. Printed, it is the report."""

    FIGURE: ClassVar = "rig.analysis.studies.figure:study_figure"

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
    reasons = [str(found[unit]["reason"]) for unit in order]
    for m, one in enumerate(work.measures):
        if units[m]:
            continue
        told, raw = [str(found[k]["units"][m]) for k in order], values[:, m].copy()  # a function tells its unit
        values[:, m], units[m] = one_unit(raw.tolist(), told)
        for k in np.flatnonzero(np.isfinite(raw) & ~np.isfinite(values[:, m])).tolist():
            why = f"{one.name} has the unit {told[k] or '1'} here, {units[m]} at other points"
            reasons[k] = "; ".join(filter(None, (reasons[k], why)))
    return StudyResult(work, values, tuple(units), tuple(reasons), provenance, folder)
