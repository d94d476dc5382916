"""The figure of a run, 1600 pixels wide as PNG.

phases and marks of the protocol                        phase portrait, by controller or by time
the first plots of the rig: of most rigs velocity,
forces, and the voltage of a piezo stack                close-up of some periods
contact state                                            what the run was, and how it went

The parts of a rig declare its plots (rig.picture.Plot), and a plant may declare a figure of its own.
"""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from rig.picture import IN_FIGURE
from rig.record.film_points import read
from rig.record.run import Integers, Reals, Run
from rig.scenes.rooms import plant_of
from rig.view import contact, timeline
from rig.view.caption import caption
from rig.view.channels import Channels, Panel
from rig.view.curves import (
    COLUMNS,
    channels_of,
    curves,
    heading,
    legend,
    name_circuits,
    phases,
    plain,
    shade,
)
from rig.view.palette import AMBER, BLUE, GREEN, PURPLE, VERMILION
from rig.view.picture import drawer_of
from rig.view.save_figure import put

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

_FASTER = 5.0
_SMALL = 5e-5  # m, rad: smaller displacements are shown in micrometres or microradians
_SECTIONS = (BLUE, VERMILION, GREEN, AMBER, PURPLE)
STYLE: dict[str, Any] = {
    "font.size": 10.5,
    "axes.titlesize": 11,
    "axes.titlelocation": "left",
    "axes.labelsize": 10.5,
    "axes.spines.top": False,
    "axes.spines.right": False,
    "axes.grid": True,
    "grid.color": "#e3e3e3",
    "grid.linewidth": 0.7,
    "legend.frameon": False,
    "legend.fontsize": 9.5,
    "lines.linewidth": 1.1,
    "agg.path.chunksize": 20000,
}


def draw(run: Run, path: Path | str) -> None:
    """Draw `run` into the file `path` (PNG, SVG or PDF, by its suffix). Creates the folder.

    Raises OutputError if the file cannot be written.
    """
    path = Path(path)
    path.parent.mkdir(parents=True, exist_ok=True)
    put(figure(run), path)


def figure(run: Run) -> Figure:
    """Return the figure of `run`, 1600 x 1050 pixels as PNG."""
    import matplotlib as mpl
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    style = STYLE | {"text.parse_math": False}  # names and titles are texts of users: two "$" in them are no formula
    with mpl.rc_context(style):  # type: ignore[arg-type]
        made = Figure(figsize=(12.8, 8.4), dpi=125, facecolor="white")
        FigureCanvasAgg(made)
        _composer(run)(made, run)
    return made


def _composer(run: Run) -> Callable[[Figure, Run], None]:
    """The figure that the plant declares, if the run has its outputs; else the common one."""
    scene = read(run.scene)
    own = getattr(plant_of(scene.parameters), "FIGURE", None) if scene else None
    if scene is None or own is None or not run.signals.keys() >= set(own.outputs):
        return _compose
    found: Callable[[Figure, Run], None] = drawer_of(own, scene)
    return found


def _compose(figure: Figure, run: Run) -> None:
    channels = channels_of(run)
    shown = [panel for panel in channels.panels if panel.outputs]
    shown = shown[:2] + [panel for panel in shown[2:] if panel.place <= IN_FIGURE]
    count = max(len(shown), 1)
    grid = figure.add_gridspec(
        2 + count, 2, width_ratios=(2.35, 1), height_ratios=(0.30, *[4.4 / count] * count, 0.26), hspace=0.13,
        wspace=0.21, left=0.076, right=0.985, top=0.94, bottom=0.072,
    )  # fmt: skip
    times = figure.add_subplot(grid[1, 0])
    times.set_xlim(timeline.begin_of(run), timeline.end_of(run) or 1.0)
    system = contact.system_of(run.scene)
    modes = contact.Modes(system).indices(run.mode)
    phases(figure.add_subplot(grid[0, 0], sharex=times), run)
    drawn = [times, *(figure.add_subplot(grid[row, 0], sharex=times) for row in range(2, 1 + count))]
    for axes, panel in zip(drawn, shown):
        draw_panel(axes, run, channels, panel)
    strip = figure.add_subplot(grid[-1, 0], sharex=times)
    _strip(strip, run, modes)
    closed = timeline.circuits(run, system)
    for axes in drawn:
        axes.tick_params(labelbottom=False)
        shade(axes, run, closed)
    name_circuits(drawn[-1], closed)
    right = grid[:, 1].subgridspec(3, 1, height_ratios=(2.3, 1.5, 0.85), hspace=0.42)
    if channels.portrait is not None:
        _portrait(figure.add_subplot(right[0]), run, *channels.portrait)
    _close_up(figure.add_subplot(right[1] if channels.portrait else right[:2]), run, channels, modes)
    caption(figure.add_subplot(right[2]), run, modes)
    figure.align_ylabels(drawn)
    heading(figure, run)


