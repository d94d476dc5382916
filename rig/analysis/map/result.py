"""A finished map: regions, boundaries, every point.

I    sliding, no vibration found    II   sliding and vibration, depending on the initial state
III  vibration only                 ?    undecided: a run that did not settle could change the region

A map as a picture: regions over two axes; over one axis a bifurcation diagram.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Any, ClassVar

import numpy as np
from numpy.typing import NDArray

from rig.analysis.axis import heading
from rig.analysis.map.dither import Boundary
from rig.analysis.map.job import CARRIED, RUNS, Job
from rig.analysis.map.steady_state import NAMES, SLIDING, STICK_SLIP, STOPPED, STUCK, UNDECIDED, VIBRATION
from rig.analysis.pool import Arrays
from rig.machine.files import csv_table
from rig.printable import columns, counted
from rig.results import Result
from rig.scenes.left_out import left_out
from rig.view.curves import apart, plain, read_in
from rig.view.palette import AMBER, BARE, BLUE, GREEN, LINES, VERMILION, page

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure


Array = NDArray[np.float64]
Lines = Sequence[tuple[str, Array, Array]]
UNKNOWN, ONE, TWO, THREE, REST = range(5)
REGIONS = ("?", "I", "II", "III", "stuck")
MEANING = ("undecided", "sliding, no vibration found", "sliding and vibration", "vibration only", "nothing moves")
_STARTS = {
    "near": "from near sliding",
    "far": "from a standing start",
    "up": "in the run-up",
    "down": "in the run-down",
}
_UNITS = {"growth": "1/s", "frequency": "Hz", "period": "s", "spent": "s"} | dict.fromkeys(
    ("amplitude", "low", "high", "rms"), "output"
)
_LOCATED = 1e-6  # of its value: the end of a vibration that is known so well is one number
_ROWS = 12  # of boundaries, on the screen


@dataclass(frozen=True)
class Map(Result):
    """The result of `rig.map`, over [row, point]; a map with one axis has one row.

    state      results of rig.analysis.map.steady_state, [run, row, point], runs in the order of `RUNS`;
               NONE for runs that were not requested
    tables     low, high, rms of the output; share of the time in stick; period; spent: simulated seconds; same shape.
               section: local maxima of the output, [run, row, point, number]
    why        why a simulation had to stop, in words, of the same shape as `state`; "" if it did not
    growth     largest growth rate at the sliding equilibrium [1/s], nan if there is none; frequency [Hz] of it
    onsets     of each row: values at which the growth rate passes through zero
    ends       [run-up and run-down, row, 2]: last value with vibration in the carried run, first without it
    """

    FIGURE: ClassVar = "rig.analysis.map.result:figure"

    job: Job
    unit: str
    state: NDArray[np.int8]
    tables: dict[str, Array]
    why: NDArray[np.str_]
    growth: Array
    frequency: Array
    onsets: tuple[Array, ...]
    ends: Array
    folder: Path

    @cached_property
    def regions(self) -> NDArray[np.int8]:
        """Region of each point, [row, point]: number in `REGIONS`."""
        slides = (self.state == SLIDING).any(axis=0)
        vibrates = self.moves.any(axis=0)
        open_ = np.isin(self.state, (UNDECIDED, STOPPED)).any(axis=0)
        region = np.full(slides.shape, UNKNOWN, dtype=np.int8)
        region[slides & ~vibrates & ~open_] = ONE
        region[~slides & vibrates & ~open_] = THREE
        region[slides & vibrates] = TWO
        region[(self.state == STUCK).any(axis=0) & ~slides & ~vibrates] = REST
        return region

    @property
    def moves(self) -> NDArray[np.bool_]:
        """Whether the run ended in vibration, [run, row, point]."""
        return np.isin(self.state, (STICK_SLIP, VIBRATION))

    @property
    def amplitude(self) -> Array:
        """Half of peak to peak of the output, [run, row, point]."""
        return 0.5 * (self.tables["high"] - self.tables["low"])

    @property
    def disagreement(self) -> NDArray[np.bool_]:
        """Points at which near start and eigenvalue are both decided and differ, [row, point]."""
        near = self.state[RUNS.index("near")]
        slid, left = near == SLIDING, np.isin(near, (STICK_SLIP, VIBRATION))
        return np.asarray((slid & (self.growth > 0.0)) | (left & (self.growth < 0.0)))

    def with_lines(self, lines: Lines) -> Figure:
        """Return the figure with further lines, (name, x, y) in SI."""
        return self._drawn(lines)

    def text(self) -> str:
        """Return the report as text."""
        job, x = self.job, self.job.x
        settings = job.settings
        span = f"{x.key} from {x.text(x.values[0])} to {x.text(x.values[-1])}, {counted(len(x.values), 'value')}"
        if job.y is not None:
            y = job.y
            span += f"; {y.key} from {y.text(y.values[0])} to {y.text(y.values[-1])}, {counted(len(y.values), 'value')}"
        lines = [f"{job.scene.name}: {span}", f"  runs: {', '.join(settings.runs)}; output {settings.output}"]
        alone = left_out(job.scene)
        lines += [f"  {alone}", ""] if alone else [""]
        counts = np.bincount(self.regions.ravel(), minlength=len(REGIONS))
        lines += columns(
            [(REGIONS[r], MEANING[r], counted(counts[r], "point")) for r in (1, 2, 3, 4, 0) if counts[r]], "<<>"
        )
        if (self.regions == ONE).any():
            starts = ", ".join(_STARTS[run] for run in RUNS if run in settings.runs)
            lines += ["", f"  I: no vibration found {starts}",
                      "     another start may reach one: carry the runs from where the rig vibrates, with an axis that",
                      "     begins or ends there"]  # fmt: skip
        if "near" in settings.runs:
            wrong, both = self.disagreement, np.count_nonzero(~np.isnan(self.growth))
            worst = f"; largest growth rate there {np.abs(self.growth[wrong]).max():.2g} 1/s" if wrong.any() else ""
            lines += ["", f"  near starts and eigenvalues disagree at {wrong.sum()} of {both} points{worst}"]
        lines += self._stopped()
        lines += ["", *self._boundaries()]
        return "\n".join(lines)

    def _stopped(self) -> list[str]:
        """Number of points at which a run had to stop, and the reason at the first of them."""
        where = np.argwhere((self.state == STOPPED).any(axis=0))
        if not len(where):
            return []
        (row, column), x, y = where[0].tolist(), self.job.x, self.job.y
        at = f"{x.key} = {x.text(x.values[column])}" + (f", {y.key} = {y.text(y.values[row])}" if y else "")
        why = next(text for text in self.why[:, row, column].tolist() if text)
        count = self.regions.size
        return ["", f"  a run had to stop at {len(where)} of {count} points; first at {at}: {why}"]

    def _boundaries(self) -> Iterator[str]:
        y, x = self.job.y, self.job.x
        heads = ("sliding loses stability", "run-up loses vibration", "run-down loses vibration")
        table: list[tuple[str, ...]] = [(y.label if y else "", *heads)]
        rows = range(len(self.onsets))
        chosen = sorted({round(r) for r in np.linspace(0, rows[-1], min(_ROWS, len(rows)))})
        for row in chosen:
            onset = ", ".join(x.text(v) for v in self.onsets[row]) or "-"
            ends = (self._end(end[row]) for end in self.ends)
            table.append((y.text(y.values[row]) if y else "", onset, *ends))
        yield from columns(table if y else [row[1:] for row in table], "<" * len(table[0][bool(not y) :]))
        if len(chosen) < len(rows):
            yield f"  and {len(rows) - len(chosen)} more rows"

    def _end(self, end: Array) -> str:
        x = self.job.x
        if end[1] - end[0] <= _LOCATED * abs(end[1]):
            return x.text(float(end.mean()), 9)
        return "-" if np.isnan(end[0]) else f"{end[0] / x.scale:.6g} to {x.text(end[1])}"

    def to_json(self) -> dict[str, Any]:
        """Return the fields as JSON values; boundaries in SI."""
        x, y = self.job.x, self.job.y
        rows = range(len(self.onsets))
        return {
            "scene": self.job.scene.name,
            "left_out": left_out(self.job.scene),
            "x": {"key": x.key, "unit": x.unit, "values": list(x.values)},
            "y": {"key": y.key, "unit": y.unit, "values": list(y.values)} if y else None,
            "settings": vars(self.job.settings),
            "regions": [[REGIONS[r] for r in row] for row in self.regions.tolist()],
            "boundaries": [
                {
                    "y": y.values[row] if y else None,
                    "onset": self.onsets[row].tolist(),
                    "up_ends": self.ends[0, row].tolist(),
                    "down_ends": self.ends[1, row].tolist(),
                }
                for row in rows
            ],
            "disagreement": int(self.disagreement.sum()),
            "points": list(self.points()),
            "folder": str(self.folder),
        }

    def points(self) -> Iterator[dict[str, Any]]:
        """Yield every point as a flat record: axes (SI), region, growth rate, and the result of each run."""
        x, y, amplitude = self.job.x, self.job.y, self.amplitude
        asked = [(RUNS.index(run), run) for run in RUNS if run in self.job.settings.runs]
        for row, column in np.ndindex(*self.regions.shape):
            record: dict[str, Any] = {x.key: x.values[column]}
            if y is not None:
                record[y.key] = y.values[row]
            record |= {"region": REGIONS[self.regions[row, column]], "growth": float(self.growth[row, column])}
            record["frequency"] = float(self.frequency[row, column])
            for number, run in asked:
                at = number, row, column
                record |= {f"{run}_state": NAMES[self.state[at]], f"{run}_amplitude": float(amplitude[at])}
                record[f"{run}_why"] = str(self.why[at])
                names = ("low", "high", "rms", "share", "period", "spent")
                record |= {f"{run}_{name}": float(self.tables[name][at]) for name in names}
            yield record

    def csv(self) -> str:
        """Return every point as a line of a CSV file; the head names the units."""
        records = list(self.points())
        return csv_table([map(self._head, records[0]), *(record.values() for record in records)]).decode()

    def _head(self, name: str) -> str:
        """The name of a column of numbers with its unit."""
        for axis in (self.job.x, self.job.y):
            if axis is not None and axis.key == name:
                return axis.si_label
        run, _, quantity = name.partition("_")
        unit = _UNITS.get(quantity if run in RUNS else name, "")
        return f"{name} [{self.unit if unit == 'output' else unit}]" if unit else name


def gathered(job: Job, rows_of: dict[int, Arrays], folder: Path) -> Map:
    """Assemble the map of a job from its units."""
    count, rows = len(job.x.values), len(job.y.values) if job.y else 1
    tables: dict[str, NDArray[Any]] = {}
    for name in ("state", "why", "low", "high", "rms", "share", "period", "spent", "section"):
        runs, _, *more = rows_of[0][name].shape
        tables[name] = np.zeros((runs, rows, count, *more), rows_of[0][name].dtype)
        if tables[name].dtype.kind == "f":
            tables[name][:] = np.nan  # of runs that were not requested
    growth, frequency = np.zeros((2, rows, count))
    onsets: list[list[float]] = [[] for _ in range(rows)]
    ends = np.full((2, rows, 2), np.nan)
    for number, unit in enumerate(job.units):
        part, at = rows_of[number], (unit.row, slice(unit.first, unit.last))
        for run in map(RUNS.index, unit.runs):
            for name, table in tables.items():
                table[run, *at] = part[name][run]
        if unit.curve:
            growth[at], frequency[at] = part["growth"], part["frequency"]
            onsets[unit.row] += part["onset"].tolist()
        if set(unit.runs) & {*CARRIED}:
            ends[:, unit.row] = part["end"]
    unit_of_output = job.scene.assemble().outputs[job.settings.output].unit
    state, why, lines = tables.pop("state"), tables.pop("why"), tuple(np.array(values) for values in onsets)
    return Map(job, unit_of_output, state, tables, why, growth, frequency, lines, ends, folder)


COLOURS = ("#9d9d9d", "#d5e8dc", "#f6dfae", "#e7a79a", "#b9b9e0")  # of REGIONS
RUN_STYLES = {"up": (BLUE, "^"), "down": (VERMILION, "v"), "near": (GREEN, "x"), "far": (AMBER, "+")}
_LABELS = {"up": "run-up", "down": "run-down", "near": "near start", "far": "standing start"}


def figure(result: Map | Boundary, lines: Lines = ()) -> Figure:
    """Return the figure of what `rig.map` found; `lines` over two parameters, (name, x, y) in SI."""
    with page(9.6, 6.4, style=BARE, layout="constrained") as figure:
        if isinstance(result, Boundary):
            _dither(figure.add_subplot(), result)
        elif result.job.y is None:
            _bifurcation(figure, result)
        else:
            _regions(figure.add_subplot(), result, lines)
        axes = [axis for axis in (result.job.x, result.job.y) if axis is not None]
        heading(figure, result.job.scene, axes, "steady-state behaviour")
    return figure


def _regions(axes: Axes, result: Map, lines: Lines) -> None:
    from matplotlib.colors import ListedColormap

    job = result.job
    assert job.y is not None
    x, y = job.x.shown_values, job.y.shown_values
    mesh = axes.pcolormesh(x, y, result.regions, cmap=ListedColormap(COLOURS), vmin=-0.5, vmax=4.5, shading="nearest")
    mesh.set_rasterized(True)
    scale = job.x.scale
    for (name, along, up), colour in zip(lines, LINES * len(lines)):
        axes.plot(along / scale, up / job.y.scale, color=colour, lw=2.0, label=name)
    if any(map(len, result.onsets)) and not lines:
        rows = [values if len(values) else [np.nan] for values in result.onsets]  # no line leads over an empty row
        onsets = np.array([(value / scale, y[row]) for row, values in enumerate(rows) for value in values])
        _line(axes, onsets, "-", "black", "", "sliding loses stability (eigenvalue)")
    for number, (run, label) in enumerate((("up", "run-up"), ("down", "run-down"))):
        ends = result.ends[number].mean(axis=1) / scale
        if not np.isnan(ends).all():
            colour, marker = RUN_STYLES[run]
            style = (" ", "black") if lines else ("-", colour)  # simulated points beside computed curves
            _line(axes, np.column_stack([ends, y]), *style, marker, f"{label} loses vibration")
    axes.set(xlabel=job.x.title, ylabel=job.y.title, xlim=(x[0], x[-1]), ylim=(y[0], y[-1]))
    axes.margins(0.0)
    _legend(axes, _there(result))


def _line(axes: Axes, points: Any, style: str, colour: str, marker: str, label: str) -> None:
    """Draw boundary points (nan: a row without one), joined from row to row where each of both has one."""
    rows = points[~np.isnan(points[:, 0]), 1]
    joined = len(np.unique(rows)) == len(rows)
    few = marker if len(rows) <= 40 else ""
    axes.plot(points[:, 0], points[:, 1], style if joined else ".", color=colour, marker=few, ms=4, label=label)


def _there(result: Map) -> dict[int, str]:
    return {r: f"{REGIONS[r]}  {MEANING[r]}" for r in (1, 2, 3, 4, 0) if (result.regions == r).any()}


def _legend(axes: Axes, labels: dict[int, str], *others: Axes) -> None:
    from matplotlib.patches import Patch

    patches = [Patch(color=COLOURS[r], label=label) for r, label in labels.items()]
    lines = [handle for panel in (*others, axes) for handle in panel.get_legend_handles_labels()[0]]
    axes.legend(handles=[*patches, *lines], loc="upper left", bbox_to_anchor=(0.0, -0.11), ncols=3)


def _bifurcation(figure: Figure, result: Map) -> None:
    x = result.job.x.shown_values
    panels = figure.subplots(3, 1, sharex=True, height_ratios=(2.4, 1.2, 1.0))
    settings, unit = result.job.settings, result.unit
    top, middle, bottom = panels
    edges = np.concatenate([[x[0]], 0.5 * (x[1:] + x[:-1]), [x[-1]]])
    for axes in panels:
        for i, region in enumerate(result.regions[0].tolist()):
            axes.axvspan(edges[i], edges[i + 1], color=COLOURS[region], lw=0, zorder=0)
        for onset in result.onsets[0]:
            label = "sliding loses stability (eigenvalue)" if axes is bottom else None
            axes.axvline(onset / result.job.x.scale, color="black", lw=1.0, ls="--", label=label)
    for run in settings.runs:
        number, (colour, marker) = RUNS.index(run), RUN_STYLES[run]
        carried = run in ("up", "down")
        style: dict[str, Any] = {"color": colour, "marker": marker, "ms": 5.5 if carried else 3.5, "mfc": "none"}
        style |= {"lw": 0.9 if carried else 0.0, "ls": "--" if run == "down" else "-"}
        jumps = np.diff(result.moves[number, 0]) != 0
        for name in ("low", "high"):
            label = _LABELS[run] if name == "high" else None
            top.plot(*apart(x, result.tables[name][number, 0], jumps), label=label, **style)
        section = result.tables["section"][number, 0]
        top.plot(np.repeat(x, section.shape[1]), section.ravel(), ".", color=colour, ms=1.5)
        middle.plot(*apart(x, result.tables["rms"][number, 0], jumps), **style)
        bottom.plot(*apart(x, result.tables["share"][number, 0], jumps), **style)
    shown, _ = (read_in(axes.yaxis, unit, max(map(abs, top.get_ylim()))) for axes in (top, middle))
    top.set_ylabel(f"{plain(settings.output)} [{shown}]\nextremes, local maxima")
    middle.set_ylabel(f"rms about\nthe mean [{shown}]")
    bottom.set_ylabel("share of\ntime stuck")
    bottom.set_xlabel(result.job.x.title)
    _legend(bottom, _there(result), top)
    bottom.get_legend().set_bbox_to_anchor((0.0, -0.42))  # type: ignore[union-attr]
    top.set_xlim(edges[0], edges[-1])
    figure.align_ylabels(panels)


def _dither(axes: Axes, result: Boundary) -> None:
    x, y = result.job.x, result.job.y
    assert y is not None
    edge = np.clip(result.averaged / y.scale, y.shown_values[0], y.shown_values[-1])
    axes.fill_between(x.shown_values, y.shown_values[0], edge, color=COLOURS[3], lw=0)
    axes.fill_between(x.shown_values, edge, y.shown_values[-1], color=COLOURS[1], lw=0)
    seen = np.isfinite(result.simulated).all(axis=1)
    middle, half = result.simulated[seen].mean(axis=1), 0.5 * np.diff(result.simulated[seen], axis=1).ravel()
    for theory, style, label in ((result.averaged, "k", "averaged"), (result.leading, "k:", "leading order")):
        axes.plot(x.shown_values, np.where(np.isinf(theory), np.nan, theory) / y.scale, style, label=label)
    axes.errorbar(
        x.shown_values[seen],
        middle / y.scale,
        half / y.scale,
        fmt="o",
        ms=4,
        color=RUN_STYLES["up"][0],
        label="simulated",
    )
    axes.set(xlabel=x.title, ylabel=y.title)
    axes.margins(0.0)
    _legend(axes, {1: "dither keeps the rig sliding", 3: "sliding is lost"})
