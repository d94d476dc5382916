"""The figures of studies: curves or a heat map over a grid, a scatter matrix of samples, a tornado of Sobol indices;
and that of a search.

Of dimensions that a figure does not show (samples, repeats, further parameters) it shows the median; curves show the
range as well.
"""

from __future__ import annotations

import textwrap
from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from rig.analysis.studies.words import in_words
from rig.errors import UsageError
from rig.view.run_figure import STYLE
from rig.view.save_figure import page, put

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

    from rig.analysis.studies.factors import Factor
    from rig.analysis.studies.result_data import Indices, StudyData
    from rig.analysis.studies.search_result import SearchResult

_COLOUR, _BAND, _LIGHT, _BEST = "#1d4f91", "#b9cce4", "#d1802f", "#c03a76"
_MOST = 6  # panels in a row of a scatter matrix
_PANEL = 3.2  # inches
_LINE = 18  # characters
_TICKS, _APART = 8, 0.08  # values of an axis that are its ticks, if they are further apart than a share of the axis


def _suiting(found: StudyData) -> dict[str, Callable[[StudyData], Figure]]:
    """File name -> what draws it, for the figures that suit the plan."""
    plan = found.work.plan
    grid = [one for one in plan.grid if len(one.axis.values) > 1]
    wanted: dict[str, Callable[[StudyData], Figure]] = {}
    if np.isfinite(found.values).any():
        if len(grid) == 1:
            wanted["curves.png"] = lambda found: _curves(found, grid[0])
        elif grid:
            wanted["heat_map.png"] = lambda found: _heat_map(found, grid[0], grid[1])
        if plan.drawn and plan.rows > 1:
            wanted["scatter.png"] = _scatter
        if (indices := found.indices) is not None and np.isfinite(indices.whole).any():
            wanted["tornado.png"] = lambda found: _tornado(found, indices)
    return wanted


def draw(found: StudyData, folder: Path) -> list[Path]:
    """Draw the figures that suit the plan into `folder` (PNG); return their files."""
    paths = []
    for name, make in _suiting(found).items():
        put(_styled(make, found), folder / name)
        paths.append(folder / name)
    return paths


def study_figure(found: StudyData) -> Figure:
    """Return the first of the figures that suit the plan. Raises UsageError if there is none."""
    for make in _suiting(found).values():
        return _styled(make, found)
    values = "one point" if np.isfinite(found.values).any() else "no point has a value"
    raise UsageError(f"nothing to draw: {values}")


def search_figure(found: SearchResult) -> Figure:
    """Return the value over each parameter and over the course of the search."""
    count = len(found.factors) + 1
    title = in_words(found.measure, found.unit)
    with page(STYLE, 9.6, 2.6 * count, layout="constrained") as figure:
        figure.suptitle(f"{found.scene.title}: search", x=0.01, ha="left", fontweight="bold")
        top, *rest = figure.subplots(count, 1, squeeze=False)[:, 0]
        worst = -np.inf if found.largest else np.inf
        course = np.where(np.isfinite(found.values), found.values, worst)
        so_far = np.maximum.accumulate(course) if found.largest else np.minimum.accumulate(course)
        numbers = np.arange(1, len(course) + 1)
        top.plot(numbers, found.values, ".", ms=3.5, color=_BAND, label="points")
        top.plot(numbers, np.where(np.isfinite(so_far), so_far, np.nan), color=_COLOUR, label="best so far")
        top.set(xlabel="number of the evaluation", ylabel=title)
        top.legend(loc="best")
        for i, (axes, one) in enumerate(zip(rest, found.factors)):
            axes.plot(found.points[:, i] / one.axis.scale, found.values, ".", ms=3.5, color=_COLOUR, alpha=0.5)
            if found.best is not None:
                axes.plot(found.points[found.best, i] / one.axis.scale, found.value, "o", color=_BEST, ms=6)
            axes.set(xlabel=one.axis.title, ylabel=title)
        figure.align_ylabels()
    return figure


def _styled(make: Callable[[StudyData], Figure], found: StudyData) -> Figure:
    import matplotlib as mpl

    with mpl.rc_context(STYLE):  # type: ignore[arg-type]
        return make(found)


def _figure(found: StudyData, width: float, height: float, what: str) -> Figure:
    count = len(found.values)
    with page(STYLE, width, height, layout="constrained") as figure:
        figure.suptitle(f"{found.work.scene.title}: {what}, {count} points", x=0.01, ha="left", fontweight="bold")
    return figure


def _over(found: StudyData, measure: str, kept: list[Factor]) -> NDArray[np.float64]:
    """Values of a measure, [values of the kept parameters ..., everything else]."""
    names = list(found.work.plan.dimensions)
    at = [names.index(one.key) for one in kept]
    values = np.moveaxis(found.values_of(measure), at, range(len(at)))
    return values.reshape(*(len(one.axis.values) for one in kept), -1)