def draw_panel(axes: Axes, run: Run, channels: Channels, panel: Panel) -> None:
    """Draw the outputs of a plot over time. The speed of a drive that is much larger than all others is a text."""
    fast = _beyond(run, channels, panel)
    curves(axes, run, channels, [output for output in panel.outputs if output not in fast])
    for row, output in enumerate(fast):
        speed = f"{plain(output)}: {_largest(run, output):.3g} {run.units.get(output, '')}"
        axes.text(0.995, 0.97 - 0.07 * row, speed, transform=axes.transAxes, ha="right", va="top", fontsize=9.5,
                  color=channels.colours[output])  # fmt: skip
    axes.set_ylabel(panel.title)


def _largest(run: Run, *outputs: str) -> float:
    return max((float(np.nanmax(np.abs(run.signals[name]), initial=0.0)) for name in outputs), default=0.0)


def _beyond(run: Run, channels: Channels, panel: Panel) -> list[str]:
    """Drives of a plot that are so much faster than the other outputs that these would look flat."""
    most = _largest(run, *(name for name in panel.outputs if name not in channels.drives))
    return [n for n in panel.outputs if n in channels.drives and _largest(run, n) > _FASTER * most > 0.0]


def _strip(axes: Axes, run: Run, modes: Integers) -> None:
    """Draw the contact state over time; where modes alternate within a pixel, their colours mix by their shares."""
    axes.set_yticks([])
    axes.grid(False)
    axes.set_xlabel("time [s]")
    axes.set_ylabel("contact", rotation=0, ha="right", va="center")
    if not modes.size:
        axes.text(0.5, 0.5, "not recorded", transform=axes.transAxes, ha="center", va="center", color="#777777")
        return
    palette = np.array([contact.rgb(colour) for colour in contact.COLOURS]) / 255.0
    columns = min(COLUMNS, modes.size)
    starts = np.arange(columns) * modes.size // columns
    counts = np.diff([*starts, modes.size])
    mixed = np.add.reduceat(palette[modes], starts, axis=0) / counts[:, None]
    axes.imshow(mixed[None], aspect="auto", extent=(0.0, timeline.end_of(run), 0.0, 1.0), interpolation="nearest")
    from matplotlib.patches import Patch

    seen = [Patch(color=contact.COLOURS[i], label=contact.NAMES[i]) for i in np.unique(modes)]
    axes.legend(handles=seen, loc="upper right", bbox_to_anchor=(1.0, -0.62), ncols=len(seen), handlelength=1.1)


def _portrait(axes: Axes, run: Run, displacement: str, velocity: str) -> None:
    """Draw velocity over displacement."""
    x, v = run.signals[displacement], run.signals[velocity]
    unit = run.units.get(displacement, "")
    factor, prefix = (1e6, "u") if _largest(run, displacement) < _SMALL else (1e3, "m")
    if unit not in ("m", "rad"):
        factor, prefix = 1.0, ""
    axes.set_title("phase portrait")
    axes.set_xlabel(f"{plain(displacement)} [{prefix}{unit}]")
    axes.set_ylabel(f"{plain(velocity)} [{run.units.get(velocity, '')}]")
    if not x.size:
        return
    x = factor * x
    axes.locator_params(axis="x", nbins=5)
    sections = timeline.sections(run)
    if len(sections) > 1:
        names = list(dict.fromkeys(section.text for section in sections))
        first = dict.fromkeys(names, True)
        for section in sorted(sections, key=lambda s: s.text != "free"):
            inside = (run.time >= section.begin) & (run.time <= section.end)
            colour = _SECTIONS[names.index(section.text) % len(_SECTIONS)]
            label = section.text if section.text == "free" else f"with {section.text}"
            axes.plot(x[inside], v[inside], color=colour, lw=0.8, alpha=0.85,
                      label=label if first[section.text] else None)  # fmt: skip
            first[section.text] = False
        legend(axes, len(names))
    else:
        _by_time(axes, run, x, v)


