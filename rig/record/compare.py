"""Where two runs part, to the bit: plant truth, measurements and commands."""

from __future__ import annotations

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
    """The first place at which a signal of two runs differs."""

    topic: str
    index: int
    time: float
    """s"""
    first: float
    second: float
    """NaN where one run has ended."""

    def __str__(self) -> str:
        return (
            f"{self.topic} differs at sample {self.index}, t = {self.time:.9g} s: {self.first!r} and {self.second!r} "
            f"(bits {_bits(self.first):016x} and {_bits(self.second):016x})"
        )


@dataclass(frozen=True)
class Comparison:
    """What the comparison of two runs found."""

    compared: int
    """Numbers compared."""
    differences: tuple[Difference, ...]
    """The first difference of each signal that has one, earliest first."""
    missing: tuple[str, ...]
    """Signals that only one of the runs has."""

    @property
    def identical(self) -> bool:
        """Whether both runs hold the same signals, byte for byte."""
        return not self.differences and not self.missing


class Series(NamedTuple):
    """Numbers and the instants they belong to."""

    t_ns: Integers
    values: Reals


def compare(first: Run | Path, second: Run | Path) -> Comparison:
    """Compare two runs, or recordings of runs, signal by signal, bit by bit."""
    one, two = (dict(_series(run if isinstance(run, Run) else read(run))) for run in (first, second))
    shared = [topic for topic in one if topic in two]
    found = [difference for topic in shared if (difference := _first(topic, one[topic], two[topic]))]
    return Comparison(
        compared=sum(min(one[topic].values.size, two[topic].values.size) for topic in shared),
        differences=tuple(sorted(found, key=lambda difference: difference.time)),
        missing=tuple(sorted(one.keys() ^ two.keys())),
    )


def _series(run: Run) -> Iterator[tuple[str, Series]]:
    time_ns = np.rint(run.time * 1e9).astype(np.int64)
    for name, v in run.signals.items():
        yield name, Series(time_ns, v)
    for name, (t_ns, v) in run.measurements.items():
        yield f"meas/{name}", Series(t_ns, v)
    for name, commands in run.commands.items():
        for drive in range(commands.values.shape[1]):
            yield (
                f"applied/{name}[{drive}]",
                Series(commands.tick * run.frame_ns, np.ascontiguousarray(commands.values[:, drive])),
            )


def _first(topic: str, one: Series, two: Series) -> Difference | None:
    shared = min(one.values.size, two.values.size)
    apart = (_raw(one.values[:shared]) != _raw(two.values[:shared])) | (one.t_ns[:shared] != two.t_ns[:shared])
    if apart.any():
        index = int(np.argmax(apart))
    elif one.values.size == two.values.size:
        return None
    else:
        index = shared
    times = [series.t_ns[index] for series in (one, two) if index < series.t_ns.size]
    first, second = (float(s.values[index]) if index < s.values.size else float("nan") for s in (one, two))
    return Difference(topic, index, float(min(times)) * 1e-9, first, second)


def _raw(values: Reals) -> NDArray[np.uint64]:
    return np.ascontiguousarray(values, np.float64).view(np.uint64)


def _bits(value: float) -> int:
    return int(np.float64(value).view(np.uint64))
