"""Figures of one channel of a recording: over the speed, over frequency and time, over the contact."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from rig.analysis.recorded.density import Density, Line, Map
from rig.analysis.recorded.events import Events
from rig.analysis.recorded.hysteresis import Hysteresis
from rig.analysis.recorded.orders import Orders
from rig.analysis.recorded.pressure import Pressure
from rig.analysis.recorded.sound import Sound
from rig.analysis.recorded.spectrum import Spectrum
from rig.printable import counted
from rig.record.run import Reals
from rig.view import curves
from rig.view.curves import largest, plain, scaled, thinned
from rig.view.palette import ALARM, AMBER, BLUE, GREEN, GREY, SKY, VERMILION, page
from rig.view.pressure import draw_map, draw_scale, where

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

Floats = NDArray[np.floating[Any]]
_COLUMNS = 2400  # of a sound
_LINES = 500  # of a map of events
_RANGE = 70.0  # range of a map [dB below its maximum]
_NAMED = 0.01  # share of the mean square from which on a picture labels a line
_WIDE = 0.17  # width of such a label as a share of the axes
_ROW = 0.075  # height of such a label as a share of the axes
_ALL = 1e-4  # share of the mean square that may lie above the range of a map


def hysteresis_figure(hysteresis: Hysteresis) -> Figure:
    """Draw the RMS over the speed, and both over time."""
    over = plain(hysteresis.over)
    name = plain(hysteresis.name)
    size, unit = scaled(hysteresis.unit, largest(*(curve.rms for curve in hysteresis.curves)))
    along, shown = scaled(hysteresis.over_unit, largest(*(curve.speed for curve in hysteresis.curves)))
    with page(12.0, 8.0, f"{hysteresis.scene}: {name} over {over}", layout="constrained") as figure:
        loop, rms, speed = figure.subplots(3, 1, height_ratios=(2.4, 1.0, 0.7))
        rms.sharex(speed)
        for curve in hysteresis.curves:
            way, colour, dashes = ("rising", BLUE, "-") if curve.branch.rises else ("falling", AMBER, "--")
            label = f"{over} {way}"
            new = label not in loop.get_legend_handles_labels()[1]
            line = thinned(along * curve.speed, size * curve.rms)
            loop.plot(*line, color=colour, ls=dashes, label=label if new else None)
            for axes, values in ((rms, size * curve.rms), (speed, along * curve.speed)):
                axes.plot(*thinned(curve.t, values), color=colour)
            if math.isfinite(curve.stick):
                what = "last stick" if curve.branch.rises else "first stick"
                stick = along * curve.stick
                loop.axvline(stick, color=colour, lw=0.9, ls=":", label=f"{what}: {stick:.4g} {shown}")
        loop.set_title(f"RMS about the mean, centred window of {hysteresis.window:.4g} s")
        loop.set(xlabel=f"{over} [{shown}]", ylabel=f"RMS of {name} [{unit}]")
        loop.set_ylim(0.0, None)
        loop.legend(loc="best")
        rms.set(ylabel=f"RMS [{unit}]")
        rms.set_ylim(0.0, None)
        rms.tick_params(labelbottom=False)
        speed.set(ylabel=f"{over}\n[{shown}]", xlabel="time [s]")
        figure.align_ylabels([rms, speed])
    return figure


def spectrum_figure(spectrum: Spectrum | Orders) -> Figure:
    """Draw density and map of a spectrum, and of orders; a spectrum with orders shows both."""
    orders = spectrum.orders if isinstance(spectrum, Spectrum) else None
    both, size = ([spectrum, orders], (15.0, 8.0)) if orders else ([spectrum], (12.0, 7.6))
    what = "spectrum" if isinstance(spectrum, Spectrum) else "orders"
    with page(*size, f"{spectrum.scene}: {what} of {plain(spectrum.name)}", layout="constrained") as figure:
        panels = figure.subplots(2, len(both), squeeze=False)
        for (density, over_time), averaged in zip(panels.T, both):
            axis = f"{averaged.AXIS} [{averaged.axis_unit}]"
            per = averaged.per
            unit = averaged.density_unit
            over = f", over {plain(averaged.over)}" if isinstance(averaged, Orders) else ""
            _density(density, averaged.density, averaged.lines, unit, averaged.axis_unit)
            windows = counted(averaged.density.windows, "Hann window")
            resolution = f"resolution {averaged.density.step:.3g} {averaged.axis_unit}"
            density.set(title=f"mean of {windows} of {averaged.window:.4g} {per}{over}; {resolution}", xlabel=axis)
            _map(over_time, averaged.map, averaged.density, f"level [dB re 1 {unit}]")
            resolution = f"resolution {averaged.map.f[1]:.3g} {averaged.axis_unit}"
            over_time.set(
                title=f"windows of {averaged.map_window:.4g} {per}; {resolution}", xlabel="time [s]", ylabel=axis
            )
    return figure


def _density(axes: Axes, density: Density, lines: tuple[Line, ...], unit: str, axis: str) -> None:
    axes.loglog(density.f[1:], density.s[1:], color=BLUE)
    low, high = axes.get_ylim()
    top = float(density.s[1:].max(initial=0.0))
    low = max(low, 1e-12 * top) if top else low
    axes.set_ylabel(f"power spectral density\n[{unit}]")
    left, right = axes.get_xlim()
    rows: list[list[float]] = []
    for line in lines:  # the strongest first
        if line.rms**2 < _NAMED * density.rms**2:
            continue
        at = math.log(line.at / left) / math.log(right / left)
        row = _free_row(rows, at)
        if row == len(rows):
            rows.append([])
        rows[row].append(at)
        digits = max(0, 3 - math.floor(math.log10(line.at)))  # at least four, without an exponent
        share = 100.0 * line.rms**2 / density.rms**2
        text = f"{line.at:.{digits}f} {axis}, {share:.2g} %"
        axes.annotate(
            text,
            (line.at, line.density),
            (line.at, 0.95 - _ROW * row),
            ha="center",
            fontsize=9,
            color=GREY,
            textcoords=("data", "axes fraction"),
            arrowprops={"arrowstyle": "-", "color": GREY, "lw": 0.6},
            bbox={"facecolor": "white", "alpha": 0.8, "linewidth": 0.0, "pad": 0.5},
        )
    labelled = _ROW * len(rows) + 0.02  # share of the height, for the labels
    axes.set_ylim(low, low * (high / low) ** (1.0 / (1.0 - labelled)))


def _free_row(rows: list[list[float]], at: float) -> int:
    """The first row of labels with room for one at `at`, or the one after the last."""
    for number, row in enumerate(rows):
        if all(abs(at - other) >= _WIDE for other in row):
            return number
    return len(rows)


def _map(axes: Axes, course: Map, density: Density, unit: str) -> None:
    above = np.cumsum(density.s[::-1])[::-1] / max(float(density.s.sum()), 1e-300)
    top = density.f[min(int(np.count_nonzero(above > _ALL)), density.f.size - 1)]
    shown = course.f <= max(1.3 * top, course.f[min(20, course.f.size - 1)])
    s = 10.0 * np.log10(np.maximum(course.s[shown], 1e-30))
    best = float(np.nanmax(s, initial=-300.0))
    _levels(axes, course.t, course.f[shown], s, best, unit)


def pressure_figure(pressure: Pressure) -> Figure:
    """Draw the maps, all on one scale; the contacts of an instant side by side."""
    surfaces = pressure.points.surfaces
    instants = [pressure.maps[at : at + len(surfaces)] for at in range(0, len(pressure.maps), len(surfaces))]
    across = 3 if len(instants) in (3, 5, 6, 9) else min(len(instants), 4)
    down = -(-len(instants) // across)
    size = (1.2 + 3.0 * across, 1.9 + 2.9 * down)
    with page(*size, f"{pressure.scene}: contact pressure", layout="constrained") as figure:
        drawn = figure.subplots(down, across, squeeze=False)
        largest = max(shown.largest for shown in pressure.maps)
        scale = pressure.points.scale
        x, y = where(surfaces)
        for number, axes in enumerate(drawn.flat):
            if number >= len(instants):
                axes.set_axis_off()
                continue
            now = instants[number]
            draw_map(axes, surfaces, [shown.pressures for shown in now], scale)
            pressed = sum(shown.fraction * shown.pressures.size for shown in now)
            share = pressed / sum(shown.pressures.size for shown in now)
            head = f"({chr(ord('a') + number)}) {now[0].time:.5g} s, {100 * share:.0f} % in contact"
            axes.set_title("\n".join(filter(None, (head, now[0].why))), fontsize=9.5)
            if number + across >= len(instants):
                axes.set_xlabel(x)
            if number % across == 0:
                axes.set_ylabel(y)
        draw_scale(drawn[0, 0], scale, largest > scale, ax=drawn, location="bottom", aspect=45, shrink=0.7)
    return figure


def sound_figure(sound: Sound) -> Figure:
    """Return the figure of `sound`."""
    with page(12.0, 7.6, f"{sound.scene}: {plain(sound.channel)}", layout="constrained") as figure:
        signal, spectrum, level = figure.subplots(3, 1, sharex=True, height_ratios=(1.0, 1.5, 1.0))
        every = -(-sound.v.size // _COLUMNS)
        edges = np.arange(0, sound.v.size, every)
        t = sound.t(edges)
        low = np.minimum.reduceat(sound.v, edges)
        high = np.maximum.reduceat(sound.v, edges)
        signal.fill_between(t, low, high, color=BLUE, lw=0.5)
        signal.set_ylabel(f"{plain(sound.channel)} [{sound.unit}]")
        for span in curves.controlled(sound.run):
            if span.begin > 0.0 or span.end < curves.end_of(sound.run):  # one that works throughout needs no mark
                for axes in (signal, level):
                    axes.axvspan(span.begin, span.end, color=GREEN, alpha=0.12, lw=0)
                signal.annotate(span.text, (span.begin, 1.01), xycoords=("data", "axes fraction"), color=GREEN)
        highest = max((squeal.highest for squeal in sound.squeals), default=0.0)
        shown = sound.frequencies <= max(6e3, 1.5 * highest)
        top = float(sound.spectrum.max())
        khz = 1e-3 * sound.frequencies[shown]
        levels = sound.spectrum[:, shown].T
        _levels(spectrum, sound.times, khz, levels, top, f"level [{sound.reference}]")
        spectrum.set_ylabel("frequency [kHz]")
        level.plot(sound.times, sound.level, color=BLUE, label="total")
        level.plot(sound.times, sound.tone, color=VERMILION, label="loudest tone above 1 kHz")
        level.axhline(sound.threshold, color=GREY, lw=0.8, ls=":", label="squeal above")
        level.set(ylabel=f"level [{sound.reference}]", xlabel="time [s]", xlim=(sound.times[0], sound.times[-1]))
        quietest = float(np.percentile(sound.tone, 1.0)) - 5.0
        level.set_ylim(max(quietest, float(sound.level.max()) - 120.0), None)
        level.legend(loc="lower right", bbox_to_anchor=(1.0, 1.0), ncols=3, borderaxespad=0.0)
    return figure


def events_figure(events: Events) -> Figure:
    """Draw the events in the spectrogram, frequency and growth over a condition or time, and beside eigenvalues."""
    sweep = events.sweep
    with page(14.0, 9.0, f"{events.scene}: events of {plain(events.name)}", layout="constrained") as figure:
        grid = figure.add_gridspec(2, 3 if sweep else 2)
        heard = figure.add_subplot(grid[0, :])
        t = events.times
        f = events.frequencies
        levels = events.spectrum
        top = max((1.5 * event.frequency for event in events.events), default=float(f[-1]))
        shown = f <= max(top, f[min(40, f.size - 1)])
        every = max(-(-t.size // (_COLUMNS // 2)), 1)
        every_line = max(-(-int(shown.sum()) // _LINES), 1)
        best = max(float(np.nanmax(levels, initial=0.0)), 30.0)
        thin = levels[::every, shown][:, ::every_line]
        _levels(heard, t[::every], f[shown][::every_line], thin.T, best, "level over noise [dB]")
        for event in events.events:
            heard.plot([event.begin, event.end], [event.frequency] * 2, color=SKY, lw=1.0, marker="|", ms=9)
        heard.set(xlabel="time [s]", ylabel="frequency [Hz]", title=f"windows of {1e3 * events.window:.4g} ms")
        beside = events.beside or next(iter(events.others), "")
        x = np.array([event.at[beside] if beside else event.begin for event in events.events])
        f_events = np.array([event.linear for event in events.events])
        rise = np.array([(event.growth, event.low, event.high) for event in events.events]).reshape(-1, 3)
        wide = np.abs(rise[:, 1:].T - rise[:, 0])
        label = f"{plain(beside)} [{events.others[beside]}]" if beside else "time [s]"
        frequency = figure.add_subplot(grid[1, 0])
        growth = figure.add_subplot(grid[1, 1])
        mark: dict[str, Any] = {"color": ALARM, "fmt": "o", "ms": 4.5, "lw": 1.0, "capsize": 2.5, "label": "event"}
        panels = [(frequency, x, f_events, None, None), (growth, x, rise[:, 0], wide, None)]
        if sweep:
            locus = figure.add_subplot(grid[1, 2])
            panels.append((locus, rise[:, 0], f_events, None, wide))
            values = np.array(sweep.axis.values)
            for number, (g, h) in enumerate(zip(sweep.growth.T, sweep.frequency.T)):
                name = f"eigenvalue of {sweep.scene}" if not number else None
                for axes, across, up in ((frequency, values, h), (growth, values, g), (locus, g, h)):
                    axes.plot(across, up, color=BLUE, lw=1.2, marker=".", ms=3, label=name, zorder=1)
            locus.axvline(0.0, color=GREY, lw=0.8, ls=":")
            locus.set(xlabel="growth [1/s]", ylabel="frequency [Hz]", title="root locus")
        for axes, across, up, up_error, across_error in panels:
            axes.errorbar(across, up, up_error, across_error, **mark)
        if sweep:  # modes far from the events would hide them
            high = rise[:, 1:][np.isfinite(rise[:, 1:])]
            low = min(0.0, *(events.eigenvalue(event)[1] for event in events.events))
            top = max(float(high.max(initial=0.0)), np.nanmax(sweep.largest, initial=0.0))
            span = (low - 0.3 * abs(low), 1.3 * top)
            ends = (0.5 * float(f_events.min()), 1.5 * float(f_events.max()))
            growth.set_ylim(*span)
            locus.set(xlim=span, ylim=ends)
            frequency.set_ylim(*ends)
        growth.axhline(0.0, color=GREY, lw=0.8, ls=":")
        frequency.set(xlabel=label, ylabel="frequency [Hz]")
        growth.set(xlabel=label, ylabel="growth [1/s]", title="growth with its interval of 90 %")
        if events.events:
            frequency.legend(loc="best")
    return figure


def _levels(axes: Axes, t: Reals, f: Reals, levels: Floats, best: float, unit: str) -> None:
    """Draw `levels` [f, t] over time and frequency, with a bar of colours; `best` is the brightest."""
    mesh = axes.pcolormesh(t, f, levels, vmin=best - _RANGE, vmax=best, cmap="magma", shading="nearest")
    mesh.set_rasterized(True)
    axes.grid(visible=False)
    bar = axes.figure.colorbar(mesh, ax=axes, label=unit, pad=0.01)
    bar.outline.set_visible(False)  # type: ignore[operator]
