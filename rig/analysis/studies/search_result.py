"""The result of a search: its points, the best one, and how it came there."""

from __future__ import annotations

import csv
import io
from collections import Counter
from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any, ClassVar

import numpy as np
from numpy.typing import NDArray

from rig.analysis.studies.factors import Factor
from rig.analysis.studies.words import with_unit
from rig.analysis.text_table import columns
from rig.results import Result
from rig.scenes.scene import Scene

Array = NDArray[np.float64]
_APART = "not converged: the same search with more --evaluations and --force continues from here"
_CLOSE = 0.01  # of the range: nearer to an end, the range limits the search


@dataclass(frozen=True)
class SearchResult(Result):
    """The result of `rig.optimise`: `values` of the measure at `points` [point, parameter] (SI), in the order of the
    search; nan with a reason where there is none. `settled`: whether the points have converged.
    """

    FIGURE: ClassVar = "rig.analysis.studies.figure:search_figure"

    scene: Scene
    factors: tuple[Factor, ...]
    measure: str
    unit: str
    largest: bool
    points: Array
    values: Array
    reasons: tuple[str, ...]
    settled: bool
    provenance: Mapping[str, str]
    folder: Path

    @cached_property
    def best(self) -> int | None:
        """Number of the best point; None if no point has a value."""
        if not np.isfinite(self.values).any():
            return None
        return int(np.nanargmax(self.values) if self.largest else np.nanargmin(self.values))

    @property
    def value(self) -> float:
        """The best value; nan if no point has one."""
        return float("nan") if self.best is None else float(self.values[self.best])

    @property
    def parameters(self) -> dict[str, float]:
        """The parameters of the best point (SI); empty if no point has a value."""
        if self.best is None:
            return {}
        return {one.key: float(v) for one, v in zip(self.factors, self.points[self.best])}

    def text(self) -> str:
        """Return the report as text."""
        what = f"{'largest' if self.largest else 'smallest'} {self.measure}"
        counts = Counter(why for why in self.reasons if why)
        missing = [f"  {count} points have no value: {why}" for why, count in counts.most_common(3)]
        if self.best is None:
            return "\n".join([f"{self.scene.name}: no point has a value of {self.measure}", *missing])
        unit = "" if self.unit in ("", "1") else f" {self.unit}"
        lines = [f"{self.scene.name}: {what} {self.value:.6g}{unit}, point {self.best + 1} of {len(self.values)}", ""]
        rows: list[tuple[str, ...]] = [("parameter", "best", "from", "to", "")]
        for one, value in zip(self.factors, self.points[self.best].tolist()):
            low, high = one.axis.values
            near = min(value - low, high - value) < _CLOSE * (high - low)
            note = "at the end of its range: a wider one may hold a better point" if near else ""
            rows.append((one.key, *(one.axis.text(v) for v in (value, low, high)), note))
        lines += [*columns(rows, "<>>><"), ""]
        lines += [f"  the points have {'converged' if self.settled else _APART}"]
        return "\n".join([*lines, *missing])

    def __repr__(self) -> str:
        return self.text()

    def to_json(self) -> dict[str, Any]:
        """Return the fields as JSON values; parameters in SI."""
        return {
            "scene": self.scene.name,
            "measure": self.measure,
            "unit": self.unit,
            "largest": self.largest,
            "value": self.value,
            "parameters": self.parameters,
            "ranges": {one.key: list(one.axis.values) for one in self.factors},
            "evaluations": len(self.values),
            "settled": self.settled,
            "folder": str(self.folder),
        }

    def csv(self) -> str:
        """Return every point as a line of a CSV file with the units in its head; parameters in SI."""
        made = io.StringIO()
        writer = csv.writer(made)
        writer.writerow([*(one.axis.si_label for one in self.factors), with_unit(self.measure, self.unit), "reason"])
        for point, value, why in zip(self.points.tolist(), self.values.tolist(), self.reasons):
            writer.writerow([*point, value, why])
        return made.getvalue()
