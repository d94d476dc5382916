"""A finished map: regions, boundaries, every point.

I    sliding, no vibration found    II   sliding and vibration, depending on the initial state
III  vibration only                 ?    undecided: a run that did not settle could change the region
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Any, ClassVar

import numpy as np
from numpy.typing import NDArray

from rig.analysis.map.job import CARRIED, RUNS, Job
from rig.analysis.map.steady_state import NAMES, SLIDING, STICK_SLIP, STOPPED, STUCK, UNDECIDED, VIBRATION
from rig.analysis.pool import Arrays
from rig.printable import counted
from rig.results import Column, Result, Table
from rig.scenes.axis import Axis
from rig.scenes.left_out import left_out

if TYPE_CHECKING:
    from matplotlib.figure import Figure

Array = NDArray[np.float64]
Lines = Sequence[tuple[str, Array, Array]]
UNKNOWN, ONE, TWO, THREE, REST = range(5)
REGIONS = ("?", "I", "II", "III", "stuck")
MEANING = ("undecided", "sliding, no vibration found", "sliding and vibration", "vibration only", "nothing moves")
SHOWN = (ONE, TWO, THREE, REST, UNKNOWN)
"""Regions in the order of tables and legends."""
_STARTS = {
    "near": "from near sliding",
    "far": "from a standing start",
    "up": "in the run-up",
    "down": "in the run-down",
}
_MEASURES = ("low", "high", "rms", "share", "period", "spent")
_UNITS = {
    "growth": "1/s",
    "frequency": "Hz",
    "period": "s",
    "spent": "s",
    "amplitude": "output",
    "low": "output",
    "high": "output",
    "rms": "output",
}
_LOCATED = 1e-6  # of its value: the end of a vibration that is known so well is one number


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

    FIGURE: ClassVar = "rig.analysis.map.figure:figure"

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
        slid = near == SLIDING
        left = np.isin(near, (STICK_SLIP, VIBRATION))
        return np.asarray((slid & (self.growth > 0.0)) | (left & (self.growth < 0.0)))

    def with_lines(self, lines: Lines) -> Figure:
        """Return the figure with further lines, (name, x, y) in SI."""
        return self._drawn(lines)

    def shown(self) -> Iterator[str | Table]:
        """Yield the number of points of each region, and the boundaries."""
        job = self.job
        settings = job.settings
        span = "; ".join([_span(axis) for axis in (job.x, job.y) if axis is not None])
        yield f"{job.scene.name}: {span}"
        yield f"  runs: {', '.join(settings.runs)}; output {settings.output}"
        if alone := left_out(job.scene):
            yield f"  {alone}"
        yield ""
        counts = np.bincount(self.regions.ravel(), minlength=len(REGIONS)).tolist()
        rows = [(REGIONS[region], MEANING[region], counts[region]) for region in SHOWN if counts[region]]
        yield Table("counts", (Column("region"), Column("meaning"), Column("points", digits=".0f")), rows)
        if (self.regions == ONE).any():
            starts = ", ".join(_STARTS[run] for run in RUNS if run in settings.runs)
            yield f"\n  I: no vibration found {starts}"
            yield "     another start may reach one: carry the runs from where the rig vibrates, with an axis that"
            yield "     begins or ends there"
        if "near" in settings.runs:
            yield f"\n  {self._disagreements()}"
        yield from self._stopped()
        yield "\n  onset: sliding loses stability; up_ends, down_ends: run-up and run-down lose vibration"
        yield self._boundaries()

    def _disagreements(self) -> str:
        wrong = self.disagreement
        known = np.count_nonzero(~np.isnan(self.growth))
        text = f"near starts and eigenvalues disagree at {wrong.sum()} of {known} points"
        if wrong.any():
            text += f"; largest growth rate there {np.abs(self.growth[wrong]).max():.2g} 1/s"
        return text

    def _stopped(self) -> list[str]:
        """Number of points at which a run had to stop, and the reason at the first of them."""
        where = np.argwhere((self.state == STOPPED).any(axis=0))
        if not len(where):
            return []
        row, column = where[0].tolist()
        x, y = self.job.x, self.job.y
        at = f"{x.key} = {x.text(x.values[column])}"
        if y is not None:
            at += f", {y.key} = {y.text(y.values[row])}"
        why = next(text for text in self.why[:, row, column].tolist() if text)
        count = self.regions.size
        return ["", f"  a run had to stop at {len(where)} of {count} points; first at {at}: {why}"]

    def _boundaries(self) -> Table:
        x, y = self.job.x, self.job.y
        columns = [y.column()] if y else []
        columns += [x.column(name, ".9g") for name in ("onset", "up_ends", "down_ends")]
        rows = []
        for row, onset in enumerate(self.onsets):
            values = (onset.tolist(), *(_end(*end[row].tolist()) for end in self.ends))
            rows.append((y.values[row], *values) if y else values)
        return Table("boundaries", columns, rows)

    def facts(self) -> dict[str, Any]:
        """Return axes, regions, boundaries in SI, and all points."""
        x, y = self.job.x, self.job.y
        regions = []
        for row in self.regions.tolist():
            regions.append([REGIONS[region] for region in row])
        boundaries = []
        for number, onset in enumerate(self.onsets):
            up, down = self.ends[:, number].tolist()
            at = y.values[number] if y else None
            boundaries.append({"y": at, "onset": onset.tolist(), "up_ends": up, "down_ends": down})
        return {
            "scene": self.job.scene.name,
            "left_out": left_out(self.job.scene),
            "x": {"key": x.key, "unit": x.unit, "values": list(x.values)},
            "y": {"key": y.key, "unit": y.unit, "values": list(y.values)} if y else None,
            "settings": vars(self.job.settings),
            "regions": regions,
            "boundaries": boundaries,
            "disagreement": int(self.disagreement.sum()),
            "points": list(self.points()),
            "folder": str(self.folder),
        }

    def points(self) -> Iterator[dict[str, Any]]:
        """Yield every point as a flat record: axes (SI), region, growth rate, and the result of each run."""
        x, y = self.job.x, self.job.y
        amplitude = self.amplitude
        for row, column in np.ndindex(*self.regions.shape):
            record: dict[str, Any] = {x.key: x.values[column]}
            if y is not None:
                record[y.key] = y.values[row]
            record["region"] = REGIONS[self.regions[row, column]]
            record["growth"] = float(self.growth[row, column])
            record["frequency"] = float(self.frequency[row, column])
            for number, run in enumerate(RUNS):
                if run in self.job.settings.runs:
                    at = number, row, column
                    record[f"{run}_state"] = NAMES[self.state[at]]
                    record[f"{run}_amplitude"] = float(amplitude[at])
                    record[f"{run}_why"] = str(self.why[at])
                    for name in _MEASURES:
                        record[f"{run}_{name}"] = float(self.tables[name][at])
            yield record

    def listed(self) -> Table:
        """Return a row for each point."""
        records = list(self.points())
        return Table("points", [*map(self._column, records[0])], [[*record.values()] for record in records])

    def _column(self, name: str) -> Column:
        for axis in (self.job.x, self.job.y):
            if axis is not None and axis.key == name:
                return axis.column()
        run, _, quantity = name.partition("_")
        unit = _UNITS.get(quantity if run in RUNS else name, "")
        return Column(name, self.unit if unit == "output" else unit)


def gathered(job: Job, rows_of: dict[int, Arrays], folder: Path) -> Map:
    """Assemble the map of a job from its units."""
    count = len(job.x.values)
    rows = len(job.y.values) if job.y else 1
    tables: dict[str, NDArray[Any]] = {}
    for name in ("state", "why", *_MEASURES, "section"):
        runs, _, *more = rows_of[0][name].shape
        tables[name] = np.zeros((runs, rows, count, *more), rows_of[0][name].dtype)
        if tables[name].dtype.kind == "f":
            tables[name][:] = np.nan  # of runs that were not requested
    growth, frequency = np.zeros((2, rows, count))
    onsets: list[list[float]] = [[] for _ in range(rows)]
    ends = np.full((2, rows, 2), np.nan)
    for number, unit in enumerate(job.units):
        part = rows_of[number]
        at = (unit.row, slice(unit.first, unit.last))
        for run in map(RUNS.index, unit.runs):
            for name, table in tables.items():
                table[run, *at] = part[name][run]
        if unit.curve:
            growth[at] = part["growth"]
            frequency[at] = part["frequency"]
            onsets[unit.row] += part["onset"].tolist()
        if set(unit.runs) & {*CARRIED}:
            ends[:, unit.row] = part["end"]
    unit_of_output = job.scene.assemble().outputs[job.settings.output].unit
    state = tables.pop("state")
    why = tables.pop("why")
    lines = tuple(np.array(values) for values in onsets)
    return Map(job, unit_of_output, state, tables, why, growth, frequency, lines, ends, folder)


def _end(last: float, first: float) -> float | tuple[float, float]:
    """Where a vibration ends: between two values, or at one that is known well; NaN if it does not."""
    return (last, first) if first - last > _LOCATED * abs(first) else 0.5 * (last + first)


def _span(axis: Axis) -> str:
    low = axis.text(axis.values[0])
    high = axis.text(axis.values[-1])
    return f"{axis.key} from {low} to {high}, {counted(len(axis.values), 'value')}"
