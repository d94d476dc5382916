"""A sweep as a picture: growth and frequency over the key, and the root locus."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from rig.analysis.sweep import Sweep
from rig.view.run_figure import STYLE
from rig.view.save_figure import put

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

_COLOURS = ("#1d4f91", "#c03a76", "#2a9d77", "#d1802f", "#7a5fb0", "#5a5a5a")
_MARK = {"flutter": "o", "divergence": "s", "jump": "D", "jamming": "X"}
_ALARM = "#b5322f"


def draw(sweep: Sweep, path: Path | str) -> None:
    """Draw `sweep` into the file `path` (PNG, or another format of matplotlib, by its suffix). Directories are made."""
    import matplotlib as mpl
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    path = Path(path)
    path.parent.mkdir(parents=True, exist_ok=True)
    with mpl.rc_context(STYLE):  # type: ignore[arg-type]
        figure = Figure(figsize=(12.8, 6.6), dpi=125, facecolor="white")
        FigureCanvasAgg(figure)
        _compose(figure, sweep)
        put(figure, path)


def _compose(figure: Figure, sweep: Sweep) -> None:
    grid = figure.add_gridspec(2, 2, width_ratios=(1.25, 1), left=0.07, right=0.985, top=0.885, bottom=0.09,
                               hspace=0.12, wspace=0.2)  # fmt: skip
    growth = figure.add_subplot(grid[0, 0])
    frequency = figure.add_subplot(grid[1, 0], sharex=growth)
    locus = figure.add_subplot(grid[:, 1])
    x, rates, hertz = sweep.axis.shown_values, sweep.growth, sweep.frequency
    colours = {b: _COLOURS[i % len(_COLOURS)] for i, b in enumerate(np.flatnonzero(np.isfinite(rates).any(axis=0)))}
    for branch, colour in colours.items():
        growth.plot(x, rates[:, branch], color=colour, lw=1.6)
        frequency.plot(x, hertz[:, branch], color=colour, lw=1.6)
        locus.plot(rates[:, branch], hertz[:, branch], color=colour, lw=1.0, alpha=0.5)
    shades = np.broadcast_to(x[:, None], rates.shape)
    seen = np.isfinite(rates)
    dots = locus.scatter(rates[seen], hertz[seen], c=shades[seen], s=13, cmap="viridis", zorder=3)
    bar = figure.colorbar(dots, ax=locus, pad=0.02, label=sweep.axis.title)
    bar.outline.set_visible(False)  # type: ignore[operator]
    _critical(sweep, growth, frequency, locus)
    for axes in (growth, locus):
        _zero(axes, upright=axes is locus)
    growth.set_ylabel("growth [1/s]")
    growth.tick_params(labelbottom=False)
    frequency.set_ylabel("frequency [Hz]")
    frequency.set_xlabel(sweep.axis.title)
    if np.any(seen):
        low, high = float(np.nanmin(hertz)), float(np.nanmax(hertz))
        margin = max(0.08 * (high - low), 0.02 * high, 1e-9)  # a nearly constant curve must look constant
        frequency.set_ylim(low - margin, high + margin)
    locus.set_xlabel("growth [1/s]")
    locus.set_ylabel("frequency [Hz]")
    locus.set_title("root locus")
    figure.align_ylabels((growth, frequency))
    what = f"loop of {sweep.loop}" if sweep.loop else "steady sliding"
    figure.text(0.07, 0.945, f"{sweep.scene}: {what}", fontsize=15, fontweight="bold")


def _critical(sweep: Sweep, growth: Axes, frequency: Axes, locus: Axes) -> None:
    for one in sweep.critical:
        value, mark = one.value / sweep.axis.scale, _MARK[one.kind]
        label = f"{one.kind} at {sweep.axis.text(one.value)}"
        growth.plot([value], [0.0], mark, color=_ALARM, ms=7, zorder=4, label=label)
        frequency.plot([value], [one.frequency], mark, color=_ALARM, ms=7, zorder=4)
        locus.plot([0.0], [one.frequency], mark, color=_ALARM, ms=7, zorder=4)
        for axes in (growth, frequency):
            axes.axvline(value, color=_ALARM, lw=0.8, ls=":", zorder=1)
    if sweep.critical:
        growth.legend(loc="lower left", bbox_to_anchor=(0.0, 1.0), ncols=3, borderaxespad=0.2, handletextpad=0.3)


def _zero(axes: Axes, upright: bool) -> None:
    """Draw the line of zero growth, with the unstable side shaded."""
    low, high = axes.get_xlim() if upright else axes.get_ylim()
    low, high = min(low, -0.05 * (high - low)), max(high, 0.05 * (high - low))
    if upright:
        axes.axvline(0.0, color="#5a5a5a", lw=1.0)
        axes.axvspan(0.0, high, color=_ALARM, alpha=0.06, lw=0)
        axes.set_xlim(low, high)
    else:
        axes.axhline(0.0, color="#5a5a5a", lw=1.0)
        axes.axhspan(0.0, high, color=_ALARM, alpha=0.06, lw=0)
        axes.set_ylim(low, high)
