"""The figure of a run, 1600 pixels wide as PNG.

phases and marks of the protocol
the first plots of the rig: of most rigs velocity,      phase portrait, by controller or by time
forces, and the voltage of a piezo stack                close-up of some periods
state of every contact                                   what the run was, and how it went

The parts of a rig declare its plots (rig.picture.Plot), and a plant may declare a figure of its own. A user may choose
what is plotted instead. Outputs of a live run, of which only some are recorded, are drawn so that no vibration appears
that there was not (rig.view.curves.known).
"""

from __future__ import annotations

from collections.abc import Callable, Collection
from typing import TYPE_CHECKING, Any

import numpy as np

from rig.picture import IN_FIGURE
from rig.record import reader, run_data
from rig.record.film_points import Points, read
from rig.record.run import Integers, Reals, Run
from rig.scenes.rooms import plant_of
from rig.view import contact, pressure_figure
from rig.view.channels import Channels, Panel
from rig.view.curves import (
    COLUMNS,
    Known,
    Sheet,
    begin_of,
    channels_of,
    circuits,
    curves,
    end_of,
    largest,
    legend,
    plain,
    rate,
    sections,
    too_few,
)
from rig.view.header import BOTTOM, LEFT, RIGHT, Header, caption, heading, shade, stacked
from rig.view.palette import AMBER, BLUE, GREEN, PURPLE, STYLE, VERMILION, page
from rig.view.picture import drawer_of

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

    from rig.record.imports.import_run import Imported

_FASTER = 5.0  # a drive this many times faster than the other outputs would make them look flat
_POINTS = 40_000  # points of a portrait by time: more cannot be told apart, and each is a line of its own
_LANES = 30  # most contacts that have a strip each
_LANE = 7.5  # size of the letters beside the strips [pt]
_SECTIONS = (BLUE, VERMILION, GREEN, AMBER, PURPLE)


def figure(run: Run, only: Collection[str] = ()) -> Figure:
    """Return the figure of `run`, 1600 x 1050 pixels as PNG; with `only`, of these sensors and outputs over time.

    Raises UsageError for a name that the run does not have.
    """
    style = STYLE | {"text.parse_math": False}  # names and titles are texts of users: two "$" in them are no formula
    with page(12.8, 8.4, style=style, lasting=False) as made:  # a report writes long curves in its own way
        if only:
            _compose(made, run, only)
        else:
            _composer(run)(made, run)
    return made


def figure_of_import(imported: Imported) -> Figure:
    """Return the figure of the recording that was made of a measurement."""
    return figure(reader.open(imported.path))


def _composer(run: Run) -> Callable[[Figure, Run], None]:
    """The figure that the plant declares or that of contact points, if the run has the outputs; else the common one."""
    if run.measured:
        return _compose_measured
    scene = read(run.scene)
    declared = getattr(plant_of(scene.parameters), "FIGURE", None) if scene else None
    points = Points.of(scene) if scene and declared is None else None
    if points is not None and run.signals.keys() >= set(points.names):
        return pressure_figure.compose
    if scene is None or declared is None or not run.signals.keys() >= set(declared.outputs):
        return _compose
    composer: Callable[[Figure, Run], None] = drawer_of(declared, scene)
    return composer


def _compose(figure: Figure, run: Run, only: Collection[str] = ()) -> None:
    channels = channels_of(run)
    shown = _chosen(run, channels, only) if only else _usual(channels)
    pair = channels.portrait or ()
    curved = [n for panel in shown for n in panel.outputs if n not in _beyond(run, channels, panel)]
    sheet = Sheet.of(run, channels, [*curved, *pair])
    system = contact.system_of(run.scene)
    modes = contact.Modes(system).indices(run.mode)
    contacts = contact.Contacts(system)
    lanes = contacts.indices(run.mode) if contacts.names and run.mode.size else modes[None, :]
    labels = [plain(name) for name in contacts.names] if len(contacts.names) > 1 else ["contact"]
    width, height = figure.get_size_inches() * figure.dpi
    left = max(LEFT, _beside(figure, labels) / width)
    split = left + (RIGHT - left) * 0.655
    closed = circuits(run, system)
    header = Header(figure, run, (split - left) * width, closed)
    strips = min(len(labels), _LANES) if len(labels) > 1 else 2.6
    tall = strips * 1.25 * _LANE / 72.0 * figure.dpi / height
    drawn, top = stacked(figure, run, header, max(len(shown), 1), (left, split, BOTTOM + tall + 0.022))
    for axes, panel in zip(drawn, shown):
        draw_panel(axes, sheet, panel)
    strip = figure.add_axes((left, BOTTOM, split - left, tall), sharex=drawn[0])
    _strip(strip, run, lanes, labels)
    for axes in drawn:
        axes.tick_params(labelbottom=False)
        shade(axes, run, closed)
    bars = int(channels.portrait is not None and len(sections(run)) < 2)
    right = figure.add_gridspec(
        3,
        1 + bars,
        height_ratios=(2.1, 1.5, 1.0),
        width_ratios=(1.0, 0.035)[: 1 + bars],
        left=split + 0.078,
        right=RIGHT - 0.045 * bars,
        top=top,
        bottom=BOTTOM,
        hspace=0.42,
        wspace=0.04,
    )
    beside = []
    if channels.portrait is not None:
        beside.append(figure.add_subplot(right[0, 0]))
        bar = figure.add_subplot(right[0, 1]) if bars else None
        _portrait(beside[0], bar, sheet, *channels.portrait)
    beside.append(figure.add_subplot(right[1, 0] if beside else right[:2, 0]))
    patch = system.patches[0].name if system and len(labels) > 1 else ""
    _close_up(beside[-1], sheet, modes, patch)
    caption(figure.add_subplot(right[2, :]), run, lanes)
    figure.align_ylabels(drawn)
    figure.align_ylabels(beside)
    heading(figure, run, left)


