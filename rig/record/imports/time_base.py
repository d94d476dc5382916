"""The times of one file of a measurement: rate, gaps, unevenness and drift."""

from __future__ import annotations

from dataclasses import asdict, dataclass

import numpy as np

from rig.printable import counted
from rig.record.run_data import Reals

_GAP = 1.5  # periods: a longer distance of two samples is a gap
_EVEN = 0.01  # of a period
_WHOLE = 2.0**53  # below, a double holds each whole number
_COARSE = 1e-4  # of a period: a larger distance of two doubles beside the last time is told. chosen


def rounding(values: Reals) -> float:
    """Distance of two doubles beside the largest of these values; 0 if all of them are whole numbers."""
    known = values[np.isfinite(values)]
    if known.dtype.kind == "i" or not known.size:
        return 0.0
    largest = float(np.abs(known).max())
    whole = largest < _WHOLE and np.array_equal(known, np.rint(known))
    return 0.0 if whole else float(np.spacing(largest))


@dataclass
class TimeBase:
    """The times of one file: samples, mean period, gaps and unevenness."""

    file: str
    samples: int = 0
    origin: float = 0.0
    """Time in the file from which the others are counted [s]."""
    begin: float = 0.0
    """Time of the first sample, from `origin` on [s]."""
    period: float = 0.0
    """Median of the distances of samples in the first block [s]."""
    last: float = 0.0
    """Time of the latest sample, from `origin` on [s]."""
    rounding: float = 0.0
    """Distance of two doubles beside the times of the file [s]; 0: whole numbers state them."""
    gaps: int = 0
    longest: float = 0.0
    """Longest gap [s]."""
    lost: float = 0.0
    """Duration of all gaps [s]."""
    uneven: float = 0.0
    """Largest deviation of a distance, of those that are no gap, from the period, in periods."""
    drift: float = 0.0
    """Relative change of the mean period from the first quarter of the first block to the last one of the latest."""
    midnights: int = 0
    """How often times of day without a date passed midnight."""
    shift: float = 0.0
    """Added to the times of the file to join it to the first one [s]."""
    _first: float = 0.0
    _quarter: int = 1
    """Number of distances in the last quarter of the latest block."""

    def add(self, t: Reals) -> None:
        """Take the next times [s], which increase."""
        if not self.samples:
            self.begin = float(t[0])
            self.period = float(np.median(np.diff(t))) if t.size > 1 else 0.0
        steps = np.diff(t, prepend=self.last) if self.samples else np.diff(t)
        self.samples += t.size
        self.last = float(t[-1])
        if not steps.size or not self.period:
            return
        far = steps > _GAP * self.period
        self.gaps += int(far.sum())
        self.lost += float(steps[far].sum())
        self.longest = max(self.longest, float(steps[far].max(initial=0.0)))
        near = steps[~far]
        if near.size:
            self.uneven = max(self.uneven, float(np.abs(near - self.period).max()) / self.period)
            self._quarter = max(near.size // 4, 1)
            self._first = self._first or float(near[: self._quarter].mean())
            self.drift = float(near[-self._quarter :].mean()) / self._first - 1.0

    def to_json(self) -> dict[str, object]:
        """The same as plain values, with begin and end as the file states them."""
        told = {key: value for key, value in asdict(self).items() if key[0] != "_"}
        return {**told, "begin": self.begin + self.origin, "last": self.last + self.origin}

    def text(self) -> str:
        """The time base in words."""
        whole = self.last - self.begin - self.lost
        count = self.samples - 1 - self.gaps  # times may be rounded: the mean
        rate = f", {count / whole:.6g} Hz" if count > 0 and whole > 0.0 else ""
        begin = self.begin + self.origin
        last = self.last + self.origin
        told = f"{self.file}: {counted(self.samples, 'sample')}{rate}, t = {begin:g} to {last:g} s"
        told += f"; moved by {self.shift:.9g} s" if self.shift else ""
        if self.midnights:
            told += f"; the times of day have no date and pass midnight {counted(self.midnights, 'time')}"
        if self.rounding > _COARSE * self.period > 0.0:
            told += f"; so far from 0 the times are rounded to {self.rounding:.2g} s, the digits of a double"
        if self.gaps:
            told += f"; {counted(self.gaps, 'gap')}, the longest {self.longest:.6g} s"
        if self.uneven > _EVEN:
            told += f"; uneven: a distance differs from the period by {100.0 * self.uneven:.3g} %"
        if abs(self.drift) > max(1e-6, 2.0 * self.uneven / self._quarter):  # more than rounding of the times
            told += f"; the period drifts by {1e6 * self.drift:.3g} ppm"
        return told