def _by_time(axes: Axes, run: Run, x: Reals, v: Reals) -> None:
    from matplotlib.collections import LineCollection
    from matplotlib.ticker import MaxNLocator

    every = max(x.size // 40_000, 1)
    points = np.stack((x[::every], v[::every]), axis=1)
    lines = LineCollection(list(np.stack((points[:-1], points[1:]), axis=1)), cmap="viridis_r", lw=0.9)
    unit, scale = _clock(run)
    lines.set_array(scale * run.time[::every][:-1])
    axes.add_collection(lines)
    axes.autoscale_view()
    bar = axes.figure.colorbar(lines, ax=axes, pad=0.02, aspect=28, ticks=MaxNLocator(6, integer=True))  # type: ignore[union-attr]
    bar.set_label(f"time [{unit}]")
    bar.outline.set_visible(False)  # type: ignore[operator]


def _clock(run: Run) -> tuple[str, float]:
    """Unit of time for short labels, and the factor from seconds to it."""
    return ("ms", 1e3) if timeline.end_of(run) < 1.0 else ("s", 1.0)


def _close_up(axes: Axes, run: Run, channels: Channels, modes: Integers) -> None:
    """Draw some periods from the part of the run with the strongest vibration."""
    watched = channels.portrait[1] if channels.portrait else next(iter(channels.colours), "")
    begin, end = _liveliest(run, watched, modes)
    unit, scale = _clock(run)
    axes.set_xlabel(f"time [{unit}]")
    if watched:
        axes.set_ylabel(f"{plain(watched)} [{run.units.get(watched, '')}]")
    inside = (run.time >= begin) & (run.time <= end)
    axes.set_title("close-up")
    if modes.size:
        stuck = (modes[inside] == 0).astype(np.int8)
        if stuck.any():
            axes.set_title("close-up; shaded: stick")
        edges = np.flatnonzero(np.diff(np.concatenate(([0], stuck, [0]))))
        t = np.append(run.time[inside], end)
        for low, high in edges.reshape(-1, 2):
            axes.axvspan(scale * t[low], scale * t[high], color=contact.COLOURS[0], alpha=0.16, lw=0)
    if panel := channels.panel_of(watched):
        fast = _beyond(run, channels, panel)
        drives = [name for name in panel.outputs if name in channels.drives and name not in fast]
        for name in dict.fromkeys((*drives, watched)):
            axes.plot(scale * run.time[inside], run.signals[name][inside], color=channels.colours[name], lw=1.4)
    axes.set_xlim(scale * begin, scale * end)
    axes.locator_params(axis="x", nbins=4)


def _liveliest(run: Run, output: str, modes: Integers) -> tuple[float, float]:
    """Begin and end [s] of four periods, or a tenth of the run, in which an output varies most."""
    v, end = run.signals.get(output, np.empty(0)), timeline.end_of(run)
    if v.size < 20:
        return 0.0, end or 1.0
    width = end / 10
    landings = run.time[1:][np.diff((modes == 0).astype(np.int8)) > 0] if modes.size else np.empty(0)
    if landings.size > 4:
        gaps = np.diff(landings)
        width = float(np.clip(4.0 * _typical(gaps), end / 200, end / 2))
    size = max(int(width / end * v.size), 2)
    starts = np.arange(0, v.size - size + 1, max(size // 4, 1))
    swings = np.array([_swing(v[s : s + size]) for s in starts])
    best = float(run.time[starts[int(np.argmax(swings >= 0.98 * swings.max()))]])
    return best, min(best + width, end)


def _swing(v: Reals) -> float:
    """Standard deviation of the samples that are not lost; 0 if all are."""
    known = v[np.isfinite(v)]
    return float(known.std()) if known.size else 0.0


def _typical(gaps: Reals) -> float:
    """A typical gap: weighted by time, so that many short gaps (chatter) or one long pause have little influence."""
    ordered = np.sort(gaps)
    return float(ordered[np.searchsorted(np.cumsum(ordered), 0.4 * ordered.sum())])
