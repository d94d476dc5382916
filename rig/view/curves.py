"""Curves of a run over time, common to all figures of runs, and the course of a run.

The course consists of time spans: phases of the protocol, marks, and when each controller worked. `rig.view.header`
writes them above the curves.
"""

from __future__ import annotations

import json
import math
import re
from collections.abc import Iterable, Mapping
from enum import Enum
from itertools import pairwise
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from rig.model.system import System
from rig.record.run import Reals, Run
from rig.view import contact
from rig.view.channels import Channels
from rig.view.palette import LINES

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.axis import Axis

Bools = NDArray[np.bool_]
COLUMNS = 2400  # columns to which a line is reduced: more than a figure has pixels
FAINT = "#777777"
"""Colour of what belongs to no curve."""
NOTE = 9.5
"""Size of the letters of a mark and of a note in a plot [pt]."""
_MEASURED = 0.35  # opacity of a measurement, so that the output on it is seen
_PREFIXED = re.compile(r"(m|N|V|A|Pa)(/s(\^2)?)?")
_PREFIXES = ((1.0, 1.0, ""), (1e-3, 1e3, "m"), (1e-6, 1e6, "u"), (0.0, 1e9, "n"))  # least value, factor and prefix
# Samples show a faster motion if they leave the line between two states by this share of their range, by so many
# times the difference of neighbours (which noise does not), and in so many intervals one after the other.
_VISIBLE = 0.02
_NOISY = 3.0
_LASTING = 3


def described(scene: str) -> dict[str, Any]:
    """A scene from its JSON text; empty if the text is no JSON object."""
    try:
        parsed = json.loads(scene)
    except ValueError:
        return {}
    return parsed if isinstance(parsed, dict) else {}


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
    of_plant = [event for event in run.plant_events if event["kind"] in kinds]
    of_controllers = [e for e in run.events if e["kind"] == "parameter" and e["source"] in run.commands]
    texts_at: dict[int, list[str]] = {}
    for event in sorted([*of_plant, *of_controllers], key=lambda event: int(event["t_ns"])):
        texts_at.setdefault(event["t_ns"], []).append(_marked(event))
    return [Mark(t_ns * 1e-9, ", ".join(texts)) for t_ns, texts in texts_at.items()]


def _marked(event: Mapping[str, Any]) -> str:
    """The text of a mark: of a fault its name, else the first line of the event."""
    name = event["data"].get("fault") if event["kind"] == "fault" else None
    if name:
        return str(name) if event["data"].get("begins") else f"{name} over"
    return str(event["text"]).partition("\n")[0]


def controlled(run: Run) -> list[Span]:
    """Spans in which each controller worked (was connected and enabled), in order of time."""
    spans = []
    for name, commands in run.commands.items():
        enabled = _enabled_at(run.scene, name)
        switches = _switched(run, name)
        if not switches or not switches[0][1]:  # connected from the start
            switches.insert(0, (0.0, bool(commands.tick.size)))
        for (begin, on), (stop, _) in pairwise([*switches, (end_of(run), False)]):
            working = max(begin, enabled)
            if on and working < stop:
                spans.append(Span(working, stop, name))
    return sorted(spans)


def _switched(run: Run, controller: str) -> list[tuple[float, bool]]:
    """Times [s] at which a controller connected (true) or disconnected."""
    switches = []
    for event in run.plant_events:
        if event["kind"] in ("connected", "disconnected") and event["data"].get("controller") == controller:
            switches.append((event["t_ns"] * 1e-9, event["kind"] == "connected"))
    return switches


def _enabled_at(scene: str, name: str) -> float:
    try:
        return float(json.loads(scene)["controllers"][name].get("enable_at", 0.0))
    except (KeyError, ValueError, TypeError, AttributeError):  # of a recording from elsewhere
        return 0.0


def sections(run: Run) -> list[Span]:
    """The run, divided where a controller begins or stops working: "free", or the names of working controllers."""
    spans = controlled(run)
    begins = [span.begin for span in spans]
    ends = [span.end for span in spans]
    cuts = sorted({0.0, end_of(run), *begins, *ends})
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
    begins = cuts[:-1]
    times = [float(run.time[begin]) for begin in begins] + [end_of(run)]
    spans = zip(times, times[1:], (names[which[begin]] for begin in begins))
    return [Span(begin, end, text) for begin, end, text in spans if text]


