"""Curves of a run over time and the text above them, common to all figures of runs."""

from __future__ import annotations

from collections.abc import Iterable
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from rig.record.run import Reals, Run
from rig.view import contact, timeline
from rig.view.caption import scene_of
from rig.view.channels import Channels
from rig.view.palette import ALARM, GREEN

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

_CIRCUIT = "#7a5fb0"
COLUMNS = 2400
Bools = NDArray[np.bool_]
_MEASURED = 0.35
_LETTERS = 125.0
"""Number of characters that fit above the time axis of a whole run."""


def thinned(t: Reals, v: Reals, columns: int = COLUMNS) -> tuple[Reals, Reals]:
    """Reduce a line to the lowest and highest value in each of `columns` columns; drawn, it looks the same."""
    if t.size <= 4 * columns:
        return t, v
    size = -(-t.size // columns)
    count = t.size // size
    table = v[: count * size].reshape(count, size)
    filled = np.where(np.isnan(table), np.inf, table).min(axis=1), np.where(np.isnan(table), -np.inf, table).max(axis=1)
    ends = np.stack(filled, axis=1)
    ends[~np.isfinite(ends)] = np.nan
    return np.repeat(t[: count * size : size], 2), ends.ravel()


def apart(x: Reals, y: Reals, jumps: Bools) -> tuple[Reals, Reals]:
    """Return x [n] and y [n, ...] with a gap after each point i where `jumps[i]` [n - 1], which no line joins."""
    at = np.flatnonzero(jumps) + 1
    return np.insert(x, at, np.nan), np.insert(y, at, np.nan, axis=0)


def line(axes: Axes, t: Reals, v: Reals, **style: Any) -> None:
    """Draw a line, reduced to what is visible."""
    axes.plot(*thinned(t, v), **style)


def channels_of(run: Run) -> Channels:
    """Plots and colours of the outputs and sensors of a run."""
    sensors = {name: run.units.get(f"meas/{name}", "") for name in run.measurements}
    return Channels(contact.read(run.scene), {name: run.units.get(name, "") for name in run.signals}, sensors)


def measured(run: Run, channels: Channels, reads: str) -> list[tuple[str, Reals, Reals]]:
    """Sensors that read an output: name, times [s], values in the unit of the output."""
    return [
        (
            name,
            np.multiply(run.measurements[name].t_ns, 1e-9, dtype=np.float64),
            run.measurements[name].v * channel.factor,
        )
        for name, channel in channels.measured.items()
        if channel.reads == reads
    ]


def plain(name: str) -> str:
    """A name with spaces instead of underscores."""
    return name.replace("_", " ")


def legend(axes: Axes, columns: int) -> None:
    """Draw the legend above the curves, in space that is added there."""
    low, high = axes.get_ylim()
    rows = -(-len(axes.get_legend_handles_labels()[1]) // columns)
    axes.set_ylim(low, high + (0.05 + 0.11 * rows) * (high - low))
    drawn = axes.legend(loc="upper left", ncols=columns, borderaxespad=0.2, handlelength=1.6, columnspacing=1.4)
    for handle in drawn.get_lines():
        handle.set_linewidth(2.2)


def curves(axes: Axes, run: Run, channels: Channels, outputs: Iterable[str]) -> None:
    """Draw outputs of the run, the first one on top, their measurements, and a legend."""
    count = 0
    for output in outputs:
        if output not in run.signals:
            continue
        colour = channels.colours[output]
        for name, t, v in measured(run, channels, output):
            label = f"{plain(name)} (measured)"
            line(axes, t, v, color=colour, alpha=_MEASURED, lw=2.6, label=label, zorder=2)
            count += 1
        line(axes, run.time, run.signals[output], color=colour, label=plain(output), zorder=3.0 - 0.01 * count)
        count += 1
    if count:
        legend(axes, min(count, 4))


def shade(axes: Axes, run: Run, closed: list[timeline.Span]) -> None:
    """Shade the times in which controllers work or a circuit is closed, and draw lines at marks."""
    for span in timeline.controlled(run):
        axes.axvspan(span.begin, span.end, color=GREEN, alpha=0.09, lw=0, zorder=0)
    for span in closed:
        axes.axvspan(span.begin, span.end, color=_CIRCUIT, alpha=0.13, lw=0, zorder=0)
    for mark in timeline.marks(run):
        axes.axvline(mark.time, color="#777777", lw=0.8, ls=(0, (4, 3)), zorder=1)


def name_circuits(axes: Axes, closed: list[timeline.Span]) -> None:
    """Write the names of the closed circuits at the lower end of the curves, if there is space."""
    whole = axes.get_xlim()[1]
    for span in closed:
        if text := _fitting(span.text, _LETTERS / whole * (span.end - span.begin) - 1):
            axes.text((span.begin + span.end) / 2, 0.04, text, transform=axes.get_xaxis_transform(), ha="center",
                      fontsize=8.5, color=_CIRCUIT)  # fmt: skip


def _fitting(text: str, width: float) -> str:
    """`text` cut to `width` characters; empty if `width` is less than 6."""
    if len(text) <= width:
        return text
    return text[: int(width) - 1].rstrip() + "…" if width >= 6 else ""


def heading(figure: Figure, run: Run) -> None:
    """Write the title of the run's scene and, if the run stopped early, the reason."""
    about = scene_of(run)
    figure.text(0.076, 0.968, about.get("title") or about.get("name") or "run", fontsize=15, fontweight="bold")
    if run.fault:
        first = run.fault.partition("\n")[0]
        figure.text(0.985, 0.968, first[:110], color=ALARM, ha="right", fontsize=10.5)


def phases(axes: Axes, run: Run) -> None:
    """Draw two lines of text above the curves: marks, and the steps of the protocol as a band."""
    end = timeline.end_of(run) or 1.0
    letters = _LETTERS / end  # characters that fit into one second
    axes.set_ylim(0.0, 2.0)
    axes.grid(False)
    axes.set_axis_off()
    for i, span in enumerate(timeline.phases(run)):
        axes.axvspan(span.begin, span.end, 0.02, 0.46, color="#e9edf3" if i % 2 else "#d9e0ea", lw=0)
        room = letters * (span.end - span.begin) - 1
        shorter = (span.text, "to" + span.text.partition(" to")[2], span.text.rpartition(" to ")[2])
        text = next((t for t in shorter if len(t) <= room and t != "to"), _fitting(span.text, room))
        axes.text(
            (span.begin + span.end) / 2,
            0.48,
            text,
            ha="center",
            va="center",
            fontsize=8.5,
            color="#333333",
            clip_on=True,
        )
    marks, taken = timeline.marks(run), 0.0
    letters *= 0.75  # larger ones, and no mark is cut off at the edge
    for mark, after in zip(marks, [m.time for m in marks[1:]] + [end]):
        axes.plot([mark.time, mark.time], [0.0, 1.9], color="#777777", lw=0.8, ls=(0, (4, 3)), clip_on=False)
        room, before = letters * (after - mark.time) - 1, letters * (mark.time - taken) - 1
        left = mark is marks[-1] and room < min(len(mark.text), before)  # near the end of the run
        text = _fitting(mark.text, before if left else room)
        taken = mark.time + (0.0 if left else (len(text) + 1) / letters)
        axes.text(
            mark.time + (-0.004 if left else 0.004) * end,
            1.45,
            text,
            ha="right" if left else "left",
            va="center",
            fontsize=9.5,
            color="#111111",
            clip_on=True,
        )
