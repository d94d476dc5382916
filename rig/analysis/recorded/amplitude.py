"""Amplitude and frequency of every sensor in each stage of a run, and the speeds at which its contact stuck.

The amplitude index: the size of a steady vibration, computed from a measurement.

    A = (1 / n) sum_i (peak_i - valley_i) / 2        over n cycles

Source: Liu and Ouyang, Mechanical Systems and Signal Processing (2022), equation 31. The paper leaves open whether the
factor 1/2 belongs to the index; `full` is the index without it.

Noise crosses its middle too. An amplitude that noise and resolution of the instrument explain is marked as such; it has
neither cycles nor a frequency.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from itertools import pairwise
from typing import Any, ClassVar, NamedTuple

import numpy as np
from numpy.typing import NDArray

from rig.analysis.recorded import stick_speeds
from rig.analysis.recorded.series import scene_name
from rig.errors import UsageError
from rig.record.film_points import read
from rig.record.run import Run
from rig.record.run_data import stretches
from rig.results import Column, Result, Table
from rig.view.curves import Span

Array = NDArray[np.float64]
_NOISE = 4.0  # noise of a cycle reaches this many standard deviations to either side [chosen]
NOISY = "at noise level"
_BAND = 0.25  # hysteresis of a passage through the middle, as a share of half the range: noise does not count as cycles


class Index(NamedTuple):
    """The amplitude index of one channel, averaged over `cycles` cycles.

    `half`, `full`: mean of half the peak-to-valley distance, and of the whole distance, in the unit of the channel.
    `frequency` [Hz]: of these cycles. A channel that rises through its middle less than twice has no whole cycle:
    `cycles` is 0, the rest nan. The amplitude of a constant is 0.
    """

    half: float
    full: float
    cycles: int
    frequency: float

    @property
    def why(self) -> str:
        """Why values are missing; "" if none is."""
        return "" if self.cycles else "less than one whole cycle"


class Row(NamedTuple):
    """The amplitude index of one sensor in one stage of a run; `mean` is in the unit of the sensor.

    `noise`: the largest amplitude that noise and resolution of the instrument explain, 0 if they are not known. A
    smaller one has an amplitude, but no cycles.
    """

    stage: str
    sensor: str
    unit: str
    mean: float
    found: Index
    noise: float = 0.0

    @property
    def why(self) -> str:
        """Why cycles and frequency are missing; "" if they are not."""
        return NOISY if 0.0 < self.found.half <= self.noise else self.found.why


@dataclass(frozen=True)
class Amplitudes(Result):
    """The amplitude index of every sensor of a run in each of its stages.

    `sticks`: speeds of the last and the first stick, if the run accelerates and decelerates.
    """

    FIGURE: ClassVar = "rig.analysis.recorded.channel_figures:amplitudes_figure"
    TITLE: ClassVar = "amplitude: half of peak to valley, mean over the cycles"

    scene: str
    rows: tuple[Row, ...]
    sticks: stick_speeds.Stages | None

    def shown(self) -> Iterator[str | Table]:
        """Yield a row for each sensor and stage, and the speeds of stick."""
        yield f"{self.scene}: {self.TITLE}\n"
        columns = (
            Column("stage"),
            Column("sensor"),
            Column("mean", digits=".5g"),
            Column("amplitude", digits=".5g"),
            Column("unit"),
            Column("cycles", digits=".0f"),
            Column("frequency", "Hz", ".5g"),
            Column("why"),
        )
        rows = [(r.stage, r.sensor, r.mean, r.found.half, r.unit, *r.found[2:], r.why) for r in self.rows]
        yield Table("rows", columns, rows)
        if self.sticks:
            yield self.sticks.text()

    def facts(self) -> dict[str, Any]:
        """Return the rows with all values, and the speeds of stick."""
        rows = [{**row._asdict(), "found": {**row.found._asdict(), "why": row.why}} for row in self.rows]
        return {"rows": rows, "stages": self.sticks._asdict() if self.sticks else None}


def amplitudes(run: Run, first: float = 0.0, last: float = float("inf")) -> Amplitudes:
    """Compute the amplitude index of every sensor from `first` to `last` [s], for each stage of the run.

    Raises UsageError for a time span outside of the run.
    """
    if run.span and first >= min(last, run.span[1]):
        raise UsageError(
            f"--from {first:g} s to {min(last, run.span[1]):g} s: the time span is empty; the recording "
            "has {:g} to {:g} s".format(*run.span)
        )
    return Amplitudes(scene_name(run), tuple(measured(run, first, last)), stick_speeds.stages(run))


def measured(run: Run, first: float = 0.0, last: float = float("inf")) -> Iterator[Row]:
    """Yield the index of every sensor from `first` to `last` [s], for each stage of the run.

    Stretches that lie far apart are stages of their own.
    """
    floors = _floors(run)
    for stage in stages(run, first, last):
        for sensor, samples in run.measurements.items():
            t = np.multiply(samples.t_ns, 1e-9, dtype=np.float64)
            inside = (t >= stage.begin) & (t <= stage.end) & np.isfinite(samples.v)
            if not inside.any():
                continue
            parts = stretches(samples.t_ns[inside])
            for part in parts:
                times = t[inside][part]
                v = samples.v[inside][part]
                floor = floors.get(sensor, 0.0)
                amplitude = index(times, v)
                if amplitude.half <= floor:
                    amplitude = amplitude._replace(cycles=0, frequency=float("nan"))
                text = stage.text if len(parts) == 1 else f"{stage.text}, {times[0]:.6g} to {times[-1]:.6g} s"
                yield Row(text, sensor, run.units[f"meas/{sensor}"], float(v.mean()), amplitude, floor)


def stages(run: Run, first: float = 0.0, last: float = float("inf")) -> list[Span]:
    """Return the spans between two marks of the protocol from `first` to `last` [s], each named by its mark.

    Before the first mark the name is "before", in a run without marks "whole". A run without samples has no stages.
    """
    if not run.span:
        return []
    marks = [(event["t_ns"] * 1e-9, event["text"]) for event in run.plant_events if event["kind"] == "mark"]
    end = min(last, run.span[1])
    begins = [(max(t, first), text) for (t, text), (then, _) in zip(marks, [*marks[1:], (end, "")]) if then > first]
    if not marks or marks[0][0] > first:
        begins.insert(0, (first, "before" if marks else "whole"))
    bounds = [(t, text) for t, text in begins if t < end]
    return [Span(t, then, text) for (t, text), (then, _) in pairwise([*bounds, (end, "")])]


def index(t: Array, x: Array) -> Index:
    """Compute the amplitude index of channel x at times t [s] over its whole cycles. Leave out the transient first."""
    passages = rises(x)
    if len(passages) < 2:
        size = 0.0 if np.ptp(x) == 0.0 else float("nan")
        return Index(size, size, 0, float("nan"))
    begin = passages[:-1]
    end = passages[1:]  # a cycle ends on the sample on which the next one begins
    high = np.maximum(np.maximum.reduceat(x[: end[-1]], begin), x[end])
    low = np.minimum(np.minimum.reduceat(x[: end[-1]], begin), x[end])
    full = np.mean(high - low)
    cycles = len(passages) - 1
    seconds = t[passages[-1]] - t[passages[0]]
    return Index(float(0.5 * full), float(full), cycles, float(cycles / seconds))


def growth(t: Array, x: Array) -> float:
    """Growth rate [1/s] of a vibration x at times t [s]: slope of ln(peak - valley) over the time of the peak.

    The slope is fitted to all cycles by least squares. Cycles smaller than a quarter of the largest are not seen. NaN
    with less than three cycles.
    """
    passages = rises(x)
    if len(passages) < 4:
        return float("nan")
    cycles = [(t[a : b + 1], x[a : b + 1]) for a, b in pairwise(passages)]
    sizes = np.array([np.ptp(v) for _, v in cycles])
    peaks = np.array([at[v.argmax()] for at, v in cycles])
    return float(np.polyfit(peaks - peaks.mean(), np.log(sizes), 1)[0])


def rises(x: Array) -> NDArray[np.int64]:
    """Return the indices at which x has risen through its middle, beyond a hysteresis."""
    middle = 0.5 * (x.max() + x.min())
    band = _BAND * 0.5 * np.ptp(x)
    if band == 0.0:
        return np.empty(0, np.int64)
    side = np.where(x > middle + band, 1, np.where(x < middle - band, -1, 0))
    sided = np.flatnonzero(side)
    risen = (side[sided[1:]] > 0) & (side[sided[:-1]] < 0)
    return np.asarray(sided[1:][risen], np.int64)


def _floors(run: Run) -> dict[str, float]:
    """Largest amplitude by noise and resolution of each sensor; empty for a run whose scene is not known."""
    scene = read(run.scene)
    ends = {name: sensor.front_end() for name, sensor in scene.sensors.items()} if scene else {}
    return {name: _NOISE * end.noise + end.resolution for name, end in ends.items()}
