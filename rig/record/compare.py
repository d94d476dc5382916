"""Comparison of two runs, bit by bit and by their largest deviation: plant outputs, measurements and commands.

Signals are compared at the instants that both runs have. These may differ: one way of running records outputs at every
step, another once a frame. Samples of only one run are counted.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from rig.record.reader import open as read
from rig.record.run import Integers, Reals, Run


@dataclass(frozen=True)
class Difference:
    """How a channel of two runs differs: the first place, and the largest deviation."""

    topic: str
    index: int
    """Index of the sample in the first run that has it."""
    time: float
    """s"""
    first: float
    second: float
    """NaN if a run has no sample at this instant."""
    shared: int
    """Number of instants that both runs have."""
    differing: int
    """Number of these that differ."""
    alone: tuple[int, int]
    """Samples at instants that the other run does not have."""
    beyond: int
    """Number of these before the first or after the last common instant: there only one run has samples."""
    deviation: float
    """Largest deviation at a common instant, as a share of the range of the first run; 0 without any, inf for NaN."""
    worst: float
    """Time of the largest deviation [s]."""

    @property
    def equal(self) -> bool:
        """Whether all common instants have the same bits, and no instant outside of the common time span is there."""
        return not self.differing and not self.beyond

    def within(self, tolerance: float) -> bool:
        """Whether no deviation exceeds `tolerance`, and no instant outside of the common time span is there."""
        return self.deviation <= tolerance and not self.beyond

    def __str__(self) -> str:
        if not self.differing:
            return f"{self.topic} agrees at all {self.shared} instants that both have; {self._alone()}"
        return (
            f"{self.topic} differs at sample {self.index}, t = {self.time:.9g} s: {self.first!r} and {self.second!r} "
            f"(bits {_bits(self.first):016x} and {_bits(self.second):016x}); {self.differing} of the {self.shared} "
            f"instants that both have differ{self._alone('; ')}"
        )

    def _alone(self, before: str = "") -> str:
        counts = [f"{count} more in the {name} only" for count, name in zip(self.alone, ("first", "second")) if count]
        if not counts:
            return ""
        where = "" if self.differing else f", from t = {self.time:.9g} s on"
        return f"{before}{' and '.join(counts)}{where}"


@dataclass(frozen=True)
class Comparison:
    """The result of a comparison of two runs."""

    compared: int
    """Number of compared values: those at common instants."""
    signals: tuple[Difference, ...]
    """Every channel that both runs have, in the order of the first run."""
    missing: tuple[str, ...]
    """Signals that only one of the runs has."""

    @property
    def differences(self) -> tuple[Difference, ...]:
        """The channels with a difference, those that differ first in time before others."""
        differing = (signal for signal in self.signals if signal.differing or any(signal.alone))
        return tuple(sorted(differing, key=lambda signal: signal.time))

    @property
    def identical(self) -> bool:
        """Whether both runs have the same channels at the same instants, byte for byte."""
        return not self.differences and not self.missing

    @property
    def agree(self) -> bool:
        """Whether both runs agree at all common instants: one may only have samples between those of the other."""
        return not self.missing and all(signal.equal for signal in self.signals)

    def within(self, tolerance: float) -> bool:
        """Whether both runs have the same channels, and no deviation exceeds `tolerance` (a share of the range)."""
        return not self.missing and all(signal.within(tolerance) for signal in self.signals)


class Series(NamedTuple):
    """Numbers and the instants they belong to."""

    t_ns: Integers
    values: Reals


def compare(first: Run | Path, second: Run | Path, begin: float = 0.0, end: float = math.inf) -> Comparison:
    """Compare two runs, or recordings of runs, channel by channel, from `begin` to `end` [s]."""
    first_series = series_of(first if isinstance(first, Run) else read(first), begin, end)
    second_series = series_of(second if isinstance(second, Run) else read(second), begin, end)
    both = [topic for topic in first_series if topic in second_series]
    differences = tuple(_first(topic, first_series[topic], second_series[topic]) for topic in both)
    compared = sum(difference.shared for difference in differences)
    missing = sorted(first_series.keys() ^ second_series.keys())
    return Comparison(compared, differences, tuple(missing))


def series_of(run: Run, begin: float, end: float) -> dict[str, Series]:
    """Every channel of a run from `begin` to `end` [s]: outputs, meas/SENSOR, applied/CONTROLLER[actuator]."""
    channels: dict[str, Series] = {}
    for topic, series in _whole(run):
        here = (series.t_ns >= begin * 1e9 - 0.5) & (series.t_ns <= end * 1e9 + 0.5)
        channels[topic] = series if here.all() else Series(series.t_ns[here], series.values[here])
    return channels


def _whole(run: Run) -> Iterator[tuple[str, Series]]:
    for name in run.signals:
        yield name, Series(*run.recorded(name))
    for name, samples in run.measurements.items():
        yield f"meas/{name}", Series(*samples)
    for name, commands in run.commands.items():
        for drive, values in enumerate(commands.values.T):
            yield f"applied/{name}[{drive}]", Series(commands.tick * run.frame_ns, np.ascontiguousarray(values))


def common_instants(first: Integers, second: Integers) -> tuple[Integers, Integers, Integers]:
    """Return the instants [ns] that both of two runs have, each once, and their indices in the first and the second."""
    once = bool(np.all(np.diff(first) > 0) and np.all(np.diff(second) > 0))
    return np.intersect1d(first, second, assume_unique=once, return_indices=True)


def _first(topic: str, of_first: Series, of_second: Series) -> Difference:
    """The first difference at a common instant; else the first instant that only one run has."""
    shared, at_one, at_two = common_instants(of_first.t_ns, of_second.t_ns)
    apart = _raw(of_first.values[at_one]) != _raw(of_second.values[at_two])
    deviation, worst = _deviation(of_first.values[at_one], of_second.values[at_two], apart)
    alone = (of_first.values.size - shared.size, of_second.values.size - shared.size)
    low, high = (shared[0], shared[-1]) if shared.size else (1, 0)
    beyond = 0
    for t_ns in (of_first.t_ns, of_second.t_ns):
        beyond += int(np.count_nonzero((t_ns < low) | (t_ns > high)))
    time = float(shared[worst]) * 1e-9 if shared.size else math.nan
    counts = (int(shared.size), int(np.count_nonzero(apart)), alone, beyond, deviation, time)
    if apart.any():
        row = int(np.argmax(apart))
        first = float(of_first.values[at_one[row]])
        second = float(of_second.values[at_two[row]])
        return Difference(topic, int(at_one[row]), float(shared[row]) * 1e-9, first, second, *counts)
    lone = []
    for which, series, common in ((0, of_first, at_one), (1, of_second, at_two)):
        rows = np.setdiff1d(np.arange(series.t_ns.size), common, assume_unique=True)
        if rows.size:
            index = int(rows[0])
            lone.append((int(series.t_ns[index]), index, which, float(series.values[index])))
    values = [math.nan, math.nan]
    if not lone:
        return Difference(topic, 0, 0.0, values[0], values[1], *counts)
    first_ns, index, which, value = min(lone)
    values[which] = value
    return Difference(topic, index, first_ns * 1e-9, values[0], values[1], *counts)


def _deviation(reference: Reals, other: Reals, apart: NDArray[np.bool_]) -> tuple[float, int]:
    """The largest deviation as a share of the range of `reference` (of its size, if it is constant), and its index."""
    if not apart.any():
        return 0.0, 0
    away = np.where(apart, np.abs(reference - other), 0.0)
    away[apart & ~np.isfinite(away)] = np.inf
    known = reference[np.isfinite(reference)]
    scale = float(np.ptp(known) or np.abs(known).max()) if known.size else 0.0
    worst = int(np.argmax(away))
    largest = float(away[worst])
    if scale and largest:
        return largest / scale, worst
    return (math.inf if largest else 0.0), worst


def _raw(values: Reals) -> NDArray[np.uint64]:
    return np.ascontiguousarray(values, np.float64).view(np.uint64)


def _bits(value: float) -> int:
    return int(np.float64(value).view(np.uint64))
