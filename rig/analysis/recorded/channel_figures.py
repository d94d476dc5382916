"""Figures of recorded channels: amplitudes, frequency response, phase portrait, stick and slip."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np

from rig.analysis.recorded.amplitude import NOISY, Amplitudes, Row
from rig.analysis.recorded.portrait import Portrait, Section
from rig.analysis.recorded.response import Response
from rig.analysis.recorded.stick_slip import StickSlip
from rig.errors import UsageError
from rig.printable import counted
from rig.view.curves import largest, plain, scaled
from rig.view.palette import ALARM, BLUE, GREY, page

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

_NAMED_PEAKS = 6  # resonances that a picture labels, the largest ones
_DRAWN_SAMPLES = 40_000  # of a portrait


def amplitudes_figure(amplitudes: Amplitudes) -> Figure:
    """Return the figure of the amplitudes. Raises UsageError if no sensor has samples."""
    rows = amplitudes.rows
    sensors = list(dict.fromkeys(row.sensor for row in rows))
    if not sensors:
        raise UsageError("nothing to draw: no sensor has samples")
    columns = min(len(sensors), 3)
    lines = math.ceil(len(sensors) / columns)
    title = f"{amplitudes.scene}: amplitude and frequency" + " in each stage" * (columns > 1)
    with page(4.4 * columns, 1.0 + 3.2 * lines, title, layout="constrained") as figure:
        for i, sensor in enumerate(sensors):
            _bars(figure.add_subplot(lines, columns, i + 1), [row for row in rows if row.sensor == sensor])
    return figure


def _bars(axes: Axes, rows: Sequence[Row]) -> None:
    first = rows[0]
    places = range(len(rows))
    sizes = [row.found.half if row.found.cycles or row.why == NOISY else 0.0 for row in rows]
    factor, unit = scaled(first.unit, max(sizes))
    bars = axes.bar(places, [factor * size for size in sizes], color=BLUE, width=0.6)
    axes.bar_label(bars, [_frequency(row) for row in rows], fontsize=8, padding=2)
    axes.margins(y=0.15)
    axes.set_ylim(bottom=0.0)
    axes.set_xticks(places, [row.stage for row in rows], rotation=20 if len(rows) > 3 else 0, fontsize=8)
    axes.set_ylabel(f"amplitude of {plain(first.sensor)} [{unit}]")
    axes.grid(axis="x", visible=False)
    axes.set_axisbelow(True)


def _frequency(row: Row) -> str:
    if row.found.cycles:
        return f"{row.found.frequency:.4g} Hz"
    return "at noise\nlevel" if row.why == NOISY else "no cycle"


def response_figure(response: Response) -> Figure:
    """Draw magnitude with its random error, phase and coherence over frequency."""
    title = f"{response.scene}: response of {plain(response.output)} to {plain(response.input)}"
    with page(12.0, 8.4, title, layout="constrained") as figure:
        size, phase, coherence = figure.subplots(3, 1, sharex=True, height_ratios=(2.2, 1.2, 0.9))
        h = np.abs(response.h)
        size.loglog(response.f, h, color=BLUE)
        band = np.isfinite(h * response.error) & (response.error < 1.0)
        edges = h * (1.0 - response.error), h * (1.0 + response.error)
        size.fill_between(response.f, *edges, where=band, color=BLUE, alpha=0.2, lw=0, label="random error (68 %)")
        size.set_ylabel(f"magnitude [{response.unit}]")
        if band.any():
            size.legend(loc="best")
        for peak in sorted(response.resonances, key=lambda peak: -peak.magnitude)[:_NAMED_PEAKS]:
            text = f"{peak.frequency:.5g} Hz\n{100.0 * peak.damping:.3g} %"
            top = (peak.at, peak.magnitude)
            size.annotate(text, top, (0, 4), textcoords="offset points", ha="center", fontsize=9, color=GREY)
        low, high = size.get_ylim()
        size.set_ylim(low, 4.0 * high)
        kind = "Hann windows" if response.tapered else "windows from pulse to pulse"
        size.set_title(f"H1, mean of {response.windows} {kind} of {response.window:.4g} s")
        angle = np.degrees(np.angle(response.h))
        angle[1:][np.abs(np.diff(angle)) > 180.0] = np.nan  # a step of a turn is no line
        phase.semilogx(response.f, angle, color=BLUE)
        phase.set(ylabel="phase [degree]", ylim=(-190.0, 190.0), yticks=(-180, -90, 0, 90, 180))
        coherence.semilogx(response.f, response.coherence, color=BLUE)
        if np.isfinite(response.certain):
            coherence.axhline(response.certain, color=GREY, lw=0.9, ls="--", label="unrelated channels (95 %)")
            coherence.legend(loc="best")
        else:
            coherence.set_title("unknown from a single window")
        coherence.set(ylabel="coherence", ylim=(0.0, 1.05), xlabel="frequency [Hz]")
        figure.align_ylabels([size, phase, coherence])
    return figure


def portrait_figure(portrait: Portrait) -> Figure:
    """Draw the portrait, with its section and the points of the section over time."""
    section = portrait.section
    title = f"{portrait.scene}: {plain(portrait.y_name)} over {plain(portrait.x_name)}"
    with page(7.6 if section is None else 14.0, 6.6, title, layout="constrained") as figure:
        curve, *beside = figure.subplots(1, 1 if section is None else 2, squeeze=False)[0]
        every = max(portrait.t.size // _DRAWN_SAMPLES, 1)
        (along, x_unit), (up, y_unit) = _portrait_units(portrait)
        curve.plot(along * portrait.x[::every], up * portrait.y[::every], color=BLUE, lw=0.8)
        curve.set(xlabel=f"{plain(portrait.x_name)} [{x_unit}]", ylabel=f"{plain(portrait.y_name)} [{y_unit}]")
        curve.set_title("phase portrait")
        if section is not None:
            _cut(curve, portrait, section)
            _points(beside[0], portrait, section)
    return figure


def _portrait_units(portrait: Portrait) -> tuple[tuple[float, str], tuple[float, str]]:
    return scaled(portrait.x_unit, largest(portrait.x)), scaled(portrait.y_unit, largest(portrait.y))


def _cut(axes: Axes, portrait: Portrait, section: Section) -> None:
    (along, _), (up, _) = _portrait_units(portrait)
    at = f"{plain(section.name)} rises through {section.value:.4g} {section.unit}"
    axes.plot(along * section.x, up * section.y, "o", ms=4, color=ALARM, label=at, zorder=3)
    if section.name == portrait.x_name:
        axes.axvline(along * section.value, color=GREY, lw=0.9, ls="--")
    elif section.name == portrait.y_name:
        axes.axhline(up * section.value, color=GREY, lw=0.9, ls="--")
    axes.legend(loc="best")


def _points(axes: Axes, portrait: Portrait, section: Section) -> None:
    (factor, unit), other = _portrait_units(portrait)
    name = portrait.x_name
    values = section.x
    whole = portrait.x
    if section.name == portrait.x_name:
        factor, unit = other
        name = portrait.y_name
        values = section.y
        whole = portrait.y
    axes.plot(section.t, factor * values, "o", ms=3, color=ALARM)
    title = f"{counted(section.t.size, 'point')}"
    if section.returns:
        title += f", repeat after {section.returns}: period {section.period:.6g} s"
    axes.set(title=f"Poincare section, {title}", xlabel="time [s]", ylabel=f"{plain(name)} [{unit}]")
    low = factor * float(np.nanmin(whole))
    high = factor * float(np.nanmax(whole))
    axes.set_ylim(low - 0.05 * (high - low), high + 0.05 * (high - low))  # as in the portrait: what repeats is a line


def stick_slip_figure(contact: StickSlip) -> Figure:
    """Draw the slip speed with its slips, the times in stick and motion, and with a force, it and the friction."""
    forces = bool(contact.force_unit)
    with page(14.0, 8.4 if forces else 4.6, f"{contact.scene}: stick and slip", layout="constrained") as figure:
        axes = figure.subplots(1 + forces, 2, squeeze=False)
        speed, times = axes[0]
        every = max(contact.t.size // _DRAWN_SAMPLES, 1)
        factor, unit = scaled(contact.speed_unit, largest(contact.speed))
        speed.plot(contact.t[::every], factor * contact.speed[::every], color=BLUE, lw=0.7)
        for slip in contact.slips:
            speed.axvspan(slip.begin, slip.end, color=ALARM, alpha=0.12, lw=0.0)
        speed.axhline(factor * contact.threshold, color=GREY, lw=0.9, ls="--", label="threshold of slip")
        speed.set(ylabel=f"slip speed [{unit}]", xlabel="time [s]", title="slips are shaded")
        speed.legend(loc="lower right", bbox_to_anchor=(1.0, 1.0), borderaxespad=0.2)
        longest = max((max(slip.motion, np.nan_to_num(slip.stick)) for slip in contact.slips), default=1.0)
        edges = np.linspace(0.0, 1.05 * longest, 40)
        for name, colour in (("stick", BLUE), ("motion", ALARM)):
            values = [*filter(np.isfinite, (getattr(slip, name) for slip in contact.slips))]
            times.hist(values, edges, color=colour, alpha=0.6, label=f"{name} time")
        times.set(xlabel="time [s]", ylabel="number of slips [1]", title="how long")
        times.legend()
        if forces:
            _forces(axes[1][0], axes[1][1], contact, every)
    return figure


def _forces(force: Axes, friction: Axes, contact: StickSlip, every: int) -> None:
    force.plot(contact.t[::every], contact.force[::every], color=BLUE, lw=0.7)
    force.set(ylabel=f"force [{contact.channel_unit}]", xlabel="time [s]")
    for curve, colour, way in ((contact.up, BLUE, "rising"), (contact.down, ALARM, "falling")):
        if curve is not None and curve.speed.size:
            friction.errorbar(
                curve.speed,
                curve.friction,
                2.0 * curve.error,
                color=colour,
                marker="o",
                ms=3.5,
                lw=1.0,
                label=f"{way} speed",
            )
    what = "friction coefficient" if contact.coefficient else "friction"
    friction.set(
        xlabel=f"slip speed [{contact.speed_unit}]",
        ylabel=f"{what} [{contact.force_unit}]",
        title="friction over slip speed, two standard errors",
    )
    if friction.has_data():
        friction.legend()
