"""A run as one picture for a researcher: PNG, 1600 pixels wide.

phases and marks of the protocol                        phase portrait, by controller or by time
velocity of the body and of the surface
friction and normal force                               close-up of some periods
voltage of the stack, if there is one
contact mode                                            what the run was, and how well it went
"""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from rig.record.run import Integers, Reals, Run
from rig.view import contact, story
from rig.view.caption import caption, scene_of
from rig.view.channels import channels
from rig.view.put import put

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

_COLUMNS = 2400
_BODY, _SURFACE, _FRICTION, _NORMAL = "#1d4f91", "#d1802f", "#b5322f", "#5a5a5a"
_VOLTAGE = "#7a5fb0"
_STACK = "stack_voltage"
_MEASURED = 0.35
_FASTER = 5.0
_SMALL = 5e-5  # m: below it a portrait is told in micrometres
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
    """Draw `run` into the file `path` (PNG; other endings as matplotlib knows them). Directories are made."""
    import matplotlib as mpl
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    path = Path(path)
    path.parent.mkdir(parents=True, exist_ok=True)
    with mpl.rc_context(STYLE):  # type: ignore[arg-type]
        figure = Figure(figsize=(12.8, 8.4), dpi=125, facecolor="white")
        FigureCanvasAgg(figure)
        _compose(figure, run)
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
    _phases(figure.add_subplot(grid[0, 0], sharex=times), run)
    _velocity(times, run)
    curves = [times, *(figure.add_subplot(grid[row, 0], sharex=times) for row in range(2, len(heights) - 1))]
    _forces(curves[1], run)
    if len(curves) > 2:
        _curves(curves[2], run, ((_STACK, _VOLTAGE),))
        curves[2].set_ylabel(f"voltage [{run.units.get(_STACK, '')}]")
    strip = figure.add_subplot(grid[-1, 0], sharex=times)
    _strip(strip, run, modes)
    closed = story.circuits(run, system)
    for axes in curves:
        axes.tick_params(labelbottom=False)
        _shade(axes, run, closed)
    _name(curves[-1], closed)
    _portrait(figure.add_subplot(right[0]), run)
    _close_up(figure.add_subplot(right[1]), run, modes)
    caption(figure.add_subplot(right[2]), run, modes)
    figure.align_ylabels(curves)
    about = scene_of(run)
    figure.text(0.076, 0.968, about.get("title") or about.get("name") or "run", fontsize=15, fontweight="bold")
    if run.fault:
        first = run.fault.partition("\n")[0]
        figure.text(0.985, 0.968, first[:110], color="#b5322f", ha="right", fontsize=10.5)


