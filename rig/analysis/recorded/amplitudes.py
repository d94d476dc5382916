"""Amplitude and frequency of every sensor in each stage of a run, and the speeds at which its contact stuck."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any, ClassVar

from rig.analysis import stick_speeds
from rig.analysis.amplitude import Row, measured
from rig.analysis.recorded.series import scene_name
from rig.errors import UsageError
from rig.printable import columns
from rig.record.run import Run
from rig.results import Result


@dataclass(frozen=True)
class Amplitudes(Result):
    """The amplitude index of every sensor of a run in each of its stages.

    `sticks`: speeds of the last and the first stick, if the run accelerates and decelerates.
    """

    FIGURE: ClassVar = "rig.analysis.figures:amplitudes_figure"
    TITLE: ClassVar = "amplitude: half of peak to valley, mean over the cycles"
    COLUMNS: ClassVar = ("stage", "sensor", "mean", "amplitude", "cycles", "frequency")

    scene: str
    rows: tuple[Row, ...]
    sticks: stick_speeds.Stages | None

    def table(self) -> list[tuple[str, str, str, str, str, str]]:
        """Return a row of texts for each sensor and stage, in the order of COLUMNS."""
        return [
            (row.stage, row.sensor, f"{row.mean:.5g} {row.unit}",
             "-" if math.isnan(row.found.half) else f"{row.found.half:.5g} {row.unit}", str(row.found.cycles),
             f"{row.found.frequency:.5g} Hz" if row.found.cycles else row.found.why)
            for row in self.rows
        ]  # fmt: skip

    def text(self) -> str:
        """Return the report as text."""
        lines = [f"{self.scene}: {self.TITLE}", "", *columns([self.COLUMNS, *self.table()], "<<<<><")]
        return "\n".join([*lines, *([self.sticks.text()] if self.sticks else [])])

    def to_json(self) -> dict[str, Any]:
        """Return the fields as JSON values."""
        rows = [{**row._asdict(), "found": {**row.found._asdict(), "why": row.found.why}} for row in self.rows]
        return {"rows": rows, "stages": self.sticks._asdict() if self.sticks else None}


def amplitudes(run: Run, first: float = 0.0, last: float = float("inf")) -> Amplitudes:
    """Compute the amplitude index of every sensor from `first` to `last` [s], for each stage of the run.

    Raises UsageError for a time span outside of the run.
    """
    if run.span and first >= min(last, run.span[1]):
        raise UsageError(f"--from {first:g} s to {min(last, run.span[1]):g} s: the time span is empty; the recording "
                         "has {:g} to {:g} s".format(*run.span))  # fmt: skip
    return Amplitudes(scene_name(run), tuple(measured(run, first, last)), stick_speeds.stages(run))
