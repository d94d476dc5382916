"""A limit cycle as a picture: outputs over one period, phase portrait, Floquet multipliers."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from rig.analysis.cycle_report import Cycle
from rig.view.channels import Channels
from rig.view.palette import BLUE, VERMILION
from rig.view.run_figure import STYLE
from rig.view.save_figure import page

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

_PLOTS = 3
"""Number of plots over time."""
_STICK = "#d9dde3"


def figure(cycle: Cycle) -> Figure:
    """Return the figure of a limit cycle; a search that found none gives one with the reason."""
    with page(STYLE, 12.8, 6.6) as figure:
        figure.suptitle(_title(cycle), x=0.07, ha="left", wrap=True)
        if cycle.found:
            _compose(figure, cycle)
    return figure


def _title(cycle: Cycle) -> str:
    if not cycle.found:
        return f"{cycle.scene}: {cycle.why}"
    sticks = "".join(f", {name} sticks {100.0 * share:.3g} %" for name, share in cycle.stick_share.items())
    return f"limit cycle of {cycle.scene}: period {cycle.period:.6g} s, {cycle.frequency:.5g} Hz{sticks}"


def _compose(figure: Figure, cycle: Cycle) -> None:
    rig = (cycle.rig, cycle.rig.assemble()) if cycle.rig is not None else None
    channels = Channels(rig, {n: cycle.units[n] for n in cycle.outputs if n in cycle.units}, {})
    panels = [panel for panel in channels.panels if panel.outputs][:_PLOTS]
    grid = figure.add_gridspec(1, 2, width_ratios=(1.4, 1), left=0.07, right=0.975, top=0.88, bottom=0.09, wspace=0.22)
    left = grid[0].subgridspec(len(panels), 1, hspace=0.28)
    right = grid[1].subgridspec(2, 1, height_ratios=(1.5, 1), hspace=0.35)
    rows = [figure.add_subplot(left[i]) for i in range(len(panels))]
    for axes, panel in zip(rows, panels):
        for name in panel.outputs:
            axes.plot(cycle.time, cycle.outputs[name], color=channels.colours[name], lw=1.6, label=_plain(name))
        for begin, end in cycle.sticking:
            axes.axvspan(begin, end, color=_STICK, lw=0.0, zorder=0)
        axes.set_ylabel(panel.title)
        axes.set_xlim(0.0, cycle.period)
        axes.legend(loc="lower right", bbox_to_anchor=(1.0, 0.98), ncols=4, fontsize=8, frameon=False, handlelength=1.0)
        axes.tick_params(labelbottom=axes is rows[-1])
    sticks = f"; grey: {_plain(next(iter(cycle.stick_time)))} sticks" if cycle.sticking else ""
    rows[-1].set_xlabel(f"time in the period [s]{sticks}")
    figure.align_ylabels(rows)
    if channels.portrait is not None:
        _portrait(figure.add_subplot(right[0]), cycle, *channels.portrait)
    _multipliers(figure.add_subplot(right[1]), cycle)


def _portrait(axes: Axes, cycle: Cycle, displacement: str, velocity: str) -> None:
    style = "--" if cycle.repels else "-"
    axes.plot(cycle.outputs[displacement], cycle.outputs[velocity], style, color=BLUE, lw=1.4)
    axes.set_xlabel(f"{_plain(displacement)} [{cycle.units[displacement]}]")
    axes.set_ylabel(f"{_plain(velocity)} [{cycle.units[velocity]}]")
    axes.set_title("phase portrait" + "; dashed: the cycle is unstable" * cycle.repels)


def _multipliers(axes: Axes, cycle: Cycle) -> None:
    angle = np.linspace(0.0, 2.0 * np.pi, 200)
    axes.plot(np.cos(angle), np.sin(angle), color="#9aa3ad", lw=1.0)
    values = np.asarray(cycle.floquet.multipliers, np.complex128)
    out = (np.abs(values) > 1.0) & cycle.repels  # else those above one are one within their error
    axes.plot(values.real[~out], values.imag[~out], "o", color=BLUE, ms=5)
    axes.plot(values.real[out], values.imag[out], "x", color=VERMILION, ms=7, mew=1.6)
    axes.set_aspect("equal", adjustable="datalim")
    axes.set_xlabel("real part")
    axes.set_ylabel("imaginary part")
    axes.set_title(
        "Floquet multipliers; outside of the circle (x): unstable" if values.size else "no Floquet multipliers"
    )


def _plain(name: str) -> str:
    return name.replace("_", " ")
