"""The report of `rig loop` as a picture: the delay budget as a bar, and the decay over delay, jitter and loss."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

from rig.analysis.loop_report import LoopReport
from rig.view.palette import ALARM, GREY, LINES
from rig.view.run_figure import STYLE
from rig.view.save_figure import put

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure


def draw(report: LoopReport, path: Path | str) -> None:
    """Draw `report` into the file `path` (PNG or another format of matplotlib, by its suffix); makes directories."""
    import matplotlib as mpl
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    path = Path(path)
    path.parent.mkdir(parents=True, exist_ok=True)
    with mpl.rc_context(STYLE):  # type: ignore[arg-type]
        figure = Figure(figsize=(12.8, 6.6), dpi=125, facecolor="white")
        FigureCanvasAgg(figure)
        _compose(figure, report)
        put(figure, path)


def _compose(figure: Figure, report: LoopReport) -> None:
    grid = figure.add_gridspec(2, 3, height_ratios=(1, 1.5), left=0.07, right=0.985, top=0.86, bottom=0.09,
                               hspace=0.5, wspace=0.24)  # fmt: skip
    figure.suptitle(f"{report.scene}: loop of {report.found.controller}", x=0.07, ha="left", weight="bold")
    _budget(figure.add_subplot(grid[0, :]), report)
    for column, curve in enumerate(report.curves):
        axes = figure.add_subplot(grid[1, column])
        scale, unit = (1e2, "%") if curve.key == "loss" else (1e3, "ms")
        axes.plot([scale * v for v in curve.values], [-g for g in curve.growth], "o-", color=LINES[0], ms=4)
        axes.axhline(0.0, color=ALARM, lw=1.0)
        axes.set_xlabel(f"{curve.key} of the sensor's link [{unit}]")
        if not column:
            axes.set_ylabel("decay rate [1/s]")


def _budget(axes: Axes, report: LoopReport) -> None:
    """A bar of the delays one after the other, then the margin that is left."""
    at = 0.0
    margin = report.found.margins
    shown = [one for one in report.items if one.seconds > 0.0]
    for i, one in enumerate(shown):
        axes.barh(0.0, 1e3 * one.seconds, left=at, height=0.5, color=LINES[i % len(LINES)], label=one.part)
        at += 1e3 * one.seconds
    if margin is not None and margin["delay"] < 1e3:
        bus = sum(1e3 * one.seconds for one in report.items if one.part.startswith("bus"))
        left = max(1e3 * margin["delay"] - bus, 0.0)
        axes.barh(0.0, left, left=at, height=0.5, color="white", edgecolor=GREY, hatch="//", label="delay margin")
        at += left
    axes.set_xlim(0.0, at or 1.0)
    axes.set_ylim(-0.5, 0.5)
    axes.set_yticks([])
    axes.set_xlabel("delay [ms]")
    axes.set_title("delay budget")
    axes.legend(loc="upper center", bbox_to_anchor=(0.5, -0.32), ncols=5, fontsize=8.5)
