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

Array = NDArray[np.float64]
_BAND = 0.25
"""Hysteresis of a passage through the middle, as a share of half the range: noise does not count as cycles."""


class Index(NamedTuple):
    """The amplitude index of one signal, averaged over `cycles` cycles.

    `half`, `full`: mean of half the peak-to-valley distance, and of the whole distance, in the unit of the signal.
    `frequency` [Hz]: of these cycles. A signal that passes its middle less than twice has no cycle: `cycles` is 0, the
    rest nan.
    """

    half: float
    full: float
    cycles: int
    frequency: float


def index(t: Array, x: Array) -> Index:
    """Compute the amplitude index of signal x at times t [s] over its whole cycles. Leave out the transient first."""
    middle, band = 0.5 * (x.max() + x.min()), _BAND * 0.5 * np.ptp(x)
    side = np.where(x > middle + band, 1, np.where(x < middle - band, -1, 0))
    told = np.flatnonzero(side)
    rises = told[1:][(side[told[1:]] > 0) & (side[told[:-1]] < 0)]
    if len(rises) < 2 or band == 0.0:
        return Index(0.0, 0.0, 0, float("nan"))
    full = np.mean([np.ptp(x[a : b + 1]) for a, b in pairwise(rises)])
    cycles = len(rises) - 1
    return Index(float(0.5 * full), float(full), cycles, float(cycles / (t[rises[-1]] - t[rises[0]])))


class Row(NamedTuple):
    """The amplitude index of one sensor in one stage of a run; `mean` is in the unit of the sensor."""

    stage: str
    sensor: str
    unit: str
    mean: float
    found: Index


def measured(run: Run, first: float = 0.0, last: float = float("inf")) -> Iterator[Row]:
    """Yield the index of every sensor from `first` to `last` [s], for each stage between two marks of the protocol."""
    marks = [(event["t_ns"] * 1e-9, event["text"]) for event in run.told if event["kind"] == "mark"]
    end = min(last, run.time[-1])
    stages = [(max(t, first), text) for (t, text), (then, _) in zip(marks, [*marks[1:], (end, "")]) if then > first]
    if not marks or marks[0][0] > first:
        stages.insert(0, (first, "before" if marks else "whole"))
    for (begin, text), (after, _) in pairwise([*((t, s) for t, s in stages if t < end), (end, "")]):
        for sensor, samples in run.measurements.items():
            t = samples.t_ns * 1e-9
            here = (t >= begin) & (t <= after) & np.isfinite(samples.v)
            if here.any():
                v = samples.v[here]
                yield Row(text, sensor, run.units[f"meas/{sensor}"], float(v.mean()), index(t[here], v))
