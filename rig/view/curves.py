"""Curves of a run over time, the text above them, and the caption, common to all figures of runs.

The course of a run consists of time spans: phases of the protocol, marks, and when each controller worked.
"""

from __future__ import annotations

import json
import math
import re
import textwrap
from collections.abc import Iterable, Mapping
from enum import Enum
from itertools import pairwise
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from rig.model.system import System
from rig.printable import counted
from rig.record.run import Integers, Reals, Run
from rig.view import contact
from rig.view.channels import Channels
from rig.view.palette import ALARM, GREEN, LINES

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.axis import Axis
    from matplotlib.figure import Figure


def described(scene: str) -> dict[str, Any]:
    """A scene from its JSON text; empty if the text is no JSON object."""
    try:
        parsed = json.loads(scene)
    except ValueError:
        return {}
    return parsed if isinstance(parsed, dict) else {}


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
    rows = [
        (
            "integration",
            f"{plant.get('method', 'unknown')}, {steps} samples, {counted(plant.get('events', 0), 'event')}",
        )
    ]
    if modes.size:
        mean = f", mean of {len(modes)} contacts" if len(modes) > 1 else ""
        rows.append(("stick share", f"{(modes == 0).mean():.1%} of {end_of(run):g} s{mean}"))
    if run.energy:
        supplied = run.energy.get("drive", run.energy.get("supplied", 0.0))
        rows.append(("energy", f"{supplied:.4g} J from the drive, residual {abs(run.energy.get('error', 0.0)):.0e}"))
    timing = summary.get("timing", {})
    if "verdict" in summary:
        worst = f", worst frame {timing['worst_us'] / 1e3:.3g} ms late" if timing else ""
        rows.append(("timing", f"{summary['verdict']}{worst}"))
    else:
        rows.append(("timing", "simulated without a clock"))
    if provenance := {k: run.provenance[k] for k in ("commit", "version") if run.provenance.get(k)}:
        rows.append(("made with", ", ".join(f"{k} {v[:12]}" for k, v in provenance.items())))
    return rows


class Span(NamedTuple):
    """A time span from `begin` to `end` [s], with its text."""

    begin: float
    end: float
    text: str


class Mark(NamedTuple):
    """A mark at `time` [s], with its text."""

    time: float
    text: str


def begin_of(run: Run) -> float:
    """Time of the first sample of the run [s]: above 0 for a window of a longer run."""
    return run.span[0] if run.span else 0.0


def end_of(run: Run) -> float:
    """Time of the last sample of the run [s]."""
    return run.span[1] if run.span else 0.0


def phases(run: Run) -> list[Span]:
    """The steps of the protocol that have a duration."""
    steps = [(e["t_ns"] * 1e-9, _short(e["text"])) for e in run.plant_events if e["kind"] == "step"]
    ends = [t for t, _ in steps[1:]] + [end_of(run)]
    return [Span(begin, end, text) for (begin, text), end in zip(steps, ends) if end > begin]


def _short(text: str) -> str:
    """A short form: "ramp drive.speed to 0.3 rad/s within 2 s" becomes "drive.speed to 0.3 rad/s"."""
    text = text.partition(" within ")[0]
    text = text.replace("load load.force", "load").removeprefix("ramp ")
    return "hold" if text.startswith("hold") else text


def marks_of(run: Run) -> list[Mark]:
    """Marks of the protocol, an operator or a limit, and changes of parameters that controllers reported."""
    kinds = ("mark", "knock", "fault", "limit", "emergency", "diverged", "parameter", "safe")
    own = [e for e in run.events if e["kind"] == "parameter" and e["source"] in run.commands]
    events = sorted([*(e for e in run.plant_events if e["kind"] in kinds), *own], key=lambda e: int(e["t_ns"]))
    texts_at: dict[int, list[str]] = {}
    for e in events:
        texts_at.setdefault(e["t_ns"], []).append(_marked(e))
    return [Mark(t_ns * 1e-9, ", ".join(texts)) for t_ns, texts in texts_at.items()]


