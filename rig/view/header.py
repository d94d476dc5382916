"""What surrounds the curves in all figures of runs: title, steps of the protocol and marks above them, the caption."""

from __future__ import annotations

import textwrap
from collections.abc import Iterable, Iterator
from typing import TYPE_CHECKING, Any, NamedTuple

from rig.printable import counted
from rig.record.run import Integers, Run
from rig.view.curves import FAINT, NOTE, Span, begin_of, controlled, described, end_of, marks_of, phases
from rig.view.palette import ALARM, GREEN

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

_INK = "#111111"
_CIRCUIT = "#7a5fb0"
# edges of the plots of a figure, as shares of its width and height
LEFT = 0.076
RIGHT = 0.985
TOP = 0.95
BOTTOM = 0.072
_STEP = 8.5
"""Size of the letters of a step of the protocol [pt]."""
_ROW = 1.45
"""Height of a row of marks in heights of its letters."""
_ROWS = 7
"""Most rows of marks."""


class _Label(NamedTuple):
    """A text above the curves: time [s] of what it names, left and right edge [px], row, text, colour.

    `rises`: whether a line rises to it.
    """

    time: float
    left: float
    right: float
    row: int
    text: str
    colour: str
    rises: bool


class Header:
    """What is written above the curves: the steps of the protocol as a band, marks in as many rows as they need.

    `beside`: spans with texts that are written with the marks. `width`: of the curves [px]. No text is cut: one that
    does not fit into its span is among the marks, and those for which there are no rows are counted.
    """

    def __init__(self, figure: Figure, run: Run, width: float, beside: Iterable[Span] = ()) -> None:
        from matplotlib.font_manager import FontProperties

        self._begin = begin_of(run)
        self._end = end_of(run) or 1.0
        self._width = width
        self._scale = width / (self._end - self._begin or 1.0)
        renderer: Any = figure.canvas.get_renderer()  # type: ignore[attr-defined]
        self._row = figure.dpi / 72.0 * NOTE * _ROW

        def long(text: str, size: float) -> float:
            return float(renderer.get_text_width_height_descent(text, FontProperties(size=size), False)[0])

        self._bands = [span for span in phases(run) if span.end > self._begin]
        self._inside: dict[int, str] = {}
        loose = [(mark.time, mark.text, _INK, True) for mark in marks_of(run)]
        for i, (begin, end, text) in enumerate(self._bands):
            room = self._scale * (end - max(begin, self._begin)) - 6.0
            fitting = (short for short in _shortened(text) if long(short, _STEP) <= room)
            inside = next(fitting, "")
            if inside:
                self._inside[i] = inside
            else:
                loose.append((begin, text, FAINT, False))
        first = {text: begin for begin, _, text in reversed(list(beside))}
        loose += [(begin, text, _CIRCUIT, False) for text, begin in first.items()]
        self._labels: list[_Label] = []
        self._left_out = 0
        for time, text, colour, rises in sorted(loose):
            if self._begin <= time <= self._end:
                self._place(time, text, colour, rises, long)
        self._rows = 1 + max((label.row for label in self._labels), default=-1) + (self._left_out > 0)

    def _place(self, time: float, text: str, colour: str, rises: bool, long: Any) -> None:
        per_letter = max(long(text, NOTE) / len(text), 1.0)
        lines = textwrap.wrap(text, max(int(0.95 * self._width / per_letter), 8))[::-1]
        size = max(long(text_line, NOTE) for text_line in lines) + 4.0
        at = self._scale * (time - self._begin)
        left = at + 4.0
        if left + size > self._width:
            left = max(min(at - 4.0, self._width) - size, 0.0)
        right = left + size
        taken = {label.row for label in self._labels if label.left < right + 12.0 and left < label.right + 12.0}
        rows = range(_ROWS + 1 - len(lines))
        row = next((row for row in rows if taken.isdisjoint(range(row, row + len(lines)))), None)
        if row is None:
            self._left_out += 1
            return
        for i, text_line in enumerate(lines):
            self._labels.append(_Label(time, left, right, row + i, text_line, colour, rises and i == 0))

    @property
    def height(self) -> float:
        """Height [px]."""
        return self._row * (self._rows + 1.2)

    def draw(self, axes: Axes) -> None:
        """Draw everything into axes of this width and height, which have the times of the curves."""
        axes.set_ylim(0.0, self._rows + 1.2)
        axes.grid(False)
        axes.set_axis_off()
        for i, (begin, end, _) in enumerate(self._bands):
            begin = max(begin, self._begin)
            end = min(end, self._end)
            colour = "#e9edf3" if i % 2 else "#d9e0ea"
            axes.fill_between((begin, end), 0.05, 0.95, color=colour, lw=0, label="_step")
            text = self._inside.get(i, "")
            middle = (begin + end) / 2
            axes.text(middle, 0.48, text, ha="center", va="center", fontsize=_STEP, color=_INK, zorder=4)
        white = {"facecolor": "white", "edgecolor": "none", "pad": 0.6}
        for time, left, _, row, text, colour, rises in self._labels:
            top = row + 1.65
            if rises:
                axes.plot([time, time], [0.0, top + 0.3], color="#777777", lw=0.8, ls=(0, (4, 3)), clip_on=False)
            at = self._begin + left / self._scale
            axes.text(at, top, text, va="center", fontsize=NOTE, color=colour, bbox=white, zorder=4)
        if self._left_out:
            text = f"and {self._left_out} more: see the events of the run"
            axes.text(self._end, self._rows + 0.65, text, ha="right", va="center", fontsize=NOTE, color=FAINT)


