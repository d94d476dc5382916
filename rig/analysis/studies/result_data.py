"""The values of a study: every measure at every point, with units, seeds and reasons; as text, JSON and CSV."""

from __future__ import annotations

import csv
import io
from collections import Counter
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rig.analysis.studies.runs import StudyRuns
from rig.analysis.studies.words import with_unit
from rig.analysis.text_table import columns

Array = NDArray[np.float64]
COLUMNS = ("seed", "reason", "scene_json")
"""Names in the results beside those of parameters, dimensions and measures."""
_FEW = 24  # points that the report lists one by one
_REASONS = 6  # different reasons in it


@dataclass(frozen=True)
class Indices:
    """Sobol indices of each measure, [measure, parameter]: the share of its variance due to one parameter.

    `first`: alone; `whole`: with all its interactions.
    """

    keys: tuple[str, ...]
    first: Array
    whole: Array


@dataclass(frozen=True)
class StudyData:
    """The result of a study.

    `values` [point, measure] with `units` [measure]; nan where a value is missing, for the reason `reasons` [point].
    `recordings`: point -> recording that was kept. `folder`: where the results are.
    """

    work: StudyRuns
    values: Array
    units: tuple[str, ...]
    reasons: tuple[str, ...]
    provenance: Mapping[str, str]
    folder: Path
    recordings: Mapping[int, Path] = field(default_factory=dict)

    @property
    def names(self) -> list[str]:
        """Names of the measures."""
        return [one.name for one in self.work.measures]

    @cached_property
    def points(self) -> Array:
        """The values (SI) of the varied parameters, [point, parameter]."""
        plan = self.work.plan
        keys = [one.key for one in plan.factors]
        return np.array([[found[key] for key in keys] for found in map(plan.values, range(plan.total))])

    def values_of(self, measure: str) -> Array:
        """Return the values of a measure over the dimensions of the plan (`Plan.dimensions`)."""
        column = self.values[:, self.names.index(measure)]
        return column.reshape(tuple(self.work.plan.dimensions.values()))

    @cached_property
    def indices(self) -> Indices | None:
        """Sobol indices, if the sampling allows them and no value is missing; of a grid, those at its first point."""
        plan = self.work.plan
        if plan.sampling != "saltelli" or not plan.drawn:
            return None
        from scipy.stats import sobol_indices

        count, n = len(plan.drawn), plan.samples
        shape = (-1, plan.rows, plan.repeat, len(self.names))
        rows = self.values.reshape(shape)[0].mean(axis=1).T  # [measure, sample]
        first, whole = np.full((2, len(self.names), count), np.nan)
        for m, row in enumerate(rows):
            if np.isfinite(row).all() and np.ptp(row[: 2 * n]) > 0.0:
                twice = np.stack([row, row])  # scipy fails with one measure of one parameter
                ab = twice[:, 2 * n :].reshape(2, count, n).transpose(1, 0, 2)
                found = sobol_indices(func={"f_A": twice[:, :n], "f_B": twice[:, n : 2 * n], "f_AB": ab}, n=n)
                first[m], whole[m] = found.first_order.reshape(2, -1)[0], found.total_order.reshape(2, -1)[0]
        return Indices(tuple(one.key for one in plan.drawn), first, whole)

    def text(self) -> str:
        """Return the report as text."""
        return "\n".join(self._lines())

    def _lines(self) -> Iterator[str]:
        plan, names = self.work.plan, self.names
        over = ", ".join(f"{one.key} {one.distribution or f'{len(one.axis.values)} values'}" for one in plan.factors)
        sizes = " x ".join(map(str, plan.dimensions.values()))
        yield f"{self.work.name}: {len(self.values)} points ({sizes}) over {over}"
        if len(self.values) <= _FEW:
            yield from ["", *self._table()]
        yield ""
        rows: list[tuple[str, ...]] = [("measure", "median", "least", "greatest", "unit", "missing")]
        for m, (name, unit) in enumerate(zip(names, self.units)):
            v = self.values[np.isfinite(self.values[:, m]), m]
            numbers = (f"{np.median(v):.5g}", f"{v.min():.5g}", f"{v.max():.5g}") if v.size else ("-", "-", "-")
            rows.append((name, *numbers, unit, f"{len(self.values) - v.size or ''}"))
        yield from columns(rows, "<>>><>")
        if (found := self.indices) is not None:
            yield from ["", *self._index_table(found)]
        if computed := self.provenance.get("processors"):
            yield f"  computed on {computed}; results have the same bits on processors of one type only"
        counts = Counter(why for why in self.reasons if why)
        for why, count in counts.most_common(_REASONS):
            at = self._at(self.reasons.index(why))
            yield f"  {count} of {len(self.reasons)} points have missing values: {why}; first at {at}"
        if len(counts) > _REASONS:
            yield f"  and {len(counts) - _REASONS} more reasons, in study.csv"

    def _at(self, point: int) -> str:
        texts = [f"{one.key} = {one.axis.text(v)}" for one, v in zip(self.work.plan.factors, self.points[point])]
        return f"{', '.join(texts)}, seed {self.work.plan.seed_of(point)}"

    def _table(self) -> Iterator[str]:
        rows = [(*(one.axis.label for one in self.work.plan.factors), *map(_titled, self.names, self.units))]
        for at, values in zip(self.points, self.values):
            keys = (f"{v / one.axis.scale:.6g}" for one, v in zip(self.work.plan.factors, at))
            rows.append((*keys, *(f"{v:.6g}" if np.isfinite(v) else "-" for v in values)))
        return columns(rows, "<" * len(self.work.plan.factors) + ">" * len(self.names))

    def _index_table(self, found: Indices) -> Iterator[str]:
        rows = [("share of the variance", *(f"{key}" for key in found.keys))]
        for m, name in enumerate(self.names):
            pairs = zip(found.first[m], found.whole[m])
            rows.append((name, *(f"{a:.2f} alone, {b:.2f} in all" if np.isfinite(a) else "-" for a, b in pairs)))
        return columns(rows, "<" + ">" * len(found.keys))

    def records(self) -> Iterator[dict[str, Any]]:
        """Yield every point as a flat record: parameters (SI), seed, measures, reason."""
        plan = self.work.plan
        for k, (at, values) in enumerate(zip(self.points.tolist(), self.values.tolist())):
            record: dict[str, Any] = {one.key: value for one, value in zip(plan.factors, at)}
            yield record | {"seed": plan.seed_of(k)} | dict(zip(self.names, values)) | {"reason": self.reasons[k]}

    def csv(self) -> str:
        """Return every point as a line of a CSV file with the units in its head; parameters in SI."""
        made = io.StringIO()
        writer = csv.writer(made)
        measures = (with_unit(name, unit) for name, unit in zip(self.names, self.units))
        writer.writerow([*(one.axis.si_label for one in self.work.plan.factors), "seed", *measures, "reason"])
        writer.writerows(record.values() for record in self.records())
        return made.getvalue()

    def to_json(self) -> dict[str, Any]:
        """Return the result as JSON values; parameters in SI."""
        plan, found = self.work.plan, self.indices
        return {
            "scene": self.work.name,
            "over": {one.key: str(one.distribution or list(one.axis.values)) for one in plan.factors},
            "dimensions": plan.dimensions,
            "units": dict(zip(self.names, self.units)) | {one.key: one.axis.unit for one in plan.factors},
            "points": list(self.records()),
            "indices": None if found is None else {
                name: {key: {"first": first[i], "whole": whole[i]} for i, key in enumerate(found.keys)}
                for name, first, whole in zip(self.names, found.first.tolist(), found.whole.tolist())
            },
            "recordings": {str(point): str(path) for point, path in self.recordings.items()},
            "folder": str(self.folder),
        }  # fmt: skip


def _titled(name: str, unit: str) -> str:
    return name if unit in ("", "1") else f"{name} [{unit}]"
