"""The figures of a study, and of a search.

They are curves or a heat map over a grid, a scatter matrix of samples, a tornado of Sobol indices. Of dimensions that a
figure does not show (samples, repeats, further parameters) it shows the median; curves show the range as well.
"""

from __future__ import annotations

import textwrap
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from rig.errors import UsageError
from rig.printable import counted
from rig.view.palette import page

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

    from rig.analysis.studies.factors import Factor
    from rig.analysis.studies.result import Indices, StudyResult
    from rig.analysis.studies.search import SearchResult

_COLOUR = "#1d4f91"
_BAND = "#b9cce4"
_BEST = "#c03a76"
_MOST = 6  # panels in a row of a scatter matrix
_PANEL = 3.2  # inches
_LINE = 18  # characters
_TICKS = 8  # most values of an axis that are its ticks,
_APART = 0.08  # if they are further apart than this share of the axis


def suiting(result: StudyResult) -> dict[str, Callable[[StudyResult], Figure]]:
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
        indices = result.indices
        if indices is not None and np.isfinite(indices.whole).any():
            wanted["tornado.png"] = lambda result: _tornado(result, indices)
    return wanted


def measure_in_words(measure: str, unit: str) -> str:
    """Return a measure in words with its unit: "cycle.stick_share" is "stick share (cycle) [1]"."""
    source, _, rest = measure.partition(".")
    words = (f"{rest} ({source})" if rest else measure).replace("_", " ").replace(".", " ")
    return f"{words} [{unit or '1'}]"


def study_figure(result: StudyResult) -> Figure:
    """Return the first of the figures that suit the plan. Raises UsageError if there is none."""
    for make in suiting(result).values():
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
                known = np.isfinite(values)
                low = np.where(known, values, np.inf).min(axis=1)
                high = np.where(known, values, -np.inf).max(axis=1)
                some = known.any(axis=1)
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
            along = np.argsort(x.axis.shown_values)
            up = np.argsort(y.axis.shown_values)
            shown = values[np.ix_(along, up)].T
            mesh = axes.pcolormesh(x.axis.shown_values[along], y.axis.shown_values[up], shown, shading="nearest")
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
    named: list[tuple[str, NDArray[np.float64]]] = []
    for factor in plan.drawn:
        drawn = result.points[:, keys.index(factor.key)]
        named.append((factor.axis.title, drawn / factor.axis.scale))
    for m, values in enumerate(result.values.T[: len(result.names)]):
        if _varies(values):
            named.append((_title(result, m), values))
    named = named[: max(_MOST, len(plan.drawn) + 1)]
    count = len(named)
    size = max(_PANEL * count / (1.0 + 0.12 * count), 5.0)
    with _page(result, size, size, "samples") as figure:
        panels = figure.subplots(count, count, squeeze=False)
        for row, column in np.ndindex(count, count):
            axes: Any = panels[row, column]
            x_title, x = named[column]
            y_title, y = named[row]
            _panel(axes, x, y, row, column)
            if column > row:
                continue
            bottom = row == count - 1
            left = column == 0 and (row > 0 or count == 1)
            axes.set_xlabel(_folded(x_title) if bottom else "")
            axes.set_ylabel(_folded(y_title) if left else "")
            axes.tick_params(labelbottom=bottom, labelleft=left, labelsize=8)
            axes.locator_params(nbins=4)
        figure.align_labels()
    return figure


def _panel(axes: Axes, x: NDArray[np.float64], y: NDArray[np.float64], row: int, column: int) -> None:
    from scipy.stats import spearmanr

    axes.grid(visible=False)
    known = np.isfinite(x) & np.isfinite(y)
    x = x[known]
    y = y[known]
    if column == row:
        axes.hist(x, bins=min(20, max(5, len(x) // 6)), color=_BAND)
        axes.set_yticks([])
    elif column < row:
        axes.plot(x, y, ".", ms=3.5, color=_COLOUR, alpha=0.6, mec="none")
    else:
        axes.set_axis_off()
        if len(x) > 2 and np.ptp(x) > 0.0 and np.ptp(y) > 0.0:
            rank = round(float(spearmanr(x, y).statistic), 2) + 0.0  # no -0.00
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
    known = values[np.isfinite(values)]
    return known.size > 1 and float(np.ptp(known)) > 0.0


def _folded(title: str) -> str:
    """A title in short lines, its unit on a line of its own."""
    words, bracket, unit = title.partition(" [")
    lines = textwrap.wrap(words, _LINE)
    if bracket:
        lines.append(f"[{unit}")
    return "\n".join(lines)
