"""Control loops as pictures: the response of the open loop with its margins; and the report of `rig loop`, with the
delay budget as a bar and the decay over delay, jitter and loss.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import numpy as np

from rig.analysis.control_loop import Loop
from rig.analysis.loop_report import LoopReport
from rig.view.palette import ALARM, GREY, LINES
from rig.view.run_figure import STYLE
from rig.view.save_figure import page

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure


def figure(report: LoopReport) -> Figure:
    """Return the figure of `report`."""
    with page(STYLE, 12.8, 6.6) as figure:
        _compose(figure, report)
    return figure


def loop_figure(found: Loop) -> Figure:
    """Return gain and phase of the open loop over frequency, with the margins."""
    omega = found.frequencies
    hertz, response = omega / (2.0 * math.pi), found.response(omega)
    with page(STYLE, 8.4, 6.0, layout="constrained") as figure:
        size, phase = figure.subplots(2, 1, sharex=True, height_ratios=(1.3, 1.0))
        size.loglog(hertz, np.abs(response), color=LINES[0])
        size.axhline(1.0, color=GREY, lw=0.9)
        angle = np.degrees(np.angle(response))
        angle[1:][np.abs(np.diff(angle)) > 180.0] = np.nan  # a step of a turn is no line
        phase.semilogx(hertz, angle, color=LINES[0])
        margins = found.margins
        if margins is not None and math.isfinite(margins["phase"]):
            text = {
                "phase": f"phase margin {math.degrees(margins['phase']):.3g} deg",
                "delay": f"delay margin {1e3 * margins['delay']:.3g} ms",
            }
            for (kind, label), style in zip(text.items(), ("--", ":")):
                for axes in (size, phase):
                    axes.axvline(margins[f"{kind}_hertz"], color=ALARM, lw=1.0, ls=style, label=label)
            size.legend(loc="lower right", bbox_to_anchor=(1.0, 1.0), ncols=2, borderaxespad=0.2)
        size.set_ylabel("gain of the open loop, ratio")
        phase.set(ylabel="phase [degree]", ylim=(-190.0, 190.0), yticks=(-180, -90, 0, 90, 180))
        phase.set_xlabel("frequency [Hz]")
        state = f"stable, decay rate {-found.growth:.4g} 1/s" if found.growth < 0.0 else "unstable"
        figure.suptitle(f"{found.scene}: loop of {found.controller}, {state}", x=0.01, ha="left", fontweight="bold")
    return figure


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
