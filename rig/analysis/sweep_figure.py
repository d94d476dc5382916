"""Eigenvalues as pictures. Of a scene: its modes in the plane of growth and frequency. Of a sweep: growth and frequency
over the key, and the root locus.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from rig.analysis.modes_report import Modes
from rig.analysis.sweep import Sweep
from rig.errors import UsageError
from rig.view.curves import Bools, apart
from rig.view.palette import ALARM, GREY, LINES
from rig.view.run_figure import STYLE
from rig.view.save_figure import page

Array = NDArray[np.float64]

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

_COLOURS = (*LINES, GREY)
_MARK = {"flutter": "o", "divergence": "s", "jump": "D", "jamming": "X"}


def figure(sweep: Sweep) -> Figure:
    """Return the figure of `sweep`."""
    with page(STYLE, 12.8, 6.6) as figure:
        compose(figure, sweep)
    return figure


def modes_figure(found: Modes) -> Figure:
    """Return the modes in the plane of growth rate and frequency. Raises UsageError without steady sliding."""
    groups = [(found.sliding, "o", ""), (found.dithered, "D", "forced" if found.slow else "dithered")]
    if not any(sliding and sliding.modes for sliding, *_ in groups):
        raise UsageError(f"nothing to draw: no steady sliding at these values: {found.sliding.why}")
    with page(STYLE, 8.4, 5.2, layout="constrained") as figure:
        axes = figure.add_subplot()
        for sliding, mark, how in groups:
            for grows, colour in ((False, LINES[0]), (True, ALARM)):
                rates = np.array([(m.growth, m.frequency) for m in (sliding.modes if sliding else ())])
                if (shown := rates[(rates[:, 0] > 0.0) == grows] if rates.size else rates).size:
                    label = ", ".join(filter(None, ("grows" if grows else "does not grow", how)))
                    axes.plot(*shown.T, mark, color=colour, ms=6, mfc="none" if how else colour, label=label)
        _zero(axes, upright=True)
        axes.set(xlabel="growth rate [1/s]", ylabel="frequency [Hz]")
        axes.set_ylim(-0.03 * axes.get_ylim()[1], 1.05 * axes.get_ylim()[1])
        axes.legend(loc="lower right", bbox_to_anchor=(1.0, 1.0), ncols=4, borderaxespad=0.2)
        what = "steady sliding" if found.sliding.coefficient else "at rest"
        figure.suptitle(f"{found.scene}: vibration modes, {what}", x=0.01, ha="left", fontweight="bold")
    return figure


def compose(figure: Figure, sweep: Sweep) -> None:
    """Draw growth, frequency and root locus of a sweep into `figure`."""
    grid = figure.add_gridspec(2, 2, width_ratios=(1.25, 1), left=0.07, right=0.985, top=0.855, bottom=0.09,
                               hspace=0.12, wspace=0.2)  # fmt: skip
    growth = figure.add_subplot(grid[0, 0])
    frequency = figure.add_subplot(grid[1, 0], sharex=growth)
    locus = figure.add_subplot(grid[:, 1])
    x, rates, hertz = sweep.axis.shown_values, sweep.growth, sweep.frequency
    colours = {b: _COLOURS[i % len(_COLOURS)] for i, b in enumerate(np.flatnonzero(np.isfinite(rates).any(axis=0)))}
    jumps = _jumps(sweep)
    for branch, colour in colours.items():
        for grows, line in ((False, "-"), (True, "--")):
            style: dict[str, Any] = {"color": colour, "ls": line, "lw": 1.6}
            part = _part(rates[:, branch], grows)
            growth.plot(*apart(x, rates[:, branch] + part, jumps), **style)
            frequency.plot(*apart(x, hertz[:, branch] + part, jumps), **style)
        locus.plot(*apart(rates[:, branch], hertz[:, branch], jumps), color=colour, lw=1.0, alpha=0.5)
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
    what += f", {sweep.friction}" if sweep.friction else ""
    figure.text(0.07, 0.95, f"{sweep.scene}: {what}", fontsize=15, fontweight="bold")
    fixed = f"fixed: {sweep.fixed}; " if sweep.fixed else ""
    figure.text(0.07, 0.918, f"{fixed}solid: decays, dashed: grows", fontsize=10)


def _jumps(sweep: Sweep) -> Bools:
    """Whether a rate jumps between a value and the next one [n - 1]."""
    at = np.array([one.value for one in sweep.critical if one.kind == "jump"])
    ends = np.sort(np.stack([sweep.axis.values[:-1], sweep.axis.values[1:]]), axis=0)
    return np.asarray(np.any((ends[0, :, None] <= at) & (at <= ends[1, :, None]), axis=1))


def _part(rates: Array, grows: bool) -> Array:
    """Zero where a branch grows, or does not, and at the ends of the line between such points; else nan [n]."""
    inside = rates > 0.0 if grows else rates <= 0.0
    if grows:  # the line over the sign change is dashed
        inside[1:] |= inside[:-1].copy() & np.isfinite(rates[1:])
        inside[:-1] |= (rates[1:] > 0.0) & np.isfinite(rates[:-1])
    return np.where(inside, 0.0, np.nan)


def _critical(sweep: Sweep, growth: Axes, frequency: Axes, locus: Axes) -> None:
    for one in sweep.critical:
        value, mark = one.value / sweep.axis.scale, _MARK[one.kind]
        label = f"{one.kind} at {sweep.axis.text(one.value)}"
        growth.plot([value], [0.0], mark, color=ALARM, ms=7, zorder=4, label=label)
        frequency.plot([value], [one.frequency], mark, color=ALARM, ms=7, zorder=4)
        locus.plot([0.0], [one.frequency], mark, color=ALARM, ms=7, zorder=4)
        for axes in (growth, frequency):
            axes.axvline(value, color=ALARM, lw=0.8, ls=":", zorder=1)
    if sweep.critical:
        growth.legend(loc="lower left", bbox_to_anchor=(0.0, 1.0), ncols=3, borderaxespad=0.2, handletextpad=0.3)


def _zero(axes: Axes, upright: bool) -> None:
    """Draw the line of zero growth, with the unstable side shaded."""
    low, high = axes.get_xlim() if upright else axes.get_ylim()
    low, high = min(low, -0.05 * (high - low)), max(high, 0.05 * (high - low))
    if upright:
        axes.axvline(0.0, color=GREY, lw=1.0)
        axes.axvspan(0.0, high, color=ALARM, alpha=0.06, lw=0)
        axes.set_xlim(low, high)
    else:
        axes.axhline(0.0, color=GREY, lw=1.0)
        axes.axhspan(0.0, high, color=ALARM, alpha=0.06, lw=0)
        axes.set_ylim(low, high)