def _compose_measured(figure: Figure, run: Run) -> None:
    """Every channel of a measurement over time, those of one unit together."""
    channels = channels_of(run)
    sheet = Sheet.of(run, channels, [])
    shown = _chosen(run, channels, list(run.measurements))
    header = Header(figure, run, (RIGHT - LEFT) * figure.get_size_inches()[0] * figure.dpi)
    drawn, _ = stacked(figure, run, header, max(len(shown), 1), (LEFT, RIGHT, BOTTOM))
    for axes, panel in zip(drawn, shown):
        draw_panel(axes, sheet, panel)
        axes.tick_params(labelbottom=axes is drawn[-1])
    drawn[-1].set_xlabel("time [s]")
    figure.align_ylabels(drawn)
    heading(figure, run, LEFT)


def _usual(channels: Channels) -> list[Panel]:
    """The first two plots, and those that belong into every figure."""
    shown = [panel for panel in channels.panels if panel.outputs]
    return shown[:2] + [panel for panel in shown[2:] if panel.place <= IN_FIGURE]


def _chosen(run: Run, channels: Channels, only: Collection[str]) -> list[Panel]:
    """The plots of the sensors and outputs `only`. A name that both have means both."""
    known = run_data.signals(run)
    for name in only:
        if name not in known and name not in run.signals:
            raise run_data.unknown(name, known, "run")
    outputs = {name.removeprefix(run_data.TRUE) for name in only} & run.signals.keys()
    points = (Panel(f"{plain(n)} [{run.units.get(n, '')}]", (n,), (), 0) for n in channels.at_points)
    panels = []
    for panel in (*channels.panels, *points):
        shown = tuple(name for name in panel.outputs if name in outputs)
        sensors = tuple(name for name in panel.sensors if name in only)
        if shown or sensors:
            panels.append(panel._replace(outputs=shown, sensors=sensors))
    return panels


def _beside(figure: Figure, labels: Collection[str]) -> float:
    """Width [px] of the longest label, with its distance from the axes and from the edge."""
    from matplotlib.font_manager import FontProperties

    of: Any = figure.canvas.get_renderer()  # type: ignore[attr-defined]
    size = FontProperties(size=_LANE)
    return float(max(of.get_text_width_height_descent(label, size, False)[0] for label in labels)) + 20.0


def draw_panel(axes: Axes, sheet: Sheet, panel: Panel) -> None:
    """Draw the outputs and sensors of a plot. The speed of a drive that is much larger than all others is a text."""
    run = sheet.run
    title, _, unit = panel.title.rpartition(" [")
    unit = unit.removesuffix("]")
    measured = None if panel.outputs else sheet.sampled(panel.sensors[0], 1.0)[1]
    factor, shown = sheet.scales.of(unit, measured)
    fast = _beyond(run, sheet.channels, panel)
    slow = [output for output in panel.outputs if output not in fast]
    curves(axes, sheet, slow, panel.sensors, factor)
    for row, output in enumerate(fast):
        size = factor * largest(run.signals[output])
        digits = f"{size:.3g}" if size < 1000 else f"{size:.0f}"
        axes.text(
            0.995,
            0.97 - 0.07 * row,
            f"{plain(output)}: {digits} {shown}",
            transform=axes.transAxes,
            ha="right",
            va="top",
            fontsize=9.5,
            color=sheet.channels.colours[output],
        )
    axes.set_ylabel(f"{title} [{shown}]")


def _beyond(run: Run, channels: Channels, panel: Panel) -> list[str]:
    """Drives of a plot that are so much faster than the other outputs that these would look flat."""
    drives = channels.drives
    known = [name for name in panel.outputs if name in run.signals]
    most = largest(*(run.signals[name] for name in known if name not in drives))
    return [name for name in known if name in drives and largest(run.signals[name]) > _FASTER * most > 0.0]


