"""The result of a run, simulated in this process or read from a recording."""

from __future__ import annotations

from collections.abc import Collection
from pathlib import Path
from typing import TYPE_CHECKING, ClassVar, Self

from rig.record.run_data import Commands, Integers, Reals, RunData, Samples
from rig.results import Result
from rig.user_files import recording_name

if TYPE_CHECKING:
    from matplotlib.figure import Figure
    from pandas import DataFrame
    from xarray import DataTree

__all__ = ["Commands", "Integers", "Reals", "Run", "Samples"]


class Run(RunData, Result):
    """A run: arrays with units, and what is done with them. Printed, it is an overview of one screen."""

    FIGURE: ClassVar = "rig.view.run_figure:figure"

    def to_pandas(self) -> dict[str, DataFrame]:
        """Return one frame for each table: outputs, sensors of each rate, commands of each controller, events.

        The index is the time [s]; `frame.attrs["units"]` has the unit of each column. Raises rig.errors.UsageError if
        pandas is not installed.
        """
        from rig.record.export.frames import frames
        from rig.record.export.tables import tables

        return frames(tables(self))

    def to_xarray(self) -> DataTree:
        """Return a tree with one dataset for each table of `to_pandas`, over the coordinate `time` [s].

        Each variable has the attribute `units`. Facts about the run are variables of the root. Raises
        rig.errors.UsageError if xarray is not installed.
        """
        from rig.record.export.description import description
        from rig.record.export.frames import tree
        from rig.record.export.tables import tables

        return tree(tables(self), description(self))

    def plot(self, only: Collection[str] = ()) -> Figure:
        """Return the figure of the run, as `rig simulate --figure` draws it; `savefig` writes it to a file.

        `only`: names of the sensors and outputs that are drawn over time, instead of the plots of the rig. Raises
        rig.errors.UsageError for a name that the run does not have.
        """
        return self._drawn(only)

    def save(self, path: Path | str) -> None:
        """Write the run as a recording (NAME.mcap), over an existing file.

        Raises rig.errors.UsageError for another suffix, OutputError if the file cannot be written.
        """
        from rig.record.save_run import save

        recording_name(Path(path))
        save(self, Path(path))

    def checked(self) -> Self:
        """Return the run itself. Raises its `failure`, which then contains the run, if a controller has stopped it."""
        if self.failure is not None:
            self.failure.run = self
            raise self.failure
        return self

    def text(self) -> str:
        """Return the overview as text."""
        from rig.record.overview import overview

        return overview(self)

    def __repr__(self) -> str:
        return self.text()