def _marked(event: Mapping[str, Any]) -> str:
    """The text of a mark: of a fault its name, else the first line of the event."""
    if event["kind"] == "fault" and (name := event["data"].get("fault")):
        return str(name) if event["data"].get("begins") else f"{name} over"
    return str(event["text"]).partition("\n")[0]


def controlled(run: Run) -> list[Span]:
    """Spans in which each controller worked (was connected and enabled), in order of time."""
    spans = []
    for name, commands in run.commands.items():
        enabled = _enabled_at(run.scene, name)
        switches = [
            (e["t_ns"] * 1e-9, e["kind"] == "connected")
            for e in run.plant_events
            if e["kind"] in ("connected", "disconnected") and e["data"].get("controller") == name
        ]
        if not switches or not switches[0][1]:  # connected from the start
            switches.insert(0, (0.0, bool(commands.tick.size)))
        for (begin, on), (stop, _) in zip(switches, [*switches[1:], (end_of(run), False)]):
            if on and max(begin, enabled) < stop:
                spans.append(Span(max(begin, enabled), stop, name))
    return sorted(spans)


def _enabled_at(scene: str, name: str) -> float:
    try:
        return float(json.loads(scene)["controllers"][name].get("enable_at", 0.0))
    except (KeyError, ValueError, TypeError, AttributeError):  # of a recording from elsewhere
        return 0.0


def sections(run: Run) -> list[Span]:
    """The run, divided where a controller begins or stops working: "free", or the names of working controllers."""
    spans, end = controlled(run), end_of(run)
    cuts = sorted({0.0, end, *(t for span in spans for t in (span.begin, span.end))})
    stretches = []
    for begin, stop in pairwise(cuts):
        at_work = [span.text for span in spans if span.begin <= begin and stop <= span.end]
        stretches.append(Span(begin, stop, " + ".join(dict.fromkeys(at_work)) or "free"))
    return stretches


def circuits(run: Run, system: System | None) -> list[Span]:
    """Spans in which a switch of the electrical network was closed, and its position."""
    if system is None or not system.switches or not run.mode.size:
        return []
    known, inverse = np.unique(run.mode, return_inverse=True)
    closed = [_closed(system, int(key)) if key >= 0 else "" for key in known]  # -1: lost in the recording
    names = list(dict.fromkeys(closed))
    which = np.array([names.index(text) for text in closed])[inverse.ravel()]
    cuts = [0, *(np.flatnonzero(np.diff(which)) + 1).tolist(), which.size]
    times = [float(run.time[cut]) for cut in cuts[:-1]] + [end_of(run)]
    spans = zip(times, times[1:], (names[which[cut]] for cut in cuts[:-1]))
    return [Span(begin, end, text) for begin, end, text in spans if text]


def _closed(system: System, key: int) -> str:
    """Names and positions of the switches that are closed in mode set `key`; the first position means open."""
    positions = zip(system.switches, system.modes(key)[4])
    return ", ".join(f"{switch.name} {switch.positions[where].name}" for switch, where in positions if where)


_INK, _FAINT, _CIRCUIT = "#111111", "#777777", "#7a5fb0"
COLUMNS = 2400
LEFT, RIGHT, TOP, BOTTOM = 0.076, 0.985, 0.95, 0.072
"""Edges of the plots of a figure, as shares of its width and height."""
Bools = NDArray[np.bool_]
_MEASURED = 0.35
_STEP, _MARK = 8.5, 9.5
"""Size of the letters of a step of the protocol and of a mark [pt]."""
_ROW, _ROWS = 1.45, 7
"""Height of a row of marks in heights of its letters, and most rows."""
_PREFIXED = re.compile(r"(m|N|V|A|Pa)(/s(\^2)?)?")
_PREFIXES = ((1.0, 1.0, ""), (1e-3, 1e3, "m"), (1e-6, 1e6, "u"), (0.0, 1e9, "n"))  # least value, factor and prefix
_VISIBLE, _NOISY, _LASTING = 0.02, 3.0, 3
"""Samples show a faster motion if they leave the line between two states by this share of their range, by so many
times the difference of neighbours (which noise does not), and in so many intervals one after the other."""


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
    """Draw a line, reduced to what is visible; or points, all of them."""
    axes.plot(*((t, v) if style.get("ls") == "none" else thinned(t, v)), **style)