def _strip(axes: Axes, run: Run, lanes: Integers, labels: list[str]) -> None:
    """Draw the states of contacts [contact, row] over time, one below the other.

    Where modes alternate within a pixel, or contacts are too many for a strip each, their colours mix by their shares.
    """
    axes.grid(False)
    axes.set_xlabel("time [s]")
    if not lanes.size:
        axes.set_yticks([])
        axes.set_ylabel("contact", rotation=0, ha="right", va="center")
        axes.text(0.5, 0.5, "not recorded", transform=axes.transAxes, ha="center", va="center", color="#777777")
        return
    palette = np.array([contact.rgb(colour) for colour in contact.COLOURS]) / 255.0
    columns = min(COLUMNS, lanes.shape[1])
    starts = np.arange(columns) * lanes.shape[1] // columns
    counts = np.diff([*starts, lanes.shape[1]])
    mixed = np.array([np.add.reduceat(palette[modes], starts, axis=0) / counts[:, None] for modes in lanes])
    if len(lanes) > _LANES:
        mixed = mixed.mean(axis=0)[None]
        labels = [f"{len(lanes)} contacts"]
    count = len(labels)
    extent = (begin_of(run), end_of(run), float(count), 0.0)
    axes.imshow(mixed, aspect="auto", extent=extent, interpolation="nearest")
    axes.set_yticks(np.arange(count) + 0.5, labels, fontsize=_LANE if count > 1 else None)
    axes.tick_params(axis="y", length=0.0)
    for row in range(1, count):
        axes.axhline(row, color="white", lw=0.8)
    from matplotlib.patches import Patch

    seen = [Patch(color=contact.COLOURS[i], label=contact.NAMES[i]) for i in np.unique(lanes)]
    below = -36.0 / axes.get_window_extent().height
    axes.legend(
        handles=seen,
        loc="upper right",
        bbox_to_anchor=(1.0, below),
        ncols=len(seen),
        handlelength=1.1,
        borderaxespad=0.0,
    )


def _portrait(axes: Axes, bar: Axes | None, sheet: Sheet, displacement: str, velocity: str) -> None:
    """Draw velocity over displacement, with `bar` in the colour of the time. Points are not joined where lines lie."""
    run = sheet.run
    factor, unit = sheet.scales.of(run.units.get(displacement, ""))
    x = factor * run.signals[displacement]
    factor, per_time = sheet.scales.of(run.units.get(velocity, ""))
    v = factor * run.signals[velocity]
    axes.set(
        title=f"phase portrait, {rate(run)} points per second" if sheet.style else "phase portrait",
        xlabel=f"{plain(displacement)} [{unit}]",
        ylabel=f"{plain(velocity)} [{per_time}]",
    )
    axes.locator_params(axis="x", nbins=4)
    if not x.size or sheet.known is Known.ALIAS:
        if bar is not None:
            bar.set_axis_off()
        if x.size:
            axes.set(title="phase portrait", xticks=[])
            too_few(axes, run, f"{plain(displacement)}, {plain(velocity)}", alone=True)
        return
    dots = sheet.style or {"lw": 0.8}
    if bar is not None:
        _by_time(axes, bar, sheet, x, v)
        return
    driven = sections(run)
    titles = list(dict.fromkeys(section.text for section in driven))
    labelled = set()
    for begin, end, title in sorted(driven, key=lambda section: section.text != "free"):
        inside = (run.time >= begin) & (run.time <= end)
        colour = _SECTIONS[titles.index(title) % len(_SECTIONS)]
        label = None
        if title not in labelled:
            label = title if title == "free" else f"with {title}"
        labelled.add(title)
        axes.plot(x[inside], v[inside], color=colour, alpha=0.85, label=label, **dots)
    legend(axes, len(titles))


