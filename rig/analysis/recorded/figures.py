"""Figures of the analyses of a recording.

Figures that relate channels of a recording: frequency response, phase portrait.

The figure of two recordings: channels over each other, and their difference.

A sound as a picture: the signal, its short-time spectrum, its level.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from rig.analysis.recorded.against_scene import AgainstScene, Pair
from rig.analysis.recorded.comparison import Compared
from rig.analysis.recorded.density import Density, Line, Map
from rig.analysis.recorded.events import Events
from rig.analysis.recorded.hysteresis import Hysteresis
from rig.analysis.recorded.orders import Orders
from rig.analysis.recorded.portrait import Portrait, Section
from rig.analysis.recorded.pressure import Pressure
from rig.analysis.recorded.response import Response
from rig.analysis.recorded.series import scene_name
from rig.analysis.recorded.sound import Sound
from rig.analysis.recorded.spectrum import Spectrum
from rig.analysis.recorded.stick_slip import StickSlip
from rig.printable import counted
from rig.record.compare import series_of
from rig.record.run import Reals
from rig.record.statistics import whole_signals
from rig.view import curves
from rig.view.curves import largest, plain, scaled, thinned
from rig.view.palette import ALARM, AMBER, BLUE, GREEN, GREY, SKY, VERMILION, page
from rig.view.pressure import draw_map, draw_scale, where

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure


_NAMED_PEAKS = 6  # resonances that a picture labels, the largest ones
# Samples of a portrait, channels of a comparison (those that differ first), columns of a sound
_DRAWN_SAMPLES, _DRAWN_CHANNELS, _COLUMNS = 40_000, 5, 2400
_DRAWN_CYCLES = 12  # of a measurement beside its simulation
Floats = NDArray[np.floating[Any]]
_RANGE = 70.0  # range of a map [dB below its maximum]
_NAMED = 0.01  # share of the mean square from which on a picture labels a line
_WIDE, _ROW = 0.17, 0.075  # width and height of such a label as shares of the axes
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
            label = f"{over} {way}" if f"{over} {way}" not in loop.get_legend_handles_labels()[1] else None
            loop.plot(*thinned(along * curve.speed, size * curve.rms), color=colour, ls=dashes, label=label)
            for axes, values in ((rms, size * curve.rms), (speed, along * curve.speed)):
                axes.plot(*thinned(curve.t, values), color=colour)
            if math.isfinite(curve.stick):
                what = "last stick" if curve.branch.rises else "first stick"
                loop.axvline(
                    along * curve.stick,
                    color=colour,
                    lw=0.9,
                    ls=":",
                    label=f"{what}: {along * curve.stick:.4g} {shown}",
                )
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
        for (density, over_time), averaged in zip(figure.subplots(2, len(both), squeeze=False).T, both):
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
        row = next((i for i, row in enumerate(rows) if all(abs(at - other) >= _WIDE for other in row)), len(rows))
        rows += [[]] if row == len(rows) else []
        rows[row].append(at)
        digits = max(0, 3 - math.floor(math.log10(line.at)))  # at least four, without an exponent
        text = f"{line.at:.{digits}f} {axis}, {100.0 * line.rms**2 / density.rms**2:.2g} %"
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
    share = _ROW * len(rows) + 0.02  # of the height, for the labels
    axes.set_ylim(low, low * (high / low) ** (1.0 / (1.0 - share)))


def _map(axes: Axes, course: Map, density: Density, unit: str) -> None:
    above = np.cumsum(density.s[::-1])[::-1] / max(float(density.s.sum()), 1e-300)
    top = density.f[min(int(np.count_nonzero(above > _ALL)), density.f.size - 1)]
    shown = course.f <= max(1.3 * top, course.f[min(20, course.f.size - 1)])
    s = 10.0 * np.log10(np.maximum(course.s[shown], 1e-30))
    best = float(np.nanmax(s, initial=-300.0))
    _levels(axes, course.t, course.f[shown], s, best, unit)


def _levels(axes: Axes, t: Reals, f: Reals, levels: Floats, best: float, unit: str) -> None:
    """Draw `levels` [f, t] over time and frequency, with a bar of colours; `best` is the brightest."""
    mesh = axes.pcolormesh(t, f, levels, vmin=best - _RANGE, vmax=best, cmap="magma", shading="nearest")
    mesh.set_rasterized(True)
    axes.grid(visible=False)
    bar = axes.figure.colorbar(mesh, ax=axes, label=unit, pad=0.01)
    bar.outline.set_visible(False)  # type: ignore[operator]


def pressure_figure(pressure: Pressure) -> Figure:
    """Draw the maps, all on one scale; the contacts of an instant side by side."""
    surfaces = pressure.points.surfaces
    instants = [pressure.maps[at : at + len(surfaces)] for at in range(0, len(pressure.maps), len(surfaces))]
    across = 3 if len(instants) in (3, 5, 6, 9) else min(len(instants), 4)
    down = -(-len(instants) // across)
    with page(
        1.2 + 3.0 * across, 1.9 + 2.9 * down, f"{pressure.scene}: contact pressure", layout="constrained"
    ) as figure:
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
            share = sum(shown.fraction * shown.pressures.size for shown in now) / sum(m.pressures.size for m in now)
            head = f"({chr(ord('a') + number)}) {now[0].time:.5g} s, {100 * share:.0f} % in contact"
            axes.set_title("\n".join(filter(None, (head, now[0].why))), fontsize=9.5)
            if number + across >= len(instants):
                axes.set_xlabel(x)
            if number % across == 0:
                axes.set_ylabel(y)
        draw_scale(drawn[0, 0], scale, largest > scale, ax=drawn, location="bottom", aspect=45, shrink=0.7)
    return figure


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
            size.annotate(
                text, (peak.at, peak.magnitude), (0, 4), textcoords="offset points", ha="center", fontsize=9, color=GREY
            )
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


def comparison_figure(compared: Compared) -> Figure:
    """Draw up to five channels of two runs, those that differ first, with their difference."""
    first, second = compared.runs
    ours, two = (series_of(run, compared.begin, compared.end) for run in (first, second))
    known = {signal.topic: signal for signal in compared.signals.signals}
    names = [
        name for name in (*whole_signals(first), *(f"meas/{name}" for name in first.measurements)) if name in known
    ]
    names = sorted(names, key=lambda name: known[name].equal)[:_DRAWN_CHANNELS]
    title = " and ".join(dict.fromkeys(scene_name(run) for run in (first, second)))
    with page(14.0, 1.4 + 2.1 * len(names), f"{title}: two recordings", layout="constrained") as figure:
        rows = figure.subplots(max(len(names), 1), 2, squeeze=False, sharex=True, width_ratios=(1.5, 1.0))
        for (over, apart), name in zip(rows, names):
            factor, unit = scaled(first.units.get(name, ""), largest(ours[name].values, two[name].values))
            for which, series, style in zip(
                compared.labels, (ours[name], two[name]), ({"color": BLUE}, {"color": AMBER, "ls": "--"})
            ):
                t = np.multiply(series.t_ns, 1e-9, dtype=np.float64)
                over.plot(*thinned(t, factor * series.values), lw=1.0, label=which, **style)
            over.set_ylabel(f"{plain(name.removeprefix('meas/'))}\n[{unit}]")
            shared, at_one, at_two = np.intersect1d(ours[name].t_ns, two[name].t_ns, return_indices=True)
            away = factor * (two[name].values[at_two] - ours[name].values[at_one])
            apart.plot(*thinned(np.multiply(shared, 1e-9, dtype=np.float64), away), lw=0.9, color=GREY)
            apart.set_ylabel(f"difference B - A\n[{unit}]")
            signal = known[name]
            apart.set_title(
                f"from t = {signal.time:.6g} s on, up to {signal.deviation:.3g} of the range"
                if signal.differing
                else "equal, bit by bit"
            )
        rows[0, 0].legend(loc="lower left", bbox_to_anchor=(0.0, 1.0), ncols=1, borderaxespad=0.2)
        for axes in rows[-1]:
            axes.set_xlabel("time [s]")
        figure.align_ylabels(rows[:, 0])
        figure.align_ylabels(rows[:, 1])
    return figure


def against_scene_figure(comparison: AgainstScene) -> Figure:
    """Draw every channel over time, aligned by the first event, and its cycles over their phase; friction if known."""
    rows = len(comparison.pairs) + (comparison.stick is not None)
    title = f"{comparison.recording} and its simulation, {comparison.scene}"
    with page(14.0, 1.6 + 3.0 * rows, title, layout="constrained") as figure:
        axes = figure.subplots(rows, 2, squeeze=False, width_ratios=(1.6, 1.0))
        for (over, phase), pair in zip(axes, comparison.pairs):
            _in_time(over, pair)
            _in_phase(phase, pair)
        axes[0, 0].legend(loc="lower right", bbox_to_anchor=(1.0, 1.0), ncols=2)
        if comparison.stick is not None:
            _slips(axes[-1, 0], axes[-1, 1], comparison.stick)
        figure.align_ylabels(axes[:, 0])
    return figure


def _in_time(axes: Axes, pair: Pair) -> None:
    """A few cycles of both, the first event at time 0; without cycles all of it, as it was."""
    factor, unit = scaled(pair.unit, largest(pair.measured, pair.simulated))
    for i, (v, colour, dashes) in enumerate(((pair.measured, BLUE, "-"), (pair.simulated, AMBER, "--"))):
        t = pair.t
        here = np.ones(v.size, np.bool_)
        if pair.cycles:
            t = t - pair.cycles[i].begins[0]
            span = _DRAWN_CYCLES * pair.cycles[0].period
            here = (t >= -0.1 * span) & (t <= span)
        axes.plot(
            *thinned(t[here], factor * v[here]), lw=1.0, label=("measured", "simulated")[i], color=colour, ls=dashes
        )
    axes.set_ylabel(f"{plain(pair.channel)}\n[{unit}]")
    axes.set_xlabel("time from the first event [s]" if pair.cycles else "time [s]")


def _in_phase(axes: Axes, pair: Pair) -> None:
    """The median of the cycles with the band of eight tenths of them."""
    if pair.cycles is None:
        axes.text(0.5, 0.5, "less than three cycles", ha="center", va="center", color=GREY, transform=axes.transAxes)
        axes.set_axis_off()
        return
    factor, unit = scaled(pair.unit, largest(pair.measured, pair.simulated))
    for cycles, colour in zip(pair.cycles, (BLUE, AMBER)):
        phase = np.linspace(0.0, 1.0, cycles.middle.size)
        axes.plot(phase, factor * cycles.middle, color=colour, lw=1.4)
        axes.fill_between(phase, factor * cycles.low, factor * cycles.high, color=colour, alpha=0.18, lw=0.0)
    axes.set(
        xlabel="phase of the cycle [1]",
        ylabel=f"{plain(pair.channel)} [{unit}]",
        title="median and 10 to 90 % of the cycles",
    )


def _slips(times: Axes, friction: Axes, both: tuple[StickSlip, StickSlip]) -> None:
    """How long both stick, and friction over rising slip speed."""
    longest = max((np.nan_to_num(slip.stick) for contact in both for slip in contact.slips), default=1.0) or 1.0
    for contact, colour, which in zip(both, (BLUE, AMBER), ("measured", "simulated")):
        sticks = [slip.stick for slip in contact.slips if np.isfinite(slip.stick)]
        times.hist(sticks, list(np.linspace(0.0, longest, 40)), color=colour, alpha=0.6, label=which)
        if contact.up is not None and contact.up.speed.size:
            up = contact.up
            friction.errorbar(up.speed, up.friction, 2.0 * up.error, color=colour, marker="o", ms=3.5, lw=1.0)
    times.set(xlabel="stick time [s]", ylabel="number of slips [1]")
    friction.set_visible(bool(both[0].force_unit))
    friction.set(xlabel=f"rising slip speed [{both[0].speed_unit}]", ylabel=f"friction [{both[0].force_unit}]")


def sound_figure(sound: Sound) -> Figure:
    """Return the figure of `sound`."""
    with page(12.0, 7.6, f"{sound.scene}: {plain(sound.channel)}", layout="constrained") as figure:
        signal, spectrum, level = figure.subplots(3, 1, sharex=True, height_ratios=(1.0, 1.5, 1.0))
        every = -(-sound.v.size // _COLUMNS)
        edges = np.arange(0, sound.v.size, every)
        t = sound.start + edges / sound.rate
        low = np.minimum.reduceat(sound.v, edges)
        high = np.maximum.reduceat(sound.v, edges)
        signal.fill_between(t, low, high, color=BLUE, lw=0.5)
        signal.set_ylabel(f"{plain(sound.channel)} [{sound.unit}]")
        for span in curves.controlled(sound.run):
            if span.begin > 0.0 or span.end < curves.end_of(sound.run):  # one that works throughout needs no mark
                for axes in (signal, level):
                    axes.axvspan(span.begin, span.end, color=GREEN, alpha=0.12, lw=0)
                signal.annotate(span.text, (span.begin, 1.01), xycoords=("data", "axes fraction"), color=GREEN)
        shown = sound.frequencies <= max(6e3, 1.5 * max((squeal.highest for squeal in sound.squeals), default=0.0))
        top = float(sound.spectrum.max())
        khz = 1e-3 * sound.frequencies[shown]
        levels = sound.spectrum[:, shown].T
        _levels(spectrum, sound.times, khz, levels, top, f"level [{sound.reference}]")
        spectrum.set_ylabel("frequency [kHz]")
        level.plot(sound.times, sound.level, color=BLUE, label="total")
        level.plot(sound.times, sound.tone, color=VERMILION, label="loudest tone above 1 kHz")
        level.axhline(sound.threshold, color=GREY, lw=0.8, ls=":", label="squeal above")
        level.set(ylabel=f"level [{sound.reference}]", xlabel="time [s]", xlim=(sound.times[0], sound.times[-1]))
        level.set_ylim(max(float(np.percentile(sound.tone, 1.0)) - 5.0, float(sound.level.max()) - 120.0), None)
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
        rows, every = (max(-(-size // most), 1) for size, most in ((t.size, _COLUMNS // 2), (int(shown.sum()), 500)))
        best = max(float(np.nanmax(levels, initial=0.0)), 30.0)
        _levels(heard, t[::rows], f[shown][::every], levels[::rows, shown][:, ::every].T, best, "level over noise [dB]")
        for event in events.events:
            heard.plot([event.begin, event.end], [event.frequency] * 2, color=SKY, lw=1.0, marker="|", ms=9)
        heard.set(xlabel="time [s]", ylabel="frequency [Hz]", title=f"windows of {1e3 * events.window:.4g} ms")
        beside = events.beside or next(iter(events.others), "")
        x = np.array([event.at[beside] if beside else event.begin for event in events.events])
        f_events = np.array([event.linear for event in events.events])
        rise = np.array([[event.growth, event.low, event.high] for event in events.events]).reshape(-1, 3)
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
            span = (
                low - 0.3 * abs(low),
                1.3 * max(float(high.max(initial=0.0)), np.nanmax(sweep.largest, initial=0.0)),
            )
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
        for name, colour in (("stick", BLUE), ("motion", ALARM)):
            values = [getattr(slip, name) for slip in contact.slips if np.isfinite(getattr(slip, name))]
            times.hist(values, np.linspace(0.0, 1.05 * longest, 40), color=colour, alpha=0.6, label=f"{name} time")
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