def channels_of(run: Run) -> Channels:
    """Plots and colours of the outputs and sensors of a run."""
    sensors = {name: run.units.get(f"meas/{name}", "") for name in run.measurements}
    return Channels(contact.read(run.scene), {name: run.units.get(name, "") for name in run.signals}, sensors)


def reduced(run: Run) -> bool:
    """Whether the outputs were recorded at a lower rate than that of the steps, as in a live run."""
    gaps = np.diff(run.time)
    return bool(gaps.size) and float(np.median(gaps)) > 1.5e-9 * run.step_ns


class Known(Enum):
    """What the recorded outputs of a run show."""

    ALL = "lines between them"
    SAMPLES = "each sample, and nothing between"
    ALIAS = "a motion that there was not"


def known(run: Run) -> Known:
    """What the recorded outputs show. If their rate was reduced, that follows from the sensors that are faster."""
    if not reduced(run):
        return Known.ALL
    fine = [measurement for measurement in run.measurements.values() if measurement.v.size > 4 * run.time.size]
    if not fine:
        return Known.SAMPLES
    return (
        Known.ALIAS
        if any(_faster(np.asarray(1e-9 * measurement.t_ns), measurement.v, run.time) for measurement in fine)
        else Known.ALL
    )


def _faster(t: Reals, v: Reals, at: Reals) -> bool:
    """Whether samples v(t) show a motion between the times `at` that the values at these times do not."""
    known = np.isfinite(v)
    t, v = t[known], v[known]
    if v.size < 2:
        return False
    rows = np.unique(np.searchsorted(t, at).clip(0, t.size - 1))
    begins = rows[:-1]
    if not begins.size:
        return False
    beside = np.maximum.reduceat(np.abs(v - np.interp(t, t[rows], v[rows])), begins)
    changes = np.add.reduceat(np.diff(v, append=v[-1]) ** 2, begins) / np.diff([*begins, v.size])
    fast = beside > np.maximum(_VISIBLE * np.ptp(v), _NOISY * np.sqrt(changes))
    return bool(np.convolve(fast, np.ones(_LASTING, int)).max() >= _LASTING)


def scaled(unit: str, most: float) -> tuple[float, str]:
    """Factor from `unit` to the one in which values up to `most` read well, and this unit: mm/s below 1 m/s.

    The page (dom.js) has the same rule.
    """
    if not _PREFIXED.fullmatch(unit) or not 0.0 < most < math.inf:
        return 1.0, unit
    factor, prefix = next((factor, prefix) for least, factor, prefix in _PREFIXES if most >= least)
    return factor, prefix + unit


def read_in(axis: Axis, unit: str, most: float) -> str:
    """Write the ticks of an `axis` with values in `unit` up to `most` in the unit that `scaled` gives; return it."""
    factor, shown = scaled(unit, most)
    axis.set_major_formatter(lambda value, _: f"{factor * value:.6g}".replace("-", "\N{MINUS SIGN}"))
    return shown


class Scales:
    """One unit for each quantity of a figure, so that its largest value is a number of the usual size.

    `names`: the outputs that the figure shows. `others`: the largest value of what else it shows in a unit.
    """

    def __init__(self, run: Run, names: Iterable[str], others: Mapping[str, float] | None = None) -> None:
        self._most = dict(others or {})
        for name in names:
            unit = run.units.get(name, "")
            self._most[unit] = max(self._most.get(unit, 0.0), largest(run.signals[name]))

    def of(self, unit: str, v: Reals | None = None) -> tuple[float, str]:
        """Factor from `unit` to the unit that the figure shows, and this unit; of values `v` that are no output."""
        return scaled(unit, self._most.get(unit, 0.0 if v is None else largest(v)))


