"""The figure of a limit cycle: its outputs over one period, its phase portrait and its Floquet multipliers."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from rig.analysis.cycles.cycle_report import Cycle
from rig.view.channels import Channels
from rig.view.curves import largest, plain, scaled
from rig.view.palette import BLUE, VERMILION, drawn, headline

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

_PLOTS = 3  # of a cycle over time
_STICK = "#d9dde3"


@drawn(12.8, 6.6)
def cycle_figure(figure: Figure, cycle: Cycle) -> None:
    """Draw a limit cycle; a search that found none gives one with the reason."""
    headline(figure, _title(cycle))
    if cycle.found:
        _compose_cycle(figure, cycle)


def _title(cycle: Cycle) -> str:
    if not cycle.found:
        return f"{cycle.scene}: {cycle.why}"
    sticks = "".join(f", {name} sticks {100.0 * share:.3g} %" for name, share in cycle.stick_share.items())
    return f"limit cycle of {cycle.scene}: period {cycle.period:.6g} s, {cycle.frequency:.5g} Hz{sticks}"


def _compose_cycle(figure: Figure, cycle: Cycle) -> None:
    rig = (cycle.rig, cycle.rig.assemble()) if cycle.rig is not None else None
    channels = Channels(rig, {n: cycle.units[n] for n in cycle.outputs if n in cycle.units}, {})
    panels = [panel for panel in channels.panels if panel.outputs][:_PLOTS]
    grid = figure.add_gridspec(1, 2, width_ratios=(1.4, 1), left=0.07, right=0.975, top=0.88, bottom=0.09, wspace=0.22)
    left = grid[0].subgridspec(len(panels), 1, hspace=0.28)
    right = grid[1].subgridspec(2, 1, height_ratios=(1.5, 1), hspace=0.35)
    rows = [figure.add_subplot(left[i]) for i in range(len(panels))]
    for axes, panel in zip(rows, panels):
        title, unit = panel.title.removesuffix("]").rsplit(" [", 1)
        factor, shown = scaled(unit, largest(*(cycle.outputs[name] for name in panel.outputs)))
        for name in panel.outputs:
            axes.plot(cycle.time, factor * cycle.outputs[name], color=channels.colours[name], lw=1.6, label=plain(name))
        for begin, end in cycle.sticking:
            axes.axvspan(begin, end, color=_STICK, lw=0.0, zorder=0)
        axes.set(ylabel=f"{title} [{shown}]", xlim=(0.0, cycle.period))
        axes.legend(loc="lower right", bbox_to_anchor=(1.0, 0.98), ncols=4, fontsize=8, frameon=False, handlelength=1.0)
        axes.tick_params(labelbottom=axes is rows[-1])
    sticks = f"; grey: {plain(next(iter(cycle.stick_time)))} sticks" if cycle.sticking else ""
    rows[-1].set_xlabel(f"time in the period [s]{sticks}")
    figure.align_ylabels(rows)
    if channels.portrait is not None:
        _portrait(figure.add_subplot(right[0]), cycle, *channels.portrait)
    _multipliers(figure.add_subplot(right[1]), cycle)


def _portrait(axes: Axes, cycle: Cycle, displacement: str, velocity: str) -> None:
    style = "--" if cycle.repels else "-"
    x = cycle.outputs[displacement]
    v = cycle.outputs[velocity]
    along, unit = scaled(cycle.units[displacement], largest(x))
    rate, speed = scaled(cycle.units[velocity], largest(v))
    axes.plot(along * x, rate * v, style, color=BLUE, lw=1.4)
    title = "phase portrait; dashed: the cycle is unstable" if cycle.repels else "phase portrait"
    axes.set(xlabel=f"{plain(displacement)} [{unit}]", ylabel=f"{plain(velocity)} [{speed}]", title=title)


def _multipliers(axes: Axes, cycle: Cycle) -> None:
    angle = np.linspace(0.0, 2.0 * np.pi, 200)
    axes.plot(np.cos(angle), np.sin(angle), color="#9aa3ad", lw=1.0)
    values = np.asarray(cycle.floquet.multipliers, np.complex128)
    out = (np.abs(values) > 1.0) & cycle.repels  # else those above one are one within their error
    axes.plot(values.real[~out], values.imag[~out], "o", color=BLUE, ms=5)
    axes.plot(values.real[out], values.imag[out], "x", color=VERMILION, ms=7, mew=1.6)
    axes.set_aspect("equal", adjustable="datalim")
    title = "Floquet multipliers; outside of the circle (x): unstable" if values.size else "no Floquet multipliers"
    axes.set(xlabel="real part", ylabel="imaginary part", title=title)