def _median(values: NDArray[np.float64]) -> NDArray[np.float64]:
    """Median over the last axis of what is not missing; nan where everything is."""
    some = np.asarray(np.isfinite(values).any(axis=-1))
    filled = np.where(some[..., None], values, 0.0)
    return np.where(some, np.nanmedian(filled, axis=-1), np.nan)


def _title(found: StudyData, number: int) -> str:
    return in_words(found.names[number], found.units[number])


def _curves(found: StudyData, factor: Factor) -> Figure:
    count = len(found.names)
    figure = _figure(found, 9.6, 1.4 + 2.4 * count, f"over {factor.axis.words}")
    x = factor.axis.shown_values
    order = np.argsort(x)
    for number, axes in enumerate(figure.subplots(count, 1, sharex=True, squeeze=False)[:, 0]):
        values = _over(found, found.names[number], [factor])[order]
        if values.shape[1] > 1:
            here = np.isfinite(values)
            low = np.where(here, values, np.inf).min(axis=1)
            high = np.where(here, values, -np.inf).max(axis=1)
            some = here.any(axis=1)
            axes.fill_between(x[order][some], low[some], high[some], color=_BAND, lw=0, label="range")
        label = "median" if values.shape[1] > 1 else None
        axes.plot(x[order], _median(values), "o-", ms=3.5, color=_COLOUR, label=label)
        axes.set_ylabel(_title(found, number).replace(" [", "\n["))
        if number == 0 and label:
            axes.legend(loc="best")
    axes.set_xlabel(factor.axis.title)
    figure.align_ylabels()
    return figure


def _heat_map(found: StudyData, x: Factor, y: Factor) -> Figure:
    count = len(found.names)
    columns = min(count, 2)
    rows = -(-count // columns)
    hidden = len(found.values) > len(x.axis.values) * len(y.axis.values)
    what = "median over the others" if hidden else "grid"
    what += "" if np.isfinite(found.values[:, :count]).all() else " (white: no value)"
    figure = _figure(found, 5.6 * columns, 0.6 + 4.2 * rows, what)
    panels = figure.subplots(rows, columns, squeeze=False, sharex=True, sharey=True).ravel()
    for number, axes in enumerate(panels):
        if number >= count:
            axes.set_axis_off()
            continue
        axes.grid(visible=False)
        values = _median(_over(found, found.names[number], [x, y]))
        order = np.argsort(x.axis.shown_values), np.argsort(y.axis.shown_values)
        shown = values[np.ix_(*order)].T
        mesh = axes.pcolormesh(x.axis.shown_values[order[0]], y.axis.shown_values[order[1]], shown, shading="nearest")
        mesh.set_rasterized(True)
        for ticks, factor in ((axes.set_xticks, x), (axes.set_yticks, y)):
            at = np.sort(factor.axis.shown_values)
            if len(at) <= _TICKS and np.diff(at).min() > _APART * np.ptp(at):
                ticks(at)
        bar = figure.colorbar(mesh, ax=axes, label=_title(found, number))
        bar.outline.set_visible(False)  # type: ignore[operator]
        axes.label_outer()
        if number + columns >= count:
            axes.set_xlabel(x.axis.title)
            axes.tick_params(labelbottom=True)
        if number % columns == 0:
            axes.set_ylabel(y.axis.title)
    return figure


def _scatter(found: StudyData) -> Figure:
    """Every drawn parameter and measure against every other one; their histograms on the diagonal."""
    plan = found.work.plan
    keys = [one.key for one in plan.factors]
    named: list[tuple[str, NDArray[np.float64]]] = [
        (one.axis.title, found.points[:, keys.index(one.key)] / one.axis.scale) for one in plan.drawn
    ]
    named += [(_title(found, m), found.values[:, m]) for m in range(len(found.names)) if _varies(found.values[:, m])]
    named = named[: max(_MOST, len(plan.drawn) + 1)]
    count = len(named)
    size = max(_PANEL * count / (1.0 + 0.12 * count), 5.0)
    figure = _figure(found, size, size, "samples")
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


def _tornado(found: StudyData, indices: Indices) -> Figure:
    """For each measure the shares of its variance, the largest on top: alone, and with all interactions."""
    drawn = {one.key: one for one in found.work.plan.drawn}
    shown = [m for m in range(len(found.names)) if np.isfinite(indices.whole[m]).all()]
    count = len(indices.keys)
    figure = _figure(found, 9.6, 1.0 + len(shown) * (0.9 + 0.45 * count), "Sobol indices")
    for m, axes in zip(shown, figure.subplots(len(shown), 1, sharex=True, squeeze=False)[:, 0]):
        order = np.argsort(indices.whole[m])
        axes.barh(range(count), indices.whole[m][order], height=0.7, color=_BAND, label="with all interactions")
        axes.barh(range(count), indices.first[m][order], height=0.35, color=_COLOUR, label="alone")
        axes.set_yticks(range(count), [drawn[indices.keys[i]].axis.words for i in order])
        axes.set_title(_title(found, m))
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
