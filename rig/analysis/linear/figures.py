"""Figures of a linearised rig: vibration modes, sweep, control loop.

Each function takes a result and returns its figure; a class of results names its function in `FIGURE` (rig.results).
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from rig.analysis.linear.control_loop import Loop
from rig.analysis.linear.loop_report import LoopReport
from rig.analysis.linear.modes_report import Modes
from rig.analysis.linear.sweep import Sweep
from rig.errors import UsageError
from rig.view.curves import Bools, apart
from rig.view.palette import ALARM, GREY, LINES, drawn, headline

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure, SubFigure

Array = NDArray[np.float64]
_COLOURS = (*LINES, GREY)
_MARK = {"flutter": "o", "divergence": "s", "jump": "D", "jamming": "X"}
_ROUNDED = 1e-6  # growth rates up to this share of the largest rate are rounding
_NAMED = 3  # critical values in the legend, one line
_LIGHT = 0.02  # largest damping ratio of the modes for which the axes of a structure have room


@drawn(12.8, 6.6)
def loop_report_figure(figure: Figure, report: LoopReport) -> None:
    """Draw `report`."""
    grid = figure.add_gridspec(
        2, 3, height_ratios=(1, 1.5), left=0.07, right=0.985, top=0.86, bottom=0.09, hspace=0.5, wspace=0.24
    )
    headline(figure, f"{report.scene}: loop of {report.loop.controller}")
    _budget(figure.add_subplot(grid[0, :]), report)
    for column, curve in enumerate(report.curves):
        axes = figure.add_subplot(grid[1, column])
        scale, unit = (1e2, "%") if curve.key == "loss" else (1e3, "ms")
        axes.plot([scale * v for v in curve.values], [-g for g in curve.growth], "o-", color=LINES[0], ms=4)
        axes.axhline(0.0, color=ALARM, lw=1.0)
        axes.set_xlabel(f"{curve.key} of the sensor's link [{unit}]")
        if not column:
            axes.set_ylabel("decay rate [1/s]")


@drawn(8.4, 6.0, layout="constrained")
def loop_figure(figure: Figure, loop: Loop) -> None:
    """Draw gain and phase of the open loop over frequency, with the margins."""
    omega = loop.frequencies
    hertz = omega / (2.0 * math.pi)
    response = loop.response(omega)
    state = f"stable, decay rate {-loop.growth:.4g} 1/s" if loop.growth < 0.0 else "unstable"
    headline(figure, f"{loop.scene}: loop of {loop.controller}, {state}")
    size, phase = figure.subplots(2, 1, sharex=True, height_ratios=(1.3, 1.0))
    size.loglog(hertz, np.abs(response), color=LINES[0])
    size.axhline(1.0, color=GREY, lw=0.9)
    angle = np.degrees(np.angle(response))
    angle[1:][np.abs(np.diff(angle)) > 180.0] = np.nan  # a step of a turn is no line
    phase.semilogx(hertz, angle, color=LINES[0])
    margins = loop.margins
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
    phase.set(ylabel="phase [degree]", ylim=(-190.0, 190.0), yticks=(-180, -90, 0, 90, 180), xlabel="frequency [Hz]")


def _budget(axes: Axes, report: LoopReport) -> None:
    """A bar of the delays item after the other, then the margin that is left."""
    at = 0.0
    margin = report.loop.margins
    late = [item for item in report.items if item.seconds > 0.0]
    for i, item in enumerate(late):
        axes.barh(0.0, 1e3 * item.seconds, left=at, height=0.5, color=LINES[i % len(LINES)], label=item.part)
        at += 1e3 * item.seconds
    if margin is not None and margin["delay"] < 1e3:
        bus = sum(1e3 * item.seconds for item in report.items if item.part.startswith("bus"))
        left = max(1e3 * margin["delay"] - bus, 0.0)
        axes.barh(0.0, left, left=at, height=0.5, color="white", edgecolor=GREY, hatch="//", label="delay margin")
        at += left
    axes.set(xlim=(0.0, at or 1.0), ylim=(-0.5, 0.5), yticks=[], xlabel="delay [ms]", title="delay budget")
    axes.legend(loc="upper center", bbox_to_anchor=(0.5, -0.32), ncols=5, fontsize=8.5)


def modes_figure(modes: Modes) -> Figure:
    """Draw the modes in the plane of growth rate and frequency, and on the nodes of a structure the least stable ones.

    Raises UsageError without steady sliding.
    """
    return _modes_figure(modes) if modes.nodes is None else _modes_on_nodes(modes)


@drawn(13.0, 5.6)
def _modes_on_nodes(figure: Figure, modes: Modes) -> None:
    from rig.analysis.linear.mode_shapes import panels

    parts: Any = figure.subfigures(1, 2, width_ratios=(1.0, 1.1))
    plane, nodes = parts
    _plane(figure, plane, modes)
    plane.subplots_adjust(left=0.13, right=0.97, top=0.84, bottom=0.11)
    panels(nodes, modes, 4)
    nodes.subplots_adjust(left=0.0, right=1.0, bottom=0.0, top=0.9, wspace=0.0, hspace=0.1)


@drawn(8.4, 5.2, layout="constrained")
def _modes_figure(figure: Figure, modes: Modes) -> None:
    _plane(figure, figure, modes)


def _plane(whole: Figure, figure: Figure | SubFigure, modes: Modes) -> None:
    """The plane of growth rate and frequency."""
    groups = [(modes.sliding, "o", ""), (modes.dithered, "D", "forced" if modes.slow else "dithered")]
    if not any(sliding and sliding.modes for sliding, *_ in groups):
        raise UsageError(f"nothing to draw: no steady sliding at these values: {modes.sliding.why}")
    what = "steady sliding" if modes.sliding.coefficient else "at rest"
    headline(whole, f"{modes.scene}: vibration modes, {what}")
    axes = figure.add_subplot()
    for sliding, mark, how in groups:
        for grows, colour in ((False, LINES[0]), (True, ALARM)):
            rates = [(m.growth, m.frequency) for m in sliding.modes if (m.growth > 0.0) == grows] if sliding else []
            if rates:
                label = ", ".join(filter(None, ("grows" if grows else "does not grow", how)))
                axes.plot(*np.array(rates).T, mark, color=colour, ms=6, mfc="none" if how else colour, label=label)
    _zero(axes, upright=True)
    axes.set(xlabel="growth rate [1/s]", ylabel="frequency [Hz]")
    axes.set_ylim(-0.03 * axes.get_ylim()[1], 1.05 * axes.get_ylim()[1])
    axes.legend(loc="lower right", bbox_to_anchor=(1.0, 1.0), ncols=4, borderaxespad=0.2)


@drawn(12.8, 6.6)
def sweep_figure(figure: Figure, sweep: Sweep) -> None:
    """Draw growth, frequency and root locus of a sweep into `figure`."""
    grid = figure.add_gridspec(
        2, 2, width_ratios=(1.25, 1), left=0.07, right=0.985, top=0.855, bottom=0.09, hspace=0.12, wspace=0.2
    )
    growth = figure.add_subplot(grid[0, 0])
    frequency = figure.add_subplot(grid[1, 0], sharex=growth)
    locus = figure.add_subplot(grid[:, 1])
    x = sweep.axis.shown_values
    rates = sweep.growth
    hertz = sweep.frequency
    known = np.flatnonzero(np.isfinite(rates).any(axis=0)).tolist()
    colours = {b: _COLOURS[i % len(_COLOURS)] for i, b in enumerate(known)}
    partners = {crossing.branch: sweep.partner(crossing) for crossing in sweep.critical}
    coupled = [b for branch, other in partners.items() if other is not None for b in (branch, other)]
    rounding = _ROUNDED * np.nanmax(np.abs(rates), initial=0.0)
    growing = np.flatnonzero(np.any(rates > rounding, axis=0))
    jumps = _jumps(sweep)
    for branch, colour in colours.items():
        for grows, line in ((False, "-"), (True, "--")):
            style: dict[str, Any] = {"color": colour, "ls": line, "lw": 2.4 if branch in coupled else 1.6}
            part = _part(rates[:, branch], grows)
            growth.plot(*apart(x, rates[:, branch] + part, jumps), **style)
            frequency.plot(*apart(x, hertz[:, branch] + part, jumps), **style)
        path = apart(rates[:, branch], hertz[:, branch], jumps)
        locus.plot(*path, color=colour, lw=1.0, alpha=0.5)
    shades = np.broadcast_to(x[:, None], rates.shape)
    seen = np.isfinite(rates)
    dots = locus.scatter(rates[seen], hertz[seen], c=shades[seen], s=13, cmap="viridis", zorder=3)
    bar = figure.colorbar(dots, ax=locus, pad=0.02, label=sweep.axis.title)
    bar.outline.set_visible(False)  # type: ignore[operator]
    bar.ax.grid(visible=False)
    _critical(sweep, growth, frequency, locus)
    light = rates[rates > -_LIGHT * 2.0 * np.pi * hertz]
    if sweep.errors.size and light.size:  # else the many damped modes of a structure hide those that begin to grow
        growth.set_ylim(1.1 * light.min(), 1.1 * light.max())
        locus.set_xlim(growth.get_ylim())
    zoomed = bool(coupled) and np.isin([*growing, *partners], coupled).all()
    if zoomed:
        growth.set_ylim(*_room(rates[:, coupled]))
        locus.set_xlim(*_room(rates[:, coupled]))
        seen = seen & np.isin(np.arange(rates.shape[1]), coupled)
    for axes in (growth, locus):
        _zero(axes, upright=axes is locus)
    growth.set_ylabel("growth [1/s]")
    growth.tick_params(labelbottom=False)
    frequency.set(ylabel="frequency [Hz]", xlabel=sweep.axis.title)
    if np.any(seen):
        low = float(np.nanmin(hertz[seen]))
        high = float(np.nanmax(hertz[seen]))
        # a nearly constant curve must look constant, and two that meet must look apart where they are
        least = (0.002 if zoomed else 0.02) * high
        margin = max(0.08 * (high - low), least, 1e-9)
        for axes in (frequency, locus):
            axes.set_ylim(low - margin, high + margin)
    _kinds(sweep, frequency, {b: colour for b, colour in colours.items() if b in coupled})
    locus.set(xlabel="growth [1/s]", ylabel="frequency [Hz]", title="root locus")
    figure.align_ylabels((growth, frequency))
    what = f"loop of {sweep.loop}" if sweep.loop else "steady sliding"
    if sweep.friction:
        what += f", {sweep.friction}"
    headline(figure, f"{sweep.scene}: {what}")
    pairs = dict.fromkeys(sweep.pair(crossing) for crossing in sweep.critical)
    told = [f"the modes of {pair[0]:.5g} and {pair[1]:.5g} Hz meet" for pair in pairs if pair]
    told += [f"fixed: {sweep.fixed}"] if sweep.fixed else []
    figure.text(0.01, 0.925, "; ".join(told), fontsize=10)


def _room(values: Array) -> tuple[float, float]:
    """Ends of an axis with a tenth of the range of `values` on both sides."""
    low = float(np.nanmin(values))
    high = float(np.nanmax(values))
    margin = max(0.1 * (high - low), 1e-9)
    return low - margin, high + margin


def _kinds(sweep: Sweep, axes: Axes, coupled: Mapping[int, str]) -> None:
    """A legend of the kinds of lines, and of the modes that meet, by their frequencies at the begin of the axis."""
    from matplotlib.lines import Line2D

    lines = []
    for branch, colour in coupled.items():
        first = next(hertz for hertz in sweep.frequency[:, branch] if hertz == hertz)
        lines.append(Line2D([], [], color=colour, lw=2.4, label=f"mode of {first:.5g} Hz"))
    for style, label in (("-", "decays"), ("--", "grows")):
        lines.append(Line2D([], [], color=GREY, ls=style, lw=1.6, label=label))
    axes.legend(handles=lines, loc="best", ncols=2, fontsize=8.5, frameon=True, edgecolor="none", framealpha=0.85)


def _jumps(sweep: Sweep) -> Bools:
    """Whether a rate jumps between a value and the next crossing [n - 1]."""
    at = np.array([crossing.value for crossing in sweep.critical if crossing.kind == "jump"])
    low, high = np.sort(np.stack([sweep.axis.values[:-1], sweep.axis.values[1:]]), axis=0)
    between = (low[:, None] <= at) & (at <= high[:, None])
    return np.asarray(np.any(between, axis=1))


def _part(rates: Array, grows: bool) -> Array:
    """Zero where a branch grows, or does not, and at the ends of the line between such points; else nan [n]."""
    inside = rates > 0.0 if grows else rates <= 0.0
    if grows:  # the line over the sign change is dashed
        inside[1:] |= inside[:-1].copy() & np.isfinite(rates[1:])
        inside[:-1] |= (rates[1:] > 0.0) & np.isfinite(rates[:-1])
    return np.where(inside, 0.0, np.nan)


def _critical(sweep: Sweep, growth: Axes, frequency: Axes, locus: Axes) -> None:
    named = len(sweep.critical) if len(sweep.critical) <= _NAMED else _NAMED - 1
    for number, crossing in enumerate(sweep.critical):
        value = crossing.value / sweep.axis.scale
        mark = _MARK[crossing.kind]
        label = f"{crossing.kind} at {sweep.axis.text(crossing.value)}"
        if number >= named:
            label = f"and {len(sweep.critical) - named} more" if number == named else "_"
        growth.plot([value], [0.0], mark, color=ALARM, ms=7, zorder=4, label=label)
        frequency.plot([value], [crossing.frequency], mark, color=ALARM, ms=7, zorder=4)
        locus.plot([0.0], [crossing.frequency], mark, color=ALARM, ms=7, zorder=4)
        for axes in (growth, frequency):
            axes.axvline(value, color=ALARM, lw=0.8, ls=":", zorder=1)
    if sweep.critical:
        growth.legend(loc="lower left", bbox_to_anchor=(0.0, 1.0), ncols=_NAMED, borderaxespad=0.2, handletextpad=0.3)


def _zero(axes: Axes, upright: bool) -> None:
    """Draw the line of zero growth, with the unstable side shaded."""
    low, high = axes.get_xlim() if upright else axes.get_ylim()
    room = 0.05 * (high - low)
    low = min(low, -room)
    high = max(high, room)
    if upright:
        axes.axvline(0.0, color=GREY, lw=1.0)
        axes.axvspan(0.0, high, color=ALARM, alpha=0.06, lw=0)
        axes.set_xlim(low, high)
    else:
        axes.axhline(0.0, color=GREY, lw=1.0)
        axes.axhspan(0.0, high, color=ALARM, alpha=0.06, lw=0)
        axes.set_ylim(low, high)
