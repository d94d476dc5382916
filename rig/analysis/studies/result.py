"""The result of a study: its values as text, JSON, CSV or NetCDF, and its figures; and the figure of a search.

Figures: curves or a heat map over a grid, a scatter matrix of samples, a tornado of Sobol indices. Of dimensions that a
figure does not show (samples, repeats, further parameters) it shows the median; curves show the range as well.
"""

from __future__ import annotations

import json
import textwrap
from collections import Counter
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass, field
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Any, ClassVar

import numpy as np
from numpy.typing import NDArray

from rig.analysis.axis import with_unit
from rig.analysis.branches.threshold import Share
from rig.analysis.pool import Arrays
from rig.analysis.studies.measures import one_unit
from rig.analysis.studies.runs import REPEAT, SAMPLE, StudyRuns
from rig.errors import OutputError, UsageError
from rig.extras import needed
from rig.machine.files import csv_table, write_file
from rig.printable import columns, counted
from rig.results import Result
from rig.view.palette import page, put

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure
    from xarray import Dataset

    from rig.analysis.studies.factors import Factor
    from rig.analysis.studies.search import SearchResult


Array = NDArray[np.float64]
COLUMNS = ("seed", "reason", "scene_json")
"""Names in the results beside those of parameters, dimensions and measures."""
SLIDES, OUTSIDE = "motion.slides", "modes.outside"
_FEW = 24  # points that the report lists one by one
_REASONS = 6  # different reasons in it
_COLOUR, _BAND, _LIGHT, _BEST = "#1d4f91", "#b9cce4", "#d1802f", "#c03a76"
_MOST = 6  # panels in a row of a scatter matrix
_PANEL = 3.2  # inches
_LINE = 18  # characters
_TICKS, _APART = 8, 0.08  # values of an axis that are its ticks, if they are further apart than a share of the axis


@dataclass(frozen=True)
class Indices:
    """Sobol indices of each measure, [measure, parameter]: the share of its variance due to one parameter.

    `first`: alone; `whole`: with all its interactions.
    """

    keys: tuple[str, ...]
    first: Array
    whole: Array


def check_path(path: Path) -> None:
    """Raise UsageError for what `save` could not write: another suffix, or a missing library."""
    if path.suffix != ".nc":
        raise UsageError(f"--to {path}: the name of a NetCDF file ends in .nc")
    needed("xarray", "data")
    needed("h5netcdf", "data")


def _suiting(result: StudyResult) -> dict[str, Callable[[StudyResult], Figure]]:
    """File name -> what draws it, for the figures that suit the plan."""
    plan = result.work.plan
    grid = [factor for factor in plan.grid if len(factor.axis.values) > 1]
    wanted: dict[str, Callable[[StudyResult], Figure]] = {}
    if np.isfinite(result.values).any():
        if len(grid) == 1:
            wanted["curves.png"] = lambda result: _curves(result, grid[0])
        elif grid:
            wanted["heat_map.png"] = lambda result: _heat_map(result, grid[0], grid[1])
        if plan.drawn and plan.rows > 1:
            wanted["scatter.png"] = _scatter
        if (indices := result.indices) is not None and np.isfinite(indices.whole).any():
            wanted["tornado.png"] = lambda result: _tornado(result, indices)
    return wanted


def measure_in_words(measure: str, unit: str) -> str:
    """Return a measure in words with its unit: "cycle.stick_share" is "stick share (cycle) [1]"."""
    source, _, rest = measure.partition(".")
    words = (f"{rest} ({source})" if rest else measure).replace("_", " ").replace(".", " ")
    return f"{words} [{unit or '1'}]"


def study_figure(result: StudyResult) -> Figure:
    """Return the first of the figures that suit the plan. Raises UsageError if there is none."""
    for make in _suiting(result).values():
        return make(result)
    values = "one point" if np.isfinite(result.values).any() else "no point has a value"
    raise UsageError(f"nothing to draw: {values}")


