"""The figure of a run: PNG, 1600 pixels wide.

phases and marks of the protocol                        phase portrait, by controller or by time
velocity of the body and of the surface
friction and normal force                               close-up of some periods
voltage of the stack, if there is one
contact mode                                            what the run was, and how it went

The plate rig has another figure: rig.view.plate_figure.
"""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from rig.record.run import Integers, Reals, Run
from rig.view import contact, plate_figure, timeline
from rig.view.caption import caption
from rig.view.curves import (
    BODY,
    COLUMNS,
    FRICTION,
    NORMAL,
    SURFACE,
    VOLTAGE,
    curves,
    heading,
    legend,
    name_circuits,
    phases,
    shade,
)
from rig.view.save_figure import put

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

_STACK = "stack_voltage"
_FASTER = 5.0
_SMALL = 5e-5  # m: smaller displacements are shown in micrometres
_SECTIONS = ("#1d4f91", "#c03a76", "#2a9d77", "#d1802f", "#7a5fb0")
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
    """Draw `run` into the file `path` (PNG, or another format of matplotlib by its ending). Creates the folder.

    Raises OutputError if the file cannot be written.
    """
    import matplotlib as mpl
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    path = Path(path)
    path.parent.mkdir(parents=True, exist_ok=True)
    with mpl.rc_context(STYLE):  # type: ignore[arg-type]
        figure = Figure(figsize=(12.8, 8.4), dpi=125, facecolor="white")
        FigureCanvasAgg(figure)
        (plate_figure.compose if "plate_acceleration" in run.signals else _compose)(figure, run)
        put(figure, path)


def _compose(figure: Figure, run: Run) -> None:
    heights = (0.30, 1.6, 1.6, 1.2, 0.26) if _STACK in run.signals else (0.30, 2.2, 2.2, 0.26)
    grid = figure.add_gridspec(
        len(heights), 2, width_ratios=(2.35, 1), height_ratios=heights, hspace=0.13, wspace=0.21,
        left=0.076, right=0.985, top=0.94, bottom=0.072,
    )  # fmt: skip
    right = grid[:, 1].subgridspec(3, 1, height_ratios=(2.3, 1.5, 0.85), hspace=0.42)
    times = figure.add_subplot(grid[1, 0])
    system = contact.system_of(run.scene)
    modes = contact.Modes(system).indices(run.mode)
    phases(figure.add_subplot(grid[0, 0], sharex=times), run)
    velocity(times, run)
    panels = [times, *(figure.add_subplot(grid[row, 0], sharex=times) for row in range(2, len(heights) - 1))]
    _forces(panels[1], run)
    if len(panels) > 2:
        curves(panels[2], run, ((_STACK, VOLTAGE),))
        panels[2].set_ylabel(f"voltage [{run.units.get(_STACK, '')}]")
    strip = figure.add_subplot(grid[-1, 0], sharex=times)
    _strip(strip, run, modes)
    closed = timeline.circuits(run, system)
    for axes in panels:
        axes.tick_params(labelbottom=False)
        shade(axes, run, closed)
    name_circuits(panels[-1], closed)
    _portrait(figure.add_subplot(right[0]), run)
    _close_up(figure.add_subplot(right[1]), run, modes)
    caption(figure.add_subplot(right[2]), run, modes)
    figure.align_ylabels(panels)
    heading(figure, run)


def velocity(axes: Axes, run: Run) -> None:
    """Draw the velocity of the body over time, and that of the surface unless it is much larger."""
    fast = _beyond(run)
    curves(axes, run, (("surface_speed", SURFACE), ("velocity", BODY))[fast:])
    if fast:
        speed = f"surface speed: {_largest(run, 'surface_speed'):.3g} {run.units.get('surface_speed', '')}"
        axes.text(0.995, 0.97, speed, transform=axes.transAxes, ha="right", va="top", fontsize=9.5, color=SURFACE)
    axes.set_ylabel(f"velocity [{run.units.get('velocity', '')}]")
    axes.set_xlim(0.0, timeline.end_of(run) or 1.0)


