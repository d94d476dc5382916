"""The amplitude index: the size of a steady vibration, computed from a measurement.

    A = (1 / n) sum_i (peak_i - valley_i) / 2        over n cycles

Source: Liu and Ouyang, Mechanical Systems and Signal Processing (2022), equation 31. The paper leaves open whether the
factor 1/2 belongs to the index; `full` is the index without it.
"""

from __future__ import annotations

from collections.abc import Iterator
from itertools import pairwise
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from rig.record.run import Run
from rig.view.curves import Span

Array = NDArray[np.float64]
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


def index(t: Array, x: Array) -> Index:
    """Compute the amplitude index of channel x at times t [s] over its whole cycles. Leave out the transient first."""
    rises = _rises(x)
    if len(rises) < 2:
        size = 0.0 if np.ptp(x) == 0.0 else float("nan")
        return Index(size, size, 0, float("nan"))
    begin, end = rises[:-1], rises[1:]  # a cycle ends on the sample on which the next one begins
    high = np.maximum(np.maximum.reduceat(x[: end[-1]], begin), x[end])
    low = np.minimum(np.minimum.reduceat(x[: end[-1]], begin), x[end])
    full = np.mean(high - low)
    cycles = len(rises) - 1
    return Index(float(0.5 * full), float(full), cycles, float(cycles / (t[rises[-1]] - t[rises[0]])))


def growth(t: Array, x: Array) -> float:
    """Growth rate [1/s] of a vibration x at times t [s]: slope of ln(peak - valley) over the time of the peak.

    The slope is fitted to all cycles by least squares. Cycles smaller than a quarter of the largest are not seen. NaN
    with less than three cycles.
    """
    rises = _rises(x)
    if len(rises) < 4:
        return float("nan")
    cycles = [(t[a : b + 1], x[a : b + 1]) for a, b in pairwise(rises)]
    sizes = np.array([np.ptp(v) for _, v in cycles])
    peaks = np.array([at[v.argmax()] for at, v in cycles])
    return float(np.polyfit(peaks - peaks.mean(), np.log(sizes), 1)[0])


def _rises(x: Array) -> NDArray[np.int64]:
    """Indices at which x has risen through its middle, beyond a hysteresis."""
    middle, band = 0.5 * (x.max() + x.min()), _BAND * 0.5 * np.ptp(x)
    if band == 0.0:
        return np.empty(0, np.int64)
    side = np.where(x > middle + band, 1, np.where(x < middle - band, -1, 0))
    sided = np.flatnonzero(side)
    return np.asarray(sided[1:][(side[sided[1:]] > 0) & (side[sided[:-1]] < 0)], np.int64)


class Row(NamedTuple):
    """The amplitude index of one sensor in one stage of a run; `mean` is in the unit of the sensor."""

    stage: str
    sensor: str
    unit: str
    mean: float
    found: Index


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
    return [
        Span(t, then, text) for (t, text), (then, _) in pairwise([*((t, s) for t, s in begins if t < end), (end, "")])
    ]


def measured(run: Run, first: float = 0.0, last: float = float("inf")) -> Iterator[Row]:
    """Yield the index of every sensor from `first` to `last` [s], for each stage of the run."""
    for stage in stages(run, first, last):
        for sensor, samples in run.measurements.items():
            t = np.multiply(samples.t_ns, 1e-9, dtype=np.float64)
            here = (t >= stage.begin) & (t <= stage.end) & np.isfinite(samples.v)
            if here.any():
                v = samples.v[here]
                yield Row(stage.text, sensor, run.units[f"meas/{sensor}"], float(v.mean()), index(t[here], v))