def stacked(
    figure: Figure, run: Run, header: Header, count: int, box: tuple[float, float, float]
) -> tuple[list[Axes], float]:
    """Axes for `count` plots over time, one below the other, under the header; and their upper edge.

    `box`: left and right edge, lower edge, as shares of the figure.
    """
    left, right, bottom = box
    height = figure.bbox.height
    top = TOP - header.height / height
    gap = 23.0 / height
    each = (top - bottom - gap * (count - 1)) / count
    grid = figure.add_gridspec(count, 1, left=left, right=right, top=top, bottom=bottom, hspace=gap / each)
    times = figure.add_subplot(grid[0])
    times.set_xlim(begin_of(run), end_of(run) or 1.0)
    drawn = [times, *(figure.add_subplot(grid[row], sharex=times) for row in range(1, count))]
    place = (left, top + 6.0 / height, right - left, header.height / height)
    header.draw(figure.add_axes(place, sharex=times))
    return drawn, top


def shade(axes: Axes, run: Run, closed: list[Span]) -> None:
    """Shade the times in which controllers work or a circuit is closed, and draw lines at marks."""
    for span in controlled(run):
        axes.axvspan(span.begin, span.end, color=GREEN, alpha=0.09, lw=0, zorder=0)
    for span in closed:
        axes.axvspan(span.begin, span.end, color=_CIRCUIT, alpha=0.13, lw=0, zorder=0)
    for mark in marks_of(run):
        axes.axvline(mark.time, color="#777777", lw=0.8, ls=(0, (4, 3)), zorder=1)


def heading(figure: Figure, run: Run, left: float) -> None:
    """Write the title of the run's scene and, if the run stopped early, the reason; `left`: share of the width."""
    about = described(run.scene)
    title = about.get("title") or about.get("name") or run.name or "run"
    figure.text(left, 0.968, title, fontsize=13, fontweight="bold")
    if run.fault:
        reason = run.fault.partition("\n")[0][:110]
        figure.text(0.985, 0.968, reason, color=ALARM, ha="right", fontsize=10.5)


def caption(axes: Axes, run: Run, modes: Integers) -> None:
    """Write the caption of `run`; the stick share comes from `modes`, the contact states [contact, row]."""
    axes.set_axis_off()
    rows = [("scene", described(run.scene).get("name", "")), *_rows(run, modes)]
    for i, (name, text) in enumerate(rows):
        y = 1.0 - i / 6.2
        axes.text(-0.04, y, name, transform=axes.transAxes, ha="right", va="top", fontsize=9.5, color="#777777")
        axes.text(0.0, y, text, transform=axes.transAxes, va="top", fontsize=9.5, color="#111111")


def _rows(run: Run, modes: Integers) -> list[tuple[str, str]]:
    """Rows (name, text) of the caption."""
    summary = run.summary
    plant = summary.get("plant", {}) if isinstance(summary.get("plant"), dict) else {}
    steps = f"{run.step_ns / 1e6:g} ms"
    method = plant.get("method", "unknown")
    events = counted(plant.get("events", 0), "event")
    rows = [("integration", f"{method}, {steps} samples, {events}")]
    if modes.size:
        stuck = (modes == 0).mean()
        mean = f", mean of {len(modes)} contacts" if len(modes) > 1 else ""
        rows.append(("stick share", f"{stuck:.1%} of {end_of(run):g} s{mean}"))
    if run.energy:
        supplied = run.energy.get("drive", run.energy.get("supplied", 0.0))
        residual = abs(run.energy.get("error", 0.0))
        rows.append(("energy", f"{supplied:.4g} J from the drive, residual {residual:.0e}"))
    timing = summary.get("timing", {})
    if "verdict" in summary:
        worst = f", worst frame {timing['worst_us'] / 1e3:.3g} ms late" if timing else ""
        rows.append(("timing", f"{summary['verdict']}{worst}"))
    else:
        rows.append(("timing", "simulated without a clock"))
    provenance = [f"{key} {run.provenance[key][:12]}" for key in ("commit", "version") if run.provenance.get(key)]
    if provenance:
        rows.append(("made with", ", ".join(provenance)))
    return rows


def _shortened(text: str) -> Iterator[str]:
    """A text of the protocol and its shorter forms: "drive.speed to 2 m/s", "to 2 m/s", "2 m/s"."""
    for short in (text, "to" + text.partition(" to")[2], text.rpartition(" to ")[2]):
        if short not in ("", "to"):
            yield short