def search_figure(result: SearchResult) -> Figure:
    """Return the value over each parameter and over the course of the search."""
    count = len(result.factors) + 1
    title = measure_in_words(result.measure, result.unit)
    with page(9.6, 2.6 * count, f"{result.scene.name}: search", layout="constrained") as figure:
        top, *rest = figure.subplots(count, 1, squeeze=False)[:, 0]
        worst = -np.inf if result.largest else np.inf
        course = np.where(np.isfinite(result.values), result.values, worst)
        so_far = np.maximum.accumulate(course) if result.largest else np.minimum.accumulate(course)
        numbers = np.arange(1, len(course) + 1)
        top.plot(numbers, result.values, ".", ms=3.5, color=_BAND, label="points")
        top.plot(numbers, np.where(np.isfinite(so_far), so_far, np.nan), color=_COLOUR, label="best so far")
        top.set(xlabel="number of the evaluation", ylabel=title)
        top.legend(loc="best")
        for i, (axes, factor) in enumerate(zip(rest, result.factors)):
            axes.plot(result.points[:, i] / factor.axis.scale, result.values, ".", ms=3.5, color=_COLOUR, alpha=0.5)
            if result.best is not None:
                axes.plot(result.points[result.best, i] / factor.axis.scale, result.value, "o", color=_BEST, ms=6)
            axes.set(xlabel=factor.axis.title, ylabel=title)
        figure.align_ylabels()
    return figure


@contextmanager
def _page(result: StudyResult, width: float, height: float, what: str) -> Iterator[Figure]:
    title = f"{result.work.scene.name}: {what}, {counted(len(result.values), 'point')}"
    with page(width, height, title, layout="constrained") as figure:
        yield figure


def _over(result: StudyResult, measure: str, kept: list[Factor]) -> NDArray[np.float64]:
    """Values of a measure, [values of the kept parameters ..., everything else]."""
    names = list(result.work.plan.dimensions)
    at = [names.index(factor.key) for factor in kept]
    values = np.moveaxis(result.values_of(measure), at, range(len(at)))
    return values.reshape(*(len(factor.axis.values) for factor in kept), -1)


def _median(values: NDArray[np.float64]) -> NDArray[np.float64]:
    """Median over the last axis of what is not missing; nan where everything is."""
    some = np.asarray(np.isfinite(values).any(axis=-1))
    filled = np.where(some[..., None], values, 0.0)
    return np.where(some, np.nanmedian(filled, axis=-1), np.nan)


def _title(result: StudyResult, number: int) -> str:
    return measure_in_words(result.names[number], result.units[number])


def _curves(result: StudyResult, factor: Factor) -> Figure:
    count = len(result.names)
    with _page(result, 9.6, 1.4 + 2.4 * count, f"over {factor.axis.words}") as figure:
        x = factor.axis.shown_values
        order = np.argsort(x)
        for number, axes in enumerate(figure.subplots(count, 1, sharex=True, squeeze=False)[:, 0]):
            values = _over(result, result.names[number], [factor])[order]
            if values.shape[1] > 1:
                here = np.isfinite(values)
                low = np.where(here, values, np.inf).min(axis=1)
                high = np.where(here, values, -np.inf).max(axis=1)
                some = here.any(axis=1)
                axes.fill_between(x[order][some], low[some], high[some], color=_BAND, lw=0, label="range")
            label = "median" if values.shape[1] > 1 else None
            axes.plot(x[order], _median(values), "o-", ms=3.5, color=_COLOUR, label=label)
            axes.set_ylabel(_title(result, number).replace(" [", "\n["))
            if number == 0 and label:
                axes.legend(loc="best")
        axes.set_xlabel(factor.axis.title)
        figure.align_ylabels()
    return figure