def largest(*values: Reals) -> float:
    """Largest absolute value; 0 without any."""
    return max((float(np.nanmax(np.abs(v), initial=0.0)) for v in values), default=0.0)


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


class Sheet(NamedTuple):
    """A run as a figure shows it."""

    run: Run
    channels: Channels
    scales: Scales
    known: Known

    @classmethod
    def of(
        cls, run: Run, channels: Channels, outputs: Iterable[str], others: Mapping[str, float] | None = None
    ) -> Sheet:
        """The sheet of a figure that shows these outputs; `others`: see `Scales`."""
        return cls(run, channels, Scales(run, outputs, others), known(run))

    def sensors(self, output: str) -> list[str]:
        """Sensors that measure an output."""
        return [name for name, channel in self.channels.measured.items() if channel.reads == output]

    def sampled(self, sensor: str, factor: float) -> tuple[Reals, Reals]:
        """Times [s] and values of a sensor, those of one that measures an output in the unit of the output."""
        samples, channel = self.run.measurements[sensor], self.channels.measured.get(sensor)
        factor *= 1.0 if channel is None else channel.factor
        return np.multiply(samples.t_ns, 1e-9, dtype=np.float64), samples.v * factor

    def fine(self, output: str) -> str | None:
        """The sensor to be drawn in place of an output of which the recorded values do not show all."""
        return next(iter(self.sensors(output)), None) if self.known is not Known.ALL else None

    @property
    def style(self) -> dict[str, Any]:
        """How recorded outputs are drawn: joined, or as points."""
        return {} if self.known is Known.ALL else {"ls": "none", "marker": ".", "ms": 2.5, "mew": 0.0}


def curves(axes: Axes, sheet: Sheet, outputs: Iterable[str], sensors: Iterable[str], factor: float = 1.0) -> None:
    """Draw outputs of the run, the first one on top, sensors, and a legend. `factor`: to the unit of the axes."""
    run, channels = sheet.run, sheet.channels
    outputs = [name for name in outputs if name in run.signals]
    sensors, count = list(sensors), 0
    instead = {fine: name for name in outputs if (fine := sheet.fine(name)) in sensors}
    missing = [name for name in outputs if name not in instead.values()] if sheet.known is Known.ALIAS else []
    style: dict[str, Any]
    for name in sensors:
        full = not outputs or name in instead
        style = {"zorder": 2.5} if full else {"alpha": _MEASURED, "lw": 2.6, "zorder": 2}
        colour, label = channels.colour_of(name), f"{plain(name)} (measured)"
        line(axes, *sheet.sampled(name, factor), color=colour, label=label, **style)
        count += 1
    for output in outputs:
        if output in (*missing, *instead.values()):
            continue
        label = plain(output) + (f" ({rate(run)} samples/s)" if sheet.style else "")
        colour = channels.colours.get(output, LINES[0])
        line(
            axes,
            run.time,
            factor * run.signals[output],
            color=colour,
            label=label,
            zorder=3 - 0.01 * count,
            **sheet.style,
        )
        count += 1
    if count:
        legend(axes, min(count, 4))
    if missing:
        too_few(axes, run, ", ".join(map(plain, missing)), not count)


def too_few(axes: Axes, run: Run, what: str, alone: bool) -> None:
    """Write that the samples of `what` are too few to be drawn; `alone`: the axes show nothing else."""
    text = f"{what}:\n{rate(run)} samples per second,\ntoo few for this vibration"
    at, place = (0.5, "center") if alone else (0.04, "bottom")
    axes.text(0.5, at, text, transform=axes.transAxes, ha="center", va=place, fontsize=_MARK, color=_FAINT)
    if alone:
        axes.set_yticks([])