def _by_time(axes: Axes, bar: Axes, sheet: Sheet, x: Reals, v: Reals) -> None:
    from matplotlib.collections import LineCollection
    from matplotlib.ticker import MaxNLocator

    time = sheet.run.time
    every = max(x.size // _POINTS, 1)
    points = np.stack((x[::every], v[::every]), axis=1)
    at = time[::every]
    shown: Any
    if sheet.style:
        shown = axes.scatter(points[:, 0], points[:, 1], 3.0, at, lw=0, cmap="viridis_r")
    else:
        lines = np.stack((points[:-1], points[1:]), axis=1)
        shown = LineCollection(list(lines), cmap="viridis_r", lw=0.9)
        shown.set_array(at[:-1])
        axes.add_collection(shown)
        axes.autoscale_view()
    drawn = axes.figure.colorbar(shown, cax=bar, ticks=MaxNLocator(6))  # type: ignore[union-attr]
    bar.grid(False)
    drawn.set_label("time [s]")
    drawn.outline.set_visible(False)  # type: ignore[operator]


def _close_up(axes: Axes, sheet: Sheet, modes: Integers, patch: str) -> None:
    """Draw some periods from the part of the run with the strongest vibration; `patch`: the contact of `modes`."""
    run = sheet.run
    channels = sheet.channels
    watched = channels.portrait[1] if channels.portrait else next(iter(channels.colours), "")
    t = run.time
    v = run.signals.get(watched, np.empty(0))
    fine = sheet.fine(watched)
    if fine is not None:
        t, v = sheet.sampled(fine, 1.0)
    factor, unit = sheet.scales.of(run.units.get(watched, ""), v)
    begin, end = _liveliest(t, v, run, modes)
    axes.set_xlabel("time [s]")
    title = "close-up" if fine is None else f"close-up: {plain(fine)}"
    if watched:
        axes.set_ylabel(f"{plain(watched)} [{unit}]")
    inside = (run.time >= begin) & (run.time <= end)
    if modes.size and not sheet.style:
        stuck = (modes[inside] == 0).astype(np.int8)
        if stuck.any():
            title += f"; shaded: {plain(patch)} sticks" if patch else "; shaded: stick"
        edges = np.flatnonzero(np.diff(np.concatenate(([0], stuck, [0]))))
        at = np.append(run.time[inside], end)
        for low, high in edges.reshape(-1, 2):
            axes.axvspan(at[low], at[high], color=contact.COLOURS[0], alpha=0.16, lw=0)
    axes.set_title(title)
    panel = channels.panel_of(watched)
    if panel:
        fast = _beyond(run, channels, panel)
        drives = [name for name in panel.outputs if name in channels.drives and name not in fast]
        for name in drives:
            if name != watched:
                axes.plot(run.time[inside], factor * run.signals[name][inside], color=channels.colours[name], lw=1.4)
        inside = (t >= begin) & (t <= end)
        line = {"lw": 1.4}
        style = line if fine is not None else sheet.style or line
        if fine is None and sheet.known is Known.ALIAS:
            too_few(axes, run, plain(watched), alone=True)
        else:
            axes.plot(t[inside], factor * v[inside], color=channels.colours[watched], **style)
    axes.set_xlim(begin, end)
    axes.ticklabel_format(axis="x", useOffset=False)
    axes.locator_params(axis="x", nbins=3)


def _liveliest(t: Reals, v: Reals, run: Run, modes: Integers) -> tuple[float, float]:
    """Begin and end [s] of four periods, or a tenth of the run, in which the values v(t) vary most."""
    end = end_of(run)
    if v.size < 20:
        return 0.0, end or 1.0
    width = (end - float(t[0])) / 10
    begin = _strongest(t, v, width)
    turns = run.time[1:][np.diff((modes == 0).astype(np.int8)) > 0] if modes.size else np.empty(0)
    if turns.size < 5:  # it hardly sticks
        part = (t >= begin) & (t <= begin + width)
        turns = _crossings(t[part], v[part])
    if turns.size < 5:
        turns = _crossings(t, v)
    if turns.size > 1:
        shortest = 4.0 * float(np.median(np.diff(t)))
        width = float(np.clip(4.0 * _typical(np.diff(turns)), shortest, (end - t[0]) / 2))
        begin = _strongest(t, v, width)
    return begin, min(begin + width, end)


def _crossings(t: Reals, v: Reals) -> Reals:
    """Times at which v(t) crosses its mean upwards."""
    known = np.isfinite(v)
    mean = float(v[known].mean()) if known.any() else 0.0
    above = v[known] > mean
    return np.asarray(t[known][1:][above[1:] > above[:-1]])


def _strongest(t: Reals, v: Reals, width: float) -> float:
    """Begin of the first part of this width [s] whose values vary about as much as in any other."""
    size = max(int(width / (t[-1] - t[0] or 1.0) * v.size), 2)
    starts = np.arange(0, max(v.size - size, 0) + 1, max(size // 4, 1))
    swings = np.array([_swing(v[start : start + size]) for start in starts])
    strongest = int(np.argmax(swings >= 0.98 * swings.max()))
    return float(t[starts[strongest]])


def _swing(v: Reals) -> float:
    """Standard deviation of the samples that are not lost; 0 if all are."""
    known = v[np.isfinite(v)]
    return float(known.std()) if known.size else 0.0


def _typical(gaps: Reals) -> float:
    """A typical gap: weighted by time, so that many short gaps (chatter) or one long pause have little influence."""
    ordered = np.sort(gaps)
    return float(ordered[np.searchsorted(np.cumsum(ordered), 0.4 * ordered.sum())])
