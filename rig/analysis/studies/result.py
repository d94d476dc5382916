"""The result of a study: its values as text, JSON, CSV or NetCDF."""

from __future__ import annotations

import importlib
import json
from collections import Counter
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Any, ClassVar

import numpy as np
from numpy.typing import NDArray

from rig.analysis.branches.threshold import Share
from rig.analysis.pool import Arrays
from rig.analysis.studies.measures import one_unit
from rig.analysis.studies.runs import REPEAT, SAMPLE, StudyRuns
from rig.errors import OutputError, UsageError
from rig.extras import needed
from rig.machine.files import write_file
from rig.printable import counted
from rig.results import Column, Result, Table
from rig.view.palette import put

if TYPE_CHECKING:
    from xarray import Dataset

Array = NDArray[np.float64]
COLUMNS = ("seed", "reason", "scene_json")
"""Names in the results beside those of parameters, dimensions and measures."""
SLIDES = "motion.slides"
OUTSIDE = "modes.outside"
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
class StudyResult(Result):
    """The result of `rig.study`. Printed, it is the report."""

    FIGURE: ClassVar = "rig.analysis.studies.figures:study_figure"

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
        return [measure.name for measure in self.work.measures]

    @cached_property
    def points(self) -> Array:
        """The values (SI) of the varied parameters, [point, parameter]."""
        plan = self.work.plan
        keys = [factor.key for factor in plan.factors]
        points = []
        for number in range(plan.total):
            values = plan.values(number)
            points.append([values[key] for key in keys])
        return np.array(points)

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

        count = len(plan.drawn)
        n = plan.samples
        shape = (-1, plan.rows, plan.repeat, len(self.names))
        rows = self.values.reshape(shape)[0].mean(axis=1).T  # [measure, sample]
        first, whole = np.full((2, len(self.names), count), np.nan)
        for m, row in enumerate(rows):
            if np.isfinite(row).all() and np.ptp(row[: 2 * n]) > 0.0:
                twice = np.stack([row, row])  # scipy fails with one measure of one parameter
                ab = twice[:, 2 * n :].reshape(2, count, n).transpose(1, 0, 2)
                sobol = sobol_indices(func={"f_A": twice[:, :n], "f_B": twice[:, n : 2 * n], "f_AB": ab}, n=n)
                first[m] = sobol.first_order.reshape(2, -1)[0]
                whole[m] = sobol.total_order.reshape(2, -1)[0]
        return Indices(tuple(factor.key for factor in plan.drawn), first, whole)

    def shown(self) -> Iterator[str | Table]:
        """Yield the points if they are few, each measure over all points, and the Sobol indices."""
        plan = self.work.plan
        varied = []
        for factor in plan.factors:
            varied.append(f"{factor.key} {factor.distribution or counted(len(factor.axis.values), 'value')}")
        sizes = " x ".join(map(str, plan.dimensions.values()))
        over = ", ".join(varied) or "seeds"
        yield f"{self.work.scene.name}: {counted(len(self.values), 'point')} ({sizes}) over {over}"
        yield from (f"  {line}" for line in self.work.belief)
        if self.work.left_out:
            yield f"  {self.work.left_out}"
        if len(self.values) <= _FEW:
            yield ""
            yield self.listed()
        yield ""
        numbers = (Column(name, digits=".5g") for name in ("median", "least", "greatest"))
        columns = (Column("measure"), *numbers, Column("unit"), Column("missing", digits=".0f"))
        rows = []
        for m, (name, unit) in enumerate(zip(self.names, self.units)):
            v = self.values[np.isfinite(self.values[:, m]), m]
            values = (float(np.median(v)), float(v.min()), float(v.max())) if v.size else (None,) * 3
            rows.append((name, *values, unit, len(self.values) - v.size))
        yield Table("measures", columns, rows)
        if SLIDES in self.names:
            yield from self._share(self.values[:, self.names.index(SLIDES)])
        if OUTSIDE in self.names:
            outside = np.sum(self.values[:, self.names.index(OUTSIDE)] == 1.0)
            if outside:
                share = f"{outside} of {len(self.values)} points"
                yield f"  warning: {share} lie outside of the trained range ({OUTSIDE} is 1)"
        if (shares := self.indices) is not None:
            yield "\n  shares of the variance, alone and in all"
            yield self._shares(shares)
        if computed := self.provenance.get("processors"):
            yield f"  computed on {computed}; results have the same bits on processors of one type only"
        counts = Counter(why for why in self.reasons if why)
        for why, count in counts.most_common(_REASONS):
            at = self._at(self.reasons.index(why))
            yield f"  {count} of {len(self.reasons)} points have missing values: {why}; first at {at}"
        if len(counts) > _REASONS:
            yield f"  and {len(counts) - _REASONS} more reasons, in study.csv"

    @staticmethod
    def _share(slides: Array) -> Iterator[str]:
        decided = slides[np.isfinite(slides)]
        if count := len(decided):
            of_starts = Share.of(decided > 0.0, simulated=True)
            share = f"{100.0 * of_starts.slides:.4g} % of {count} points come to slide"
            low, high = 100.0 * of_starts.low, 100.0 * of_starts.high
            yield f"  {share} ({low:.4g} to {high:.4g} % with 90 %, if their starts are random)"

    def _at(self, point: int) -> str:
        plan = self.work.plan
        values = zip(plan.factors, self.points[point])
        texts = [f"{factor.key} = {factor.axis.text(value)}" for factor, value in values]
        return ", ".join([*texts, f"seed {plan.seed_of(point)}"])

    def _shares(self, indices: Indices) -> Table:
        columns = (Column("measure"), Column("parameter"), Column("first", digits=".2f"), Column("whole", digits=".2f"))
        rows = []
        for name, first, whole in zip(self.names, indices.first.tolist(), indices.whole.tolist()):
            rows += [(name, *row) for row in zip(indices.keys, first, whole)]
        return Table("shares", columns, rows)

    def listed(self) -> Table:
        """Return a row for each point: parameters (SI), seed, measures, reason."""
        plan = self.work.plan
        measures = (Column(name, unit, ".6g") for name, unit in zip(self.names, self.units))
        seed = Column("seed", digits=".0f")
        columns = [*(factor.axis.column() for factor in plan.factors), seed, *measures, Column("reason")]
        rows = []
        for k, (at, values) in enumerate(zip(self.points.tolist(), self.values.tolist())):
            rows.append((*at, plan.seed_of(k), *values, self.reasons[k]))
        return Table("points", columns, rows)

    def facts(self) -> dict[str, Any]:
        """Return plan, points and Sobol indices; parameters in SI."""
        plan = self.work.plan
        indices: dict[str, Any] | None = None
        if self.indices is not None:
            indices = {}
            for name, first, whole in zip(self.names, self.indices.first.tolist(), self.indices.whole.tolist()):
                shares = zip(self.indices.keys, first, whole)
                indices[name] = {key: {"first": alone, "whole": in_all} for key, alone, in_all in shares}
        return {
            "scene": self.work.scene.name,
            "over": {factor.key: str(factor.distribution or list(factor.axis.values)) for factor in plan.factors},
            "dimensions": plan.dimensions,
            "belief": self.work.belief,
            "left_out": self.work.left_out,
            "units": dict(zip(self.names, self.units)) | {factor.key: factor.axis.unit for factor in plan.factors},
            "points": self.listed().records(),
            "indices": indices,
            "recordings": {str(point): str(path) for point, path in self.recordings.items()},
            "folder": str(self.folder),
        }

    def to_xarray(self) -> Dataset:
        """Return the result as a Dataset: measures, seed and reason over the dimensions of the plan.

        Drawn values are over sample. Every variable has `units` in SI and `long_name`; attributes state scene, plan and
        provenance. Raises rig.errors.UsageError if xarray is not installed.
        """
        xarray: Any = needed("xarray", "data")
        plan = self.work.plan
        names = tuple(plan.dimensions)
        shape = tuple(plan.dimensions.values())

        def about(unit: str, words: str) -> dict[str, str]:
            return {"units": unit or "1", "long_name": words}

        coordinates: dict[str, Any] = {}
        for factor in plan.grid:
            words = about(factor.axis.unit, factor.axis.words)
            coordinates[factor.key] = ((factor.key,), np.array(factor.axis.values), words)
        for factor, draws in zip(plan.drawn, plan.draws.T):
            words = about(factor.axis.unit, factor.axis.words) | {"distribution": str(factor.distribution)}
            coordinates[factor.key] = ((SAMPLE,), draws, words)
        if plan.repeat > 1:
            coordinates[REPEAT] = ((REPEAT,), np.arange(plan.repeat))
        variables: dict[str, Any] = {}
        for name, unit in zip(self.names, self.units):
            allowed = name.replace("/", "_")  # NetCDF allows no slash in a name
            variables[allowed] = (names, self.values_of(name), about(unit, name))
        seeds = np.array([plan.seed_of(k) for k in range(plan.total)]).reshape(shape)
        variables["seed"] = (names, seeds, {"long_name": "seed of the run"})
        reasons = np.array(self.reasons, dtype=object).reshape(shape)
        variables["reason"] = (names, reasons, {"long_name": "why a value is missing"})
        attributes: dict[str, Any] = {f"provenance_{name}": text for name, text in self.provenance.items()}
        attributes["scene"] = self.work.scene.name
        attributes["sampling"] = plan.sampling
        attributes["study_seed"] = plan.seed
        attributes["scene_json"] = self.work.scene.to_json()
        attributes["measures"] = json.dumps(self.names)
        dataset: Dataset = xarray.Dataset(variables, coordinates, attributes)
        for coordinate in dataset.coords.values():
            coordinate.encoding["_FillValue"] = None  # CF allows no missing values in a coordinate
        return dataset

    def save(self, path: Path | str) -> None:
        """Write the Dataset as NetCDF (.nc), completely or not at all.

        Raises rig.errors.UsageError, OutputError.
        """
        path = Path(path)
        check_path(path)
        dataset = self.to_xarray()
        try:
            dataset["scene_json"] = ((), dataset.attrs.pop("scene_json"))  # HDF5 limits attributes to 64 KiB
            path.parent.mkdir(parents=True, exist_ok=True)
            write_file(path, bytes(dataset.to_netcdf(engine="h5netcdf")))  # HDF5 itself tells a full disk in four lines
        except OSError as fault:
            raise OutputError(f"{path} cannot be written: {fault.strerror or fault}") from None

    def draw(self, folder: Path | str) -> list[Path]:
        """Draw the figures that suit the plan into a folder (PNG), and return them."""
        suiting = importlib.import_module("rig.analysis.studies.figures").suiting
        paths = []
        for name, make in suiting(self).items():
            paths.append(Path(folder) / name)
            put(make(self), paths[-1])
        return paths