def _closed(system: System, key: int) -> str:
    """Names and positions of the switches that are closed in mode set `key`; the first position means open."""
    positions = zip(system.switches, system.modes(key)[4])
    return ", ".join(f"{switch.name} {switch.positions[where].name}" for switch, where in positions if where)


def thinned(t: Reals, v: Reals, columns: int = COLUMNS) -> tuple[Reals, Reals]:
    """Reduce a line to the lowest and highest value in each of `columns` columns; drawn, it looks the same."""
    if t.size <= 4 * columns:
        return t, v
    size = -(-t.size // columns)
    count = t.size // size
    table = v[: count * size].reshape(count, size)
    unknown = np.isnan(table)
    lowest = np.where(unknown, np.inf, table).min(axis=1)
    highest = np.where(unknown, -np.inf, table).max(axis=1)
    ends = np.stack((lowest, highest), axis=1)
    ends[~np.isfinite(ends)] = np.nan
    return np.repeat(t[: count * size : size], 2), ends.ravel()


def apart(x: Reals, y: Reals, jumps: Bools) -> tuple[Reals, Reals]:
    """Return x [n] and y [n, ...] with a gap after each point i where `jumps[i]` [n - 1], which no line joins."""
    at = np.flatnonzero(jumps) + 1
    return np.insert(x, at, np.nan), np.insert(y, at, np.nan, axis=0)


def line(axes: Axes, t: Reals, v: Reals, **style: Any) -> None:
    """Draw a line, reduced to what is visible; or points, all of them."""
    if style.get("ls") != "none":
        t, v = thinned(t, v)
    axes.plot(t, v, **style)


def channels_of(run: Run) -> Channels:
    """Plots and colours of the outputs and sensors of a run."""
    outputs = {name: run.units.get(name, "") for name in run.signals}
    sensors = {name: run.units.get(f"meas/{name}", "") for name in run.measurements}
    return Channels(contact.read(run.scene), outputs, sensors)


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
    faster = any(_faster(np.asarray(1e-9 * measurement.t_ns), measurement.v, run.time) for measurement in fine)
    return Known.ALIAS if faster else Known.ALL


def _faster(t: Reals, v: Reals, at: Reals) -> bool:
    """Whether samples v(t) show a motion between the times `at` that the values at these times do not."""
    known = np.isfinite(v)
    t = t[known]
    v = v[known]
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
        samples = self.run.measurements[sensor]
        channel = self.channels.measured.get(sensor)
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
    run = sheet.run
    channels = sheet.channels
    outputs = [name for name in outputs if name in run.signals]
    sensors = list(sensors)
    instead = {fine: name for name in outputs if (fine := sheet.fine(name)) in sensors}
    joined = [name for name in outputs if name not in instead.values()]
    missing = joined if sheet.known is Known.ALIAS else []
    for sensor in sensors:
        full = not outputs or sensor in instead
        style = {"zorder": 2.5} if full else {"alpha": _MEASURED, "lw": 2.6, "zorder": 2}
        t, v = sheet.sampled(sensor, factor)
        line(axes, t, v, color=channels.colour_of(sensor), label=f"{plain(sensor)} (measured)", **style)
    count = len(sensors)
    for output in joined:
        if output in missing:
            continue
        label = plain(output) + (f" ({rate(run)} samples/s)" if sheet.style else "")
        colour = channels.colours.get(output, LINES[0])
        v = factor * run.signals[output]
        line(axes, run.time, v, color=colour, label=label, zorder=3 - 0.01 * count, **sheet.style)
        count += 1
    if count:
        legend(axes, min(count, 4))
    if missing:
        too_few(axes, run, ", ".join(map(plain, missing)), not count)


def too_few(axes: Axes, run: Run, what: str, alone: bool) -> None:
    """Write that the samples of `what` are too few to be drawn; `alone`: the axes show nothing else."""
    text = f"{what}:\n{rate(run)} samples per second,\ntoo few for this vibration"
    at, place = (0.5, "center") if alone else (0.04, "bottom")
    axes.text(0.5, at, text, transform=axes.transAxes, ha="center", va=place, fontsize=NOTE, color=FAINT)
    if alone:
        axes.set_yticks([])


def rate(run: Run) -> str:
    """Number of recorded outputs per second."""
    return f"{1.0 / float(np.median(np.diff(run.time))):.4g}"