def rate(run: Run) -> str:
    """Number of recorded outputs per second."""
    return f"{1.0 / float(np.median(np.diff(run.time))):.4g}"


def stacked(
    figure: Figure, run: Run, header: Header, count: int, box: tuple[float, float, float]
) -> tuple[list[Axes], float]:
    """Axes for `count` plots over time, one below the other, under the header; and their upper edge.

    `box`: left and right edge, lower edge, as shares of the figure.
    """
    (left, right, bottom), height = box, figure.bbox.height
    top, gap = TOP - header.height / height, 23.0 / height
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
    figure.text(
        left, 0.968, about.get("title") or about.get("name") or run.name or "run", fontsize=13, fontweight="bold"
    )
    if run.fault:
        figure.text(0.985, 0.968, run.fault.partition("\n")[0][:110], color=ALARM, ha="right", fontsize=10.5)


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

        self._begin, self._end = begin_of(run), end_of(run) or 1.0
        self._scale, self._width = width / (self._end - self._begin or 1.0), width
        renderer: Any = figure.canvas.get_renderer()  # type: ignore[attr-defined]
        self._row = figure.dpi / 72.0 * _MARK * _ROW

        def long(text: str, size: float) -> float:
            return float(renderer.get_text_width_height_descent(text, FontProperties(size=size), False)[0])

        self._bands = [span for span in phases(run) if span.end > self._begin]
        self._inside: dict[int, str] = {}
        loose = [(mark.time, mark.text, _INK, True) for mark in marks_of(run)]
        for i, (begin, end, text) in enumerate(self._bands):
            shorter = (text, "to" + text.partition(" to")[2], text.rpartition(" to ")[2])
            room = self._scale * (end - max(begin, self._begin)) - 6.0
            fitting = next(
                (shortened for shortened in shorter if shortened not in ("", "to") and long(shortened, _STEP) <= room),
                "",
            )
            if fitting:
                self._inside[i] = fitting
            else:
                loose.append((begin, text, _FAINT, False))
        first = {text: begin for begin, _, text in reversed(list(beside))}
        loose += [(begin, text, _CIRCUIT, False) for text, begin in first.items()]
        self._labels: list[_Label] = []
        self._left_out = 0
        for time, text, colour, rises in sorted(loose):
            if self._begin <= time <= self._end:
                self._place(time, text, colour, rises, long)
        self._rows = 1 + max((label.row for label in self._labels), default=-1) + (self._left_out > 0)

    def _place(self, time: float, text: str, colour: str, rises: bool, long: Any) -> None:
        per_letter = max(long(text, _MARK) / len(text), 1.0)
        lines = textwrap.wrap(text, max(int(0.95 * self._width / per_letter), 8))[::-1]
        size = max(long(text_line, _MARK) for text_line in lines) + 4.0
        at = self._scale * (time - self._begin)
        left = at + 4.0 if at + 4.0 + size <= self._width else max(min(at - 4.0, self._width) - size, 0.0)
        taken = {label.row for label in self._labels if label.left < left + size + 12.0 and left < label.right + 12.0}
        fits = (row for row in range(_ROWS + 1 - len(lines)) if taken.isdisjoint(range(row, row + len(lines))))
        row = next(fits, None)
        if row is None:
            self._left_out += 1
            return
        for i, text_line in enumerate(lines):
            self._labels.append(_Label(time, left, left + size, row + i, text_line, colour, rises and i == 0))

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
            begin, end = max(begin, self._begin), min(end, self._end)
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
            axes.text(at, top, text, va="center", fontsize=_MARK, color=colour, bbox=white, zorder=4)
        if self._left_out:
            text = f"and {self._left_out} more: see the events of the run"
            axes.text(self._end, self._rows + 0.65, text, ha="right", va="center", fontsize=_MARK, color=_FAINT)
