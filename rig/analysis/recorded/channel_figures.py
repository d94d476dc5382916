"""Figures that relate channels of a recording: frequency response, phase portrait."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from rig.analysis.recorded.figure import sheet
from rig.analysis.recorded.portrait import Portrait, Section
from rig.analysis.recorded.response import Response
from rig.view.curves import plain
from rig.view.palette import ALARM, BLUE, GREY

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

_CURVE, _POINT, _AXIS = BLUE, ALARM, GREY
_NAMED = 6
"""Resonances that a picture labels, the largest ones."""
_DRAWN = 40_000  # samples of a portrait


def response_figure(found: Response) -> Figure:
    """Draw magnitude with its random error, phase and coherence over frequency."""
    title = f"{found.scene}: response of {plain(found.output)} to {plain(found.input)}"
    with sheet(title, (12.0, 8.4)) as figure:
        size, phase, coherence = figure.subplots(3, 1, sharex=True, height_ratios=(2.2, 1.2, 0.9))
        h = np.abs(found.h)
        size.loglog(found.f, h, color=_CURVE)
        band = np.isfinite(h * found.error) & (found.error < 1.0)
        edges = h * (1.0 - found.error), h * (1.0 + found.error)
        size.fill_between(found.f, *edges, where=band, color=_CURVE, alpha=0.2, lw=0, label="random error (68 %)")
        size.set_ylabel(f"magnitude [{found.unit}]")
        if band.any():
            size.legend(loc="best")
        for one in sorted(found.resonances, key=lambda one: -one.magnitude)[:_NAMED]:
            text = f"{one.frequency:.5g} Hz\n{100.0 * one.damping:.3g} %"
            size.annotate(text, (one.at, one.magnitude), (0, 4), textcoords="offset points", ha="center", fontsize=9,
                          color=_AXIS)  # fmt: skip
        low, high = size.get_ylim()
        size.set_ylim(low, 4.0 * high)
        kind = "Hann windows" if found.tapered else "windows from pulse to pulse"
        size.set_title(f"H1, mean of {found.windows} {kind} of {found.window:.4g} s")
        angle = np.degrees(np.angle(found.h))
        angle[1:][np.abs(np.diff(angle)) > 180.0] = np.nan  # a step of a turn is no line
        phase.semilogx(found.f, angle, color=_CURVE)
        phase.set(ylabel="phase [degree]", ylim=(-190.0, 190.0), yticks=(-180, -90, 0, 90, 180))
        coherence.semilogx(found.f, found.coherence, color=_CURVE)
        if np.isfinite(found.certain):
            coherence.axhline(found.certain, color=_AXIS, lw=0.9, ls="--", label="unrelated channels (95 %)")
            coherence.legend(loc="best")
        else:
            coherence.set_title("unknown from a single window")
        coherence.set(ylabel="coherence", ylim=(0.0, 1.05), xlabel="frequency [Hz]")
        figure.align_ylabels([size, phase, coherence])
    return figure


def portrait_figure(found: Portrait) -> Figure:
    """Draw the portrait, with its section and the points of the section over time."""
    section = found.section
    title = f"{found.scene}: {plain(found.y_name)} over {plain(found.x_name)}"
    with sheet(title, (7.6, 6.6) if section is None else (14.0, 6.6)) as figure:
        curve, *beside = figure.subplots(1, 1 if section is None else 2, squeeze=False)[0]
        every = max(found.t.size // _DRAWN, 1)
        curve.plot(found.x[::every], found.y[::every], color=_CURVE, lw=0.8)
        curve.set(xlabel=f"{plain(found.x_name)} [{found.x_unit}]", ylabel=f"{plain(found.y_name)} [{found.y_unit}]")
        curve.set_title("phase portrait")
        if section is not None:
            _cut(curve, found, section)
            _points(beside[0], found, section)
    return figure


def _cut(axes: Axes, found: Portrait, section: Section) -> None:
    at = f"{plain(section.name)} rises through {section.value:.4g} {section.unit}"
    axes.plot(section.x, section.y, "o", ms=4, color=_POINT, label=at, zorder=3)
    if section.name == found.x_name:
        axes.axvline(section.value, color=_AXIS, lw=0.9, ls="--")
    elif section.name == found.y_name:
        axes.axhline(section.value, color=_AXIS, lw=0.9, ls="--")
    axes.legend(loc="best")


def _points(axes: Axes, found: Portrait, section: Section) -> None:
    name, unit, values, whole = found.x_name, found.x_unit, section.x, found.x
    if section.name == found.x_name:
        name, unit, values, whole = found.y_name, found.y_unit, section.y, found.y
    axes.plot(section.t, values, "o", ms=3, color=_POINT)
    title = f"{section.t.size} points"
    if section.returns:
        title += f", repeat after {section.returns}: period {section.period:.6g} s"
    axes.set(title=f"Poincare section, {title}", xlabel="time [s]", ylabel=f"{plain(name)} [{unit}]")
    low, high = float(np.nanmin(whole)), float(np.nanmax(whole))
    axes.set_ylim(low - 0.05 * (high - low), high + 0.05 * (high - low))  # as in the portrait: what repeats is a line