def thinned(t: Reals, v: Reals, columns: int = _COLUMNS) -> tuple[Reals, Reals]:
    """A line that looks like (t, v) when it is drawn over `columns` columns: lowest and highest of each."""
    if t.size <= 4 * columns:
        return t, v
    size = -(-t.size // columns)
    count = t.size // size
    table = v[: count * size].reshape(count, size)
    filled = np.where(np.isnan(table), np.inf, table).min(axis=1), np.where(np.isnan(table), -np.inf, table).max(axis=1)
    ends = np.stack(filled, axis=1)
    ends[~np.isfinite(ends)] = np.nan
    return np.repeat(t[: count * size : size], 2), ends.ravel()


def _line(axes: Axes, t: Reals, v: Reals, **style: Any) -> None:
    axes.plot(*thinned(t, v), **style)


def _measured(run: Run, reads: str) -> list[tuple[str, Reals, Reals]]:
    """Sensors of an output: name, times, values in its unit."""
    sensors = {name: run.units.get(f"meas/{name}", "") for name in run.measurements}
    placed = channels(run.scene_text(), {name: run.units.get(name, "") for name in run.signals}, sensors)
    return [
        (
            name,
            np.multiply(run.measurements[name].t_ns, 1e-9, dtype=np.float64),
            run.measurements[name].v * channel.factor,
        )
        for name, channel in placed.items()
        if channel.reads == reads
    ]


def _label(name: str) -> str:
    return name.replace("_", " ")


def _legend(axes: Axes, columns: int) -> None:
    """Above the curves, where none can hide behind it."""
    low, high = axes.get_ylim()
    axes.set_ylim(low, high + 0.16 * (high - low))
    legend = axes.legend(loc="upper left", ncols=columns, borderaxespad=0.2, handlelength=1.6, columnspacing=1.4)
    for handle in legend.get_lines():
        handle.set_linewidth(2.2)


def _curves(axes: Axes, run: Run, outputs: tuple[tuple[str, str], ...]) -> None:
    count = 0
    for output, colour in outputs:
        if output not in run.signals:
            continue
        for name, t, v in _measured(run, output):
            label = f"{_label(name)} (measured)"
            _line(axes, t, v, color=colour, alpha=_MEASURED, lw=2.6, label=label, zorder=2)
            count += 1
        _line(axes, run.time, run.signals[output], color=colour, label=_label(output), zorder=3)
        count += 1
    if count:
        _legend(axes, min(count, 4))


def _velocity(axes: Axes, run: Run) -> None:
    fast = _beyond(run)
    _curves(axes, run, (("surface_speed", _SURFACE), ("velocity", _BODY))[fast:])
    if fast:
        speed = f"surface speed: {_largest(run, 'surface_speed'):.3g} {run.units.get('surface_speed', '')}"
        axes.text(0.995, 0.97, speed, transform=axes.transAxes, ha="right", va="top", fontsize=9.5, color=_SURFACE)
    axes.set_ylabel(f"velocity [{run.units.get('velocity', '')}]")
    axes.set_xlim(0.0, story.end_of(run) or 1.0)


def _largest(run: Run, output: str) -> float:
    v = run.signals.get(output, np.empty(0))
    return float(np.nanmax(np.abs(v), initial=0.0)) if v.size else 0.0


def _beyond(run: Run) -> bool:
    """Whether the surface is so much faster than the body that its line would flatten the other."""
    return _largest(run, "surface_speed") > _FASTER * _largest(run, "velocity") > 0.0


def _forces(axes: Axes, run: Run) -> None:
    _curves(axes, run, (("normal_force", _NORMAL), ("friction_force", _FRICTION)))
    axes.set_ylabel(f"force [{run.units.get('friction_force', '')}]")


def _shade(axes: Axes, run: Run, closed: list[story.Span]) -> None:
    """Where controllers work, where a circuit is closed, and where something was marked."""
    for span in story.controlled(run):
        axes.axvspan(span.begin, span.end, color="#2a9d77", alpha=0.09, lw=0, zorder=0)
    for span in closed:
        axes.axvspan(span.begin, span.end, color=_VOLTAGE, alpha=0.13, lw=0, zorder=0)
    for mark in story.marks(run):
        axes.axvline(mark.time, color="#777777", lw=0.8, ls=(0, (4, 3)), zorder=1)


def _name(axes: Axes, closed: list[story.Span]) -> None:
    """What the closed circuits are, at the foot of the curves, where there is room."""
    whole = axes.get_xlim()[1]
    for span in closed:
        if text := _fitting(span.text, 140.0 / whole * (span.end - span.begin) - 1):
            axes.text((span.begin + span.end) / 2, 0.04, text, transform=axes.get_xaxis_transform(), ha="center",
                      fontsize=8.5, color=_VOLTAGE)  # fmt: skip


def _fitting(text: str, width: float) -> str:
    """`text` cut to `width` in characters; empty if little would be left."""
    if len(text) <= width:
        return text
    return text[: int(width) - 1].rstrip() + "…" if width >= 6 else ""


def _phases(axes: Axes, run: Run) -> None:
    """Two lines of words above the curves: marks, and the steps of the protocol as a band."""
    end = story.end_of(run) or 1.0
    letters = 140.0 / end  # characters that fit into a second
    axes.set_ylim(0.0, 2.0)
    axes.grid(False)
    axes.set_axis_off()
    for i, span in enumerate(story.phases(run)):
        axes.axvspan(span.begin, span.end, 0.02, 0.46, color="#e9edf3" if i % 2 else "#d9e0ea", lw=0)
        room = letters * (span.end - span.begin) - 1
        shorter = (span.text, "to" + span.text.partition(" to")[2])
        text = next((t for t in shorter if len(t) <= room and t != "to"), _fitting(span.text, room))
        axes.text((span.begin + span.end) / 2, 0.48, text, ha="center", va="center", fontsize=8.5, color="#333333")
    marks = story.marks(run)
    for mark, after in zip(marks, [m.time for m in marks[1:]] + [end]):
        axes.plot([mark.time, mark.time], [0.0, 1.9], color="#777777", lw=0.8, ls=(0, (4, 3)), clip_on=False)
        room = letters * (max(after - mark.time, end * 0.12 if after == end else 0.0)) - 1
        axes.text(mark.time + 0.004 * end, 1.45, _fitting(mark.text, room), va="center", fontsize=9.5, color="#111111")


def _strip(axes: Axes, run: Run, modes: Integers) -> None:
    """Contact mode over time; where modes alternate faster than a pixel the colours mix by their shares."""
    axes.set_yticks([])
    axes.grid(False)
    axes.set_xlabel("time [s]")
    axes.set_ylabel("contact", rotation=0, ha="right", va="center")
    if not modes.size:
        axes.text(0.5, 0.5, "not recorded", transform=axes.transAxes, ha="center", va="center", color="#777777")
        return
    palette = np.array([contact.rgb(colour) for colour in contact.COLOURS]) / 255.0
    columns = min(_COLUMNS, modes.size)
    starts = np.arange(columns) * modes.size // columns
    counts = np.diff([*starts, modes.size])
    mixed = np.add.reduceat(palette[modes], starts, axis=0) / counts[:, None]
    axes.imshow(mixed[None], aspect="auto", extent=(0.0, story.end_of(run), 0.0, 1.0), interpolation="nearest")
    from matplotlib.patches import Patch

    seen = [Patch(color=contact.COLOURS[i], label=contact.NAMES[i]) for i in np.unique(modes)]
    axes.legend(handles=seen, loc="upper right", bbox_to_anchor=(1.0, -0.62), ncols=len(seen), handlelength=1.1)


def _portrait(axes: Axes, run: Run) -> None:
    """Velocity over displacement."""
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
    sections = story.sections(run)
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
        _legend(axes, len(names))
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
    """The unit of time where there is little room for digits, and what seconds are multiplied by."""
    return ("ms", 1e3) if story.end_of(run) < 1.0 else ("s", 1.0)


def _close_up(axes: Axes, run: Run, modes: Integers) -> None:
    """Some periods of the liveliest part."""
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
    for name, colour in (("surface_speed", _SURFACE), ("velocity", _BODY))[_beyond(run) :]:
        if name in run.signals:
            axes.plot(scale * run.time[inside], run.signals[name][inside], color=colour, lw=1.4)
    axes.set_xlim(scale * begin, scale * end)
    axes.locator_params(axis="x", nbins=4)


def _liveliest(run: Run, modes: Integers) -> tuple[float, float]:
    """A window of four periods, or a tenth of the run, in which the velocity swings most."""
    v, end = run.signals.get("velocity", np.empty(0)), story.end_of(run)
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
    """The gap in which the run spent much of its time: neither chatter nor one long pause counts for much."""
    ordered = np.sort(gaps)
    return float(ordered[np.searchsorted(np.cumsum(ordered), 0.4 * ordered.sum())])