def _heat_map(result: StudyResult, x: Factor, y: Factor) -> Figure:
    count = len(result.names)
    columns = min(count, 2)
    rows = -(-count // columns)
    hidden = len(result.values) > len(x.axis.values) * len(y.axis.values)
    what = "median over the others" if hidden else "grid"
    what += "" if np.isfinite(result.values[:, :count]).all() else " (white: no value)"
    with _page(result, 5.6 * columns, 0.6 + 4.2 * rows, what) as figure:
        panels = figure.subplots(rows, columns, squeeze=False, sharex=True, sharey=True).ravel()
        for number, axes in enumerate(panels):
            if number >= count:
                axes.set_axis_off()
                continue
            axes.grid(visible=False)
            values = _median(_over(result, result.names[number], [x, y]))
            order = np.argsort(x.axis.shown_values), np.argsort(y.axis.shown_values)
            shown = values[np.ix_(*order)].T
            mesh = axes.pcolormesh(
                x.axis.shown_values[order[0]], y.axis.shown_values[order[1]], shown, shading="nearest"
            )
            mesh.set_rasterized(True)
            for ticks, factor in ((axes.set_xticks, x), (axes.set_yticks, y)):
                at = np.sort(factor.axis.shown_values)
                if len(at) <= _TICKS and np.diff(at).min() > _APART * np.ptp(at):
                    ticks(at)
            bar = figure.colorbar(mesh, ax=axes, label=_title(result, number))
            bar.outline.set_visible(False)  # type: ignore[operator]
            axes.label_outer()
            if number + columns >= count:
                axes.set_xlabel(x.axis.title)
                axes.tick_params(labelbottom=True)
            if number % columns == 0:
                axes.set_ylabel(y.axis.title)
    return figure


def _scatter(result: StudyResult) -> Figure:
    """Every drawn parameter and measure against every other one; their histograms on the diagonal."""
    plan = result.work.plan
    keys = [factor.key for factor in plan.factors]
    named: list[tuple[str, NDArray[np.float64]]] = [
        (factor.axis.title, result.points[:, keys.index(factor.key)] / factor.axis.scale) for factor in plan.drawn
    ]
    named += [
        (_title(result, m), result.values[:, m]) for m in range(len(result.names)) if _varies(result.values[:, m])
    ]
    named = named[: max(_MOST, len(plan.drawn) + 1)]
    count = len(named)
    size = max(_PANEL * count / (1.0 + 0.12 * count), 5.0)
    with _page(result, size, size, "samples") as figure:
        panels = figure.subplots(count, count, squeeze=False)
        for row, column in np.ndindex(count, count):
            axes: Any = panels[row, column]
            _panel(axes, named[column][1], named[row][1], row, column)
            if column > row:
                continue
            outer = row == count - 1, column == 0 and (row > 0 or count == 1)
            axes.set_xlabel(_folded(named[column][0]) if outer[0] else "")
            axes.set_ylabel(_folded(named[row][0]) if outer[1] else "")
            axes.tick_params(labelbottom=outer[0], labelleft=outer[1], labelsize=8)
            axes.locator_params(nbins=4)
        figure.align_labels()
    return figure


def _panel(axes: Axes, x: NDArray[np.float64], y: NDArray[np.float64], row: int, column: int) -> None:
    from scipy.stats import spearmanr

    axes.grid(visible=False)
    here = np.isfinite(x) & np.isfinite(y)
    if column == row:
        axes.hist(x[here], bins=min(20, max(5, here.sum() // 6)), color=_BAND)
        axes.set_yticks([])
    elif column < row:
        axes.plot(x[here], y[here], ".", ms=3.5, color=_COLOUR, alpha=0.6, mec="none")
    else:
        axes.set_axis_off()
        if here.sum() > 2 and np.ptp(x[here]) > 0.0 and np.ptp(y[here]) > 0.0:
            rank = round(float(spearmanr(x[here], y[here]).statistic), 2) + 0.0  # no -0.00
            axes.text(0.5, 0.5, f"rank\ncorrelation\n{rank:.2f}", ha="center", va="center", transform=axes.transAxes)


def _tornado(result: StudyResult, indices: Indices) -> Figure:
    """For each measure the shares of its variance, the largest on top: alone, and with all interactions."""
    drawn = {factor.key: factor for factor in result.work.plan.drawn}
    shown = [m for m in range(len(result.names)) if np.isfinite(indices.whole[m]).all()]
    count = len(indices.keys)
    with _page(result, 9.6, 1.0 + len(shown) * (0.9 + 0.45 * count), "Sobol indices") as figure:
        for m, axes in zip(shown, figure.subplots(len(shown), 1, sharex=True, squeeze=False)[:, 0]):
            order = np.argsort(indices.whole[m])
            axes.barh(range(count), indices.whole[m][order], height=0.7, color=_BAND, label="with all interactions")
            axes.barh(range(count), indices.first[m][order], height=0.35, color=_COLOUR, label="alone")
            axes.set_yticks(range(count), [drawn[indices.keys[i]].axis.words for i in order])
            axes.set_title(_title(result, m))
            axes.grid(visible=False, axis="y")
            axes.axvline(0.0, color="black", lw=0.8)
        axes.set_xlabel("share of the variance")
        figure.legend(*axes.get_legend_handles_labels(), loc="outside lower right", ncols=2)
    return figure


def _varies(values: NDArray[Any]) -> bool:
    here = values[np.isfinite(values)]
    return here.size > 1 and float(np.ptp(here)) > 0.0


def _folded(title: str) -> str:
    """A title in short lines, its unit on a line of its own."""
    words, bracket, unit = title.partition(" [")
    return "\n".join([*textwrap.wrap(words, _LINE), *([f"[{unit}"] if bracket else [])])


@dataclass(frozen=True)
class StudyResult(Result):
    """The result of `rig.study`. Printed, it is the report."""

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
        return np.array([[point[key] for key in keys] for point in map(plan.values, range(plan.total))])

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
                sobol = sobol_indices(func={"f_A": twice[:, :n], "f_B": twice[:, n : 2 * n], "f_AB": ab}, n=n)
                first[m], whole[m] = sobol.first_order.reshape(2, -1)[0], sobol.total_order.reshape(2, -1)[0]
        return Indices(tuple(factor.key for factor in plan.drawn), first, whole)

    def text(self) -> str:
        """Return the report as text."""
        return "\n".join(self._lines())

    def _lines(self) -> Iterator[str]:
        plan = self.work.plan
        over = ", ".join(
            f"{factor.key} {factor.distribution or counted(len(factor.axis.values), 'value')}"
            for factor in plan.factors
        )
        sizes = " x ".join(map(str, plan.dimensions.values()))
        yield f"{self.work.scene.name}: {counted(len(self.values), 'point')} ({sizes}) over {over or 'seeds'}"
        yield from (f"  {line}" for line in self.work.belief)
        if self.work.left_out:
            yield f"  {self.work.left_out}"
        if len(self.values) <= _FEW:
            yield from ["", *self._table()]
        yield ""
        rows: list[tuple[str, ...]] = [("measure", "median", "least", "greatest", "unit", "missing")]
        for m, (name, unit) in enumerate(zip(self.names, self.units)):
            v = self.values[np.isfinite(self.values[:, m]), m]
            numbers = (f"{np.median(v):.5g}", f"{v.min():.5g}", f"{v.max():.5g}") if v.size else ("-", "-", "-")
            rows.append((name, *numbers, unit, f"{len(self.values) - v.size or ''}"))
        yield from columns(rows, "<>>><>")
        if SLIDES in self.names:
            yield from self._share(self.values[:, self.names.index(SLIDES)])
        if OUTSIDE in self.names and (outside := np.sum(self.values[:, self.names.index(OUTSIDE)] == 1.0)):
            yield f"  warning: {outside} of {len(self.values)} points lie outside of the trained range ({OUTSIDE} is 1)"
        if (shares := self.indices) is not None:
            yield from ["", *self._index_table(shares)]
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
        texts = [
            f"{factor.key} = {factor.axis.text(v)}" for factor, v in zip(self.work.plan.factors, self.points[point])
        ]
        return ", ".join([*texts, f"seed {self.work.plan.seed_of(point)}"])

    def _table(self) -> Iterator[str]:
        rows = [(*(factor.axis.label for factor in self.work.plan.factors), *map(with_unit, self.names, self.units))]
        for at, values in zip(self.points, self.values):
            keys = (f"{v / factor.axis.scale:.6g}" for factor, v in zip(self.work.plan.factors, at))
            rows.append((*keys, *(f"{v:.6g}" if np.isfinite(v) else "-" for v in values)))
        return columns(rows, "<" * len(self.work.plan.factors) + ">" * len(self.names))

    def _index_table(self, indices: Indices) -> Iterator[str]:
        rows = [("share of the variance", *(f"{key}" for key in indices.keys))]
        for m, name in enumerate(self.names):
            pairs = zip(indices.first[m], indices.whole[m])
            rows.append((name, *(f"{a:.2f} alone, {b:.2f} in all" if np.isfinite(a) else "-" for a, b in pairs)))
        return columns(rows, "<" + ">" * len(indices.keys))

    def records(self) -> Iterator[dict[str, Any]]:
        """Yield every point as a flat record: parameters (SI), seed, measures, reason."""
        plan = self.work.plan
        for k, (at, values) in enumerate(zip(self.points.tolist(), self.values.tolist())):
            record: dict[str, Any] = {factor.key: value for factor, value in zip(plan.factors, at)}
            yield record | {"seed": plan.seed_of(k)} | dict(zip(self.names, values)) | {"reason": self.reasons[k]}

    def csv(self) -> str:
        """Return every point as a line of a CSV file with the units in its head; parameters in SI."""
        measures = map(with_unit, self.names, self.units)
        head = [*(factor.axis.si_label for factor in self.work.plan.factors), "seed", *measures, "reason"]
        return csv_table([head, *(record.values() for record in self.records())]).decode()

    def to_json(self) -> dict[str, Any]:
        """Return the result as JSON values; parameters in SI."""
        plan, indices = self.work.plan, self.indices
        return {
            "scene": self.work.scene.name,
            "over": {factor.key: str(factor.distribution or list(factor.axis.values)) for factor in plan.factors},
            "dimensions": plan.dimensions,
            "belief": self.work.belief,
            "left_out": self.work.left_out,
            "units": dict(zip(self.names, self.units)) | {factor.key: factor.axis.unit for factor in plan.factors},
            "points": list(self.records()),
            "indices": None if indices is None else {
                name: {key: {"first": first[i], "whole": whole[i]} for i, key in enumerate(indices.keys)}
                for name, first, whole in zip(self.names, indices.first.tolist(), indices.whole.tolist())
            },
            "recordings": {str(point): str(path) for point, path in self.recordings.items()},
            "folder": str(self.folder),
        }  # fmt: skip

    FIGURE: ClassVar = "rig.analysis.studies.result:study_figure"

    def to_xarray(self) -> Dataset:
        """Return the result as a Dataset: measures, seed and reason over the dimensions of the plan.

        Drawn values are over sample. Every variable has `units` in SI and `long_name`; attributes state scene, plan and
        provenance. Raises rig.errors.UsageError if xarray is not installed.
        """
        xarray: Any = needed("xarray", "data")
        plan, scene = self.work.plan, self.work.scene
        names, shape = tuple(plan.dimensions), tuple(plan.dimensions.values())

        def about(unit: str, words: str) -> dict[str, str]:
            return {"units": unit or "1", "long_name": words}

        coordinates: dict[str, Any] = {
            factor.key: ((factor.key,), np.array(factor.axis.values), about(factor.axis.unit, factor.axis.words))
            for factor in plan.grid
        }
        for factor, draws in zip(plan.drawn, plan.draws.T):
            words = about(factor.axis.unit, factor.axis.words) | {"distribution": str(factor.distribution)}
            coordinates[factor.key] = ((SAMPLE,), draws, words)
        if plan.repeat > 1:
            coordinates[REPEAT] = ((REPEAT,), np.arange(plan.repeat))
        variables: dict[str, Any] = {  # NetCDF allows no slash in a name
            name.replace("/", "_"): (names, self.values_of(name), about(unit, name))
            for name, unit in zip(self.names, self.units)
        }
        seeds = np.array([plan.seed_of(k) for k in range(plan.total)]).reshape(shape)
        variables["seed"] = (names, seeds, {"long_name": "seed of the run"})
        reasons = np.array(self.reasons, dtype=object).reshape(shape)
        variables["reason"] = (names, reasons, {"long_name": "why a value is missing"})
        attributes: dict[str, Any] = {f"provenance_{name}": text for name, text in self.provenance.items()}
        attributes |= {"scene": scene.name, "sampling": plan.sampling, "study_seed": plan.seed,
                       "scene_json": scene.to_json(), "measures": json.dumps(self.names)}  # fmt: skip
        made: Dataset = xarray.Dataset(variables, coordinates, attributes)
        for coordinate in made.coords.values():
            coordinate.encoding["_FillValue"] = None  # CF allows no missing values in a coordinate
        return made

    def save(self, path: Path | str) -> None:
        """Write the Dataset as NetCDF (.nc), completely or not at all.

        Raises rig.errors.UsageError, OutputError.
        """
        path = Path(path)
        check_path(path)
        made = self.to_xarray()
        try:
            made["scene_json"] = ((), made.attrs.pop("scene_json"))  # HDF5 limits attributes to 64 KiB
            path.parent.mkdir(parents=True, exist_ok=True)
            write_file(path, bytes(made.to_netcdf(engine="h5netcdf")))  # HDF5 itself tells a full disk in four lines
        except OSError as fault:
            raise OutputError(f"{path} cannot be written: {fault.strerror or fault}") from None

    def draw(self, folder: Path | str) -> list[Path]:
        """Draw the figures that suit the plan into a folder (PNG), and return them."""
        paths = []
        for name, make in _suiting(self).items():
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
        told, raw = [str(rows[k]["units"][m]) for k in order], values[:, m].copy()  # a function tells its unit
        values[:, m], units[m] = one_unit(raw.tolist(), told)
        for k in np.flatnonzero(np.isfinite(raw) & ~np.isfinite(values[:, m])).tolist():
            why = f"{measure.name} has the unit {told[k] or '1'} here, {units[m]} at other points"
            reasons[k] = "; ".join(filter(None, (reasons[k], why)))
    return StudyResult(work, values, tuple(units), tuple(reasons), provenance, folder)