def gathered(work: StudyRuns, rows: Mapping[int, Arrays], provenance: Mapping[str, str], folder: Path) -> StudyResult:
    """Assemble the result of a study from its points."""
    order = work.items
    values = np.array([rows[unit]["values"] for unit in order])
    units = [measure.unit for measure in work.measures]
    reasons = [str(rows[unit]["reason"]) for unit in order]
    for m, measure in enumerate(work.measures):
        if units[m]:
            continue
        raw = values[:, m].copy()
        told = [str(rows[k]["units"][m]) for k in order]  # a function tells its unit
        values[:, m], units[m] = one_unit(raw.tolist(), told)
        for k in np.flatnonzero(np.isfinite(raw) & ~np.isfinite(values[:, m])).tolist():
            why = f"{measure.name} has the unit {told[k] or '1'} here, {units[m]} at other points"
            reasons[k] = "; ".join(filter(None, (reasons[k], why)))
    return StudyResult(work, values, tuple(units), tuple(reasons), provenance, folder)


def check_path(path: Path) -> None:
    """Raise UsageError for what `save` could not write: another suffix, or a missing library."""
    if path.suffix != ".nc":
        raise UsageError(f"--to {path}: the name of a NetCDF file ends in .nc")
    needed("xarray", "data")
    needed("h5netcdf", "data")
