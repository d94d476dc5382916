"""A map as a picture: regions over two axes; over one axis a bifurcation diagram; the boundary of dither."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from rig.analysis.map.dither import Boundary
from rig.analysis.map.job import CARRIED, RUNS
from rig.analysis.map.result import MEANING, ONE, REGIONS, SHOWN, THREE, Lines, Map
from rig.scenes.axis import heading
from rig.view.curves import apart, plain, read_in
from rig.view.palette import AMBER, BARE, BLUE, GREEN, LINES, VERMILION, page

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

COLOURS = ("#9d9d9d", "#d5e8dc", "#f6dfae", "#e7a79a", "#b9b9e0")  # of REGIONS
RUN_STYLES = {"up": (BLUE, "^"), "down": (VERMILION, "v"), "near": (GREEN, "x"), "far": (AMBER, "+")}
_LABELS = {"up": "run-up", "down": "run-down", "near": "near start", "far": "standing start"}


def figure(result: Map | Boundary, lines: Lines = ()) -> Figure:
    """Return the figure of what `rig.map` found; `lines` over two parameters, (name, x, y) in SI."""
    with page(9.6, 6.4, style=BARE, layout="constrained") as figure:
        if isinstance(result, Boundary):
            _dither(figure.add_subplot(), result)
        elif result.job.y is None:
            _bifurcation(figure, result)
        else:
            _regions(figure.add_subplot(), result, lines)
        axes = [axis for axis in (result.job.x, result.job.y) if axis is not None]
        heading(figure, result.job.scene, axes, "steady-state behaviour")
    return figure


def _regions(axes: Axes, result: Map, lines: Lines) -> None:
    from matplotlib.colors import ListedColormap

    job = result.job
    assert job.y is not None
    x, y = job.x.shown_values, job.y.shown_values
    mesh = axes.pcolormesh(x, y, result.regions, cmap=ListedColormap(COLOURS), vmin=-0.5, vmax=4.5, shading="nearest")
    mesh.set_rasterized(True)
    scale = job.x.scale
    for (name, along, up), colour in zip(lines, LINES * len(lines)):
        axes.plot(along / scale, up / job.y.scale, color=colour, lw=2.0, label=name)
    if any(map(len, result.onsets)) and not lines:
        onsets = []
        for row, values in enumerate(result.onsets):
            for value in values if len(values) else [np.nan]:  # no line leads over an empty row
                onsets.append((value / scale, y[row]))
        _line(axes, np.array(onsets), "-", "black", "", "sliding loses stability (eigenvalue)")
    for number, run in enumerate(("up", "down")):
        ends = result.ends[number].mean(axis=1) / scale
        if not np.isnan(ends).all():
            colour, marker = RUN_STYLES[run]
            style = (" ", "black") if lines else ("-", colour)  # simulated points beside computed curves
            _line(axes, np.column_stack([ends, y]), *style, marker, f"{_LABELS[run]} loses vibration")
    axes.set(xlabel=job.x.title, ylabel=job.y.title, xlim=(x[0], x[-1]), ylim=(y[0], y[-1]))
    axes.margins(0.0)
    _legend(axes, _regions_shown(result))


def _line(axes: Axes, points: Any, style: str, colour: str, marker: str, label: str) -> None:
    """Draw boundary points (nan: a row without one), joined from row to row where each of both has one."""
    rows = points[~np.isnan(points[:, 0]), 1]
    joined = len(np.unique(rows)) == len(rows)
    few = marker if len(rows) <= 40 else ""
    axes.plot(points[:, 0], points[:, 1], style if joined else ".", color=colour, marker=few, ms=4, label=label)


def _regions_shown(result: Map) -> dict[int, str]:
    """The regions of a map with their meaning."""
    labels = {}
    for region in SHOWN:
        if (result.regions == region).any():
            labels[region] = f"{REGIONS[region]}  {MEANING[region]}"
    return labels


def _legend(axes: Axes, labels: dict[int, str], *others: Axes) -> None:
    from matplotlib.patches import Patch

    handles: list[Any] = [Patch(color=COLOURS[region], label=label) for region, label in labels.items()]
    for panel in (*others, axes):
        handles += panel.get_legend_handles_labels()[0]
    axes.legend(handles=handles, loc="upper left", bbox_to_anchor=(0.0, -0.11), ncols=3)


def _bifurcation(figure: Figure, result: Map) -> None:
    x = result.job.x.shown_values
    settings = result.job.settings
    panels = figure.subplots(3, 1, sharex=True, height_ratios=(2.4, 1.2, 1.0))
    top, middle, bottom = panels
    edges = np.concatenate([[x[0]], 0.5 * (x[1:] + x[:-1]), [x[-1]]])
    for axes in panels:
        for i, region in enumerate(result.regions[0].tolist()):
            axes.axvspan(edges[i], edges[i + 1], color=COLOURS[region], lw=0, zorder=0)
        for onset in result.onsets[0]:
            label = "sliding loses stability (eigenvalue)" if axes is bottom else None
            axes.axvline(onset / result.job.x.scale, color="black", lw=1.0, ls="--", label=label)
    for run in settings.runs:
        number = RUNS.index(run)
        colour, marker = RUN_STYLES[run]
        carried = run in CARRIED
        style: dict[str, Any] = {"color": colour, "marker": marker, "ms": 5.5 if carried else 3.5, "mfc": "none"}
        style |= {"lw": 0.9 if carried else 0.0, "ls": "--" if run == "down" else "-"}
        jumps = np.diff(result.moves[number, 0]) != 0
        for name in ("low", "high"):
            label = _LABELS[run] if name == "high" else None
            top.plot(*apart(x, result.tables[name][number, 0], jumps), label=label, **style)
        section = result.tables["section"][number, 0]
        top.plot(np.repeat(x, section.shape[1]), section.ravel(), ".", color=colour, ms=1.5)
        middle.plot(*apart(x, result.tables["rms"][number, 0], jumps), **style)
        bottom.plot(*apart(x, result.tables["share"][number, 0], jumps), **style)
    unit = read_in(top.yaxis, result.unit, max(map(abs, top.get_ylim())))
    read_in(middle.yaxis, result.unit, max(map(abs, top.get_ylim())))
    top.set_ylabel(f"{plain(settings.output)} [{unit}]\nextremes, local maxima")
    middle.set_ylabel(f"rms about\nthe mean [{unit}]")
    bottom.set_ylabel("share of\ntime stuck")
    bottom.set_xlabel(result.job.x.title)
    _legend(bottom, _regions_shown(result), top)
    bottom.get_legend().set_bbox_to_anchor((0.0, -0.42))  # type: ignore[union-attr]
    top.set_xlim(edges[0], edges[-1])
    figure.align_ylabels(panels)


def _dither(axes: Axes, result: Boundary) -> None:
    x, y = result.job.x, result.job.y
    assert y is not None
    low = y.shown_values[0]
    high = y.shown_values[-1]
    edge = np.clip(result.averaged / y.scale, low, high)
    axes.fill_between(x.shown_values, low, edge, color=COLOURS[THREE], lw=0)
    axes.fill_between(x.shown_values, edge, high, color=COLOURS[ONE], lw=0)
    for theory, style, label in ((result.averaged, "k", "averaged"), (result.leading, "k:", "leading order")):
        axes.plot(x.shown_values, np.where(np.isinf(theory), np.nan, theory) / y.scale, style, label=label)
    known = np.isfinite(result.simulated).all(axis=1)
    ends = result.simulated[known]
    middle = ends.mean(axis=1) / y.scale
    half = 0.5 * np.diff(ends, axis=1).ravel() / y.scale
    axes.errorbar(x.shown_values[known], middle, half, fmt="o", ms=4, color=RUN_STYLES["up"][0], label="simulated")
    axes.set(xlabel=x.title, ylabel=y.title)
    axes.margins(0.0)
    _legend(axes, {ONE: "dither keeps the rig sliding", THREE: "sliding is lost"})