def _largest(run: Run, output: str) -> float:
    v = run.signals.get(output, np.empty(0))
    return float(np.nanmax(np.abs(v), initial=0.0)) if v.size else 0.0


def _beyond(run: Run) -> bool:
    """Whether the surface is so much faster than the body that the body's curve would look flat."""
    return _largest(run, "surface_speed") > _FASTER * _largest(run, "velocity") > 0.0


def _forces(axes: Axes, run: Run) -> None:
    curves(axes, run, (("normal_force", NORMAL), ("friction_force", FRICTION)))
    axes.set_ylabel(f"force [{run.units.get('friction_force', '')}]")


def _strip(axes: Axes, run: Run, modes: Integers) -> None:
    """Draw the contact mode over time; where modes alternate within a pixel, their colours mix by their shares."""
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


def _portrait(axes: Axes, run: Run) -> None:
    """Draw velocity over displacement."""
    x, v = (run.signals.get(name, np.empty(0)) for name in ("displacement", "velocity"))
    axes.set_title("phase portrait")
    small = _largest(run, "displacement") < _SMALL
    factor, unit = (1e6, "um") if small else (1e3, "mm")
    axes.set_xlabel(f"displacement [{unit if run.units.get('displacement') == 'm' else ''}]")
    axes.set_ylabel(f"velocity [{run.units.get('velocity', '')}]")
    if not x.size or not v.size:
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


def _close_up(axes: Axes, run: Run, modes: Integers) -> None:
    """Draw some periods from the part of the run with the strongest vibration."""
    begin, end = _liveliest(run, modes)
    unit, scale = _clock(run)
    axes.set_title("close-up: velocity, and where it sticks")
    axes.set_xlabel(f"time [{unit}]")
    axes.set_ylabel(f"velocity [{run.units.get('velocity', '')}]")
    inside = (run.time >= begin) & (run.time <= end)
    if modes.size:
        stuck = (modes[inside] == 0).astype(np.int8)
        edges = np.flatnonzero(np.diff(np.concatenate(([0], stuck, [0]))))
        t = np.append(run.time[inside], end)
        for low, high in edges.reshape(-1, 2):
            axes.axvspan(scale * t[low], scale * t[high], color=contact.COLOURS[0], alpha=0.16, lw=0)
    for name, colour in (("surface_speed", SURFACE), ("velocity", BODY))[_beyond(run) :]:
        if name in run.signals:
            axes.plot(scale * run.time[inside], run.signals[name][inside], color=colour, lw=1.4)
    axes.set_xlim(scale * begin, scale * end)
    axes.locator_params(axis="x", nbins=4)


def _liveliest(run: Run, modes: Integers) -> tuple[float, float]:
    """Begin and end [s] of four periods, or a tenth of the run, in which the velocity varies most."""
    v, end = run.signals.get("velocity", np.empty(0)), timeline.end_of(run)
    if v.size < 20:
        return 0.0, end or 1.0
    width = end / 10
    landings = run.time[1:][np.diff((modes == 0).astype(np.int8)) > 0] if modes.size else np.empty(0)
    if landings.size > 4:
        gaps = np.diff(landings)
        width = float(np.clip(4.0 * _typical(gaps), end / 200, end / 2))
    size = max(int(width / end * v.size), 2)
    starts = np.arange(0, v.size - size + 1, max(size // 4, 1))
    swings = np.array([np.nanstd(v[s : s + size]) for s in starts])
    best = float(run.time[starts[int(np.argmax(swings >= 0.98 * swings.max()))]])
    return best, min(best + width, end)


def _typical(gaps: Reals) -> float:
    """A typical gap: weighted by time, so that many short gaps (chatter) or one long pause have little influence."""
    ordered = np.sort(gaps)
    return float(ordered[np.searchsorted(np.cumsum(ordered), 0.4 * ordered.sum())])
