"""One file on its way into the recording: its channels with their times, block by block, and all of its faults."""

from __future__ import annotations

import re
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from rig.errors import UsageError
from rig.printable import counted
from rig.record.imports.channel_map import Channel
from rig.record.imports.measurement_file import MeasurementFile
from rig.record.imports.text_table import BLOCK
from rig.record.imports.time_base import TimeBase
from rig.record.run_data import Integers, Reals

_TOLD = 20  # faults of a file that are listed; of more their number
_LOST = re.compile("there is no (value|time)$|the value is infinite$")
_OVERLOADS = (9.9e37, 9.91e37)  # infinity and NaN of instruments with commands of SCPI
FARTHEST = 9e9
"""Times in ns reach no farther [s]."""


@dataclass
class Part:
    """One file on its way into the recording."""

    file: MeasurementFile
    time: str
    scale: float
    """Unit of the column `time` [s]."""
    rate: float
    """Samples per second of columns that state none and have no time [Hz]; 0: none."""
    channels: list[Channel]
    skip_missing: bool
    shift: float = 0.0
    missing: int = 0
    expected: int = 0
    """Number of samples; of a text an estimate from its first part."""

    periods: dict[str, int] = field(default_factory=dict)
    """Column -> median distance of its first samples [ns]."""

    def begin(self) -> float:
        """Time of the first sample, with the shift [s]; notes the periods."""
        first = {c: t[np.isfinite(t)] for c, (t, _) in next(self._timed_or_refused()).items()}
        first = {c: t for c, t in first.items() if t.size}
        if not first:
            raise UsageError(f"{self.file.path}: column {self.time} has no time among its first values")
        self.periods = {c: _period_ns(t) for c, t in first.items()}
        return min(float(t[0]) for t in first.values()) + self.shift

    def blocks(self, base: TimeBase) -> Iterator[dict[str, tuple[Reals, Reals]]]:
        """Channel -> times [s] and values in SI, block by block. Raises UsageError with all faults of the file."""
        base.shift = self.shift
        row = self.file.first_row
        faults = Faults(self.file.path)
        last = dict[str, float]()
        for block in self._timed_or_refused():
            size = max(t.size for t, _ in block.values())
            if not self.expected:
                stated = self.file.columns[0].length is not None
                self.expected = size if stated else round(size * max(self.file.path.stat().st_size / BLOCK, 1.0))
            done = dict[str, tuple[Reals, Reals]]()
            for i, channel in enumerate(self.channels):
                rows = row + np.arange(block[channel.column][0].size)
                t, v = block[channel.column]
                if self.skip_missing:
                    timed = np.isfinite(t)
                    rows, t, v = rows[timed], t[timed], v[timed]
                    self.missing += timed.size - t.size
                if i == 0 or self.time == "" or self.skip_missing:
                    faults.times(t, last.get(channel.column, -np.inf), rows, self.time or channel.column)
                last[channel.column] = float(np.max(t, initial=last.get(channel.column, -np.inf), where=np.isfinite(t)))
                if i == 0 and t.size and not faults.count:
                    base.add(t)
                lost = ~np.isfinite(v)
                if self.skip_missing:
                    rows, t, v = rows[~lost], t[~lost], v[~lost]
                    self.missing += int(lost.sum())
                else:
                    faults.missing(v, rows, channel.column)
                scaled = channel.values(v)
                faults.infinite(np.isinf(scaled) & np.isfinite(v), rows, channel)
                done[channel.name] = t + self.shift, scaled
            row += size
            base.midnights = self.file.midnights(self.time) if self.time else 0
            if not faults.count:
                yield done
        (self._faults_of_rows() if faults.count and self.file.rows else faults).raised()
        faults.raised()

    def samples(self, column: str) -> tuple[Reals, Reals]:
        """All times and values of a column. Raises UsageError with the faults of the file."""
        pieces = [block[column] for block in self._timed_or_refused()]
        t, v = (np.concatenate(parts) for parts in zip(*pieces, strict=True))
        known = np.isfinite(t) & np.isfinite(v)
        if not known.all() and not self.skip_missing:
            for _ in self.blocks(TimeBase(self.file.path.name)):
                pass
        return t[known], v[known]

    def _timed_or_refused(self) -> Iterator[dict[str, tuple[Reals, Reals]]]:
        """`timed` for all channels. Raises UsageError with the faults of rows, and those of the values beside them."""
        columns = [channel.column for channel in self.channels]
        try:
            yield from self.timed(columns)
        except UsageError as fault:
            try:
                self._faults_of_rows().raised()
            except UsageError as more:
                raise UsageError(f"{fault}\n{more}") from None
            raise

    def _faults_of_rows(self) -> Faults:
        """The faults of times and values in a text, with the numbers of its lines, which may be blank between rows."""
        columns = [channel.column for channel in self.channels]
        faults = Faults(self.file.path)
        last = -np.inf
        for row, values in self.file.rows([self.time, *columns]) if self.file.rows else ():
            number = np.array([row])
            t = np.array([values.get(self.time, np.nan) * self.scale])
            if self.time in values and not (self.skip_missing and np.isnan(t[0])):
                faults.times(t, last, number, self.time)
                last = last if np.isnan(t[0]) else float(t[0])
            for column in () if self.skip_missing else columns:
                faults.missing(np.array([values.get(column, 0.0)]), number, column)
        return faults

    def timed(self, names: Sequence[str]) -> Iterator[dict[str, tuple[Reals, Reals]]]:
        """Column -> times [s] and values, block by block."""
        wanted = list(dict.fromkeys([*([self.time] if self.time else []), *names]))
        done = dict.fromkeys(wanted, 0)
        for block in self.file.blocks(wanted):
            timed = dict[str, tuple[Reals, Reals]]()
            for name in names:
                column = self.file.column(name)
                v = block[name]
                v = np.where(np.isin(np.abs(v), _OVERLOADS), np.inf, v)
                if self.time and not column.rate:
                    t = block[self.time] * self.scale
                    if t.size != v.size:
                        sizes = f"{name} has {counted(v.size, 'value')}, {self.time} has {t.size}"
                        raise UsageError(f"{self.file.path}: {sizes}: it is not the time of this column")
                else:
                    t = column.start + (done[name] + np.arange(v.size)) / (column.rate or self.rate)
                done[name] += v.size
                timed[name] = t, v
            yield timed


def _period_ns(t: Reals) -> int:
    """The median distance of times [ns]; 0 where there is none, or one that no recording has."""
    near = t[np.abs(t) <= FARTHEST]
    return round(float(np.median(np.diff(near))) * 1e9) if near.size > 1 else 0


class Faults:
    """What is wrong with the values of a file: the first ones with their rows, and how many."""

    def __init__(self, path: Path) -> None:
        self._path = path
        self._told = list[str]()
        self.count = 0

    def times(self, t: Reals, last: float, rows: Integers, name: str) -> None:
        """Note times that do not increase, are none, or lie too far from 0."""
        known = np.isfinite(t)
        latest = np.maximum.accumulate(np.where(known, np.arange(t.size), -1))  # place of the latest known time
        latest = np.concatenate(([-1], latest[:-1])) if t.size else latest
        before = np.where(latest < 0, last, t[latest]) if t.size else t
        for i in np.flatnonzero(~(t > before) | (np.abs(t) > FARTHEST)):
            if not known[i]:
                self._note(int(rows[i]), name, "there is no time")
                continue
            what = "is that of the row before" if t[i] == before[i] else "falls"
            if t[i] > before[i]:
                what = f"lies beyond {FARTHEST:g} s; state its unit"
            self._note(int(rows[i]), name, f"the time {t[i]:.9g} s {what}")

    def missing(self, v: Reals, rows: Integers, name: str) -> None:
        """Note values that are not there, or are infinite."""
        for i in np.flatnonzero(~np.isfinite(v)):
            self._note(int(rows[i]), name, "there is no value" if np.isnan(v[i]) else "the value is infinite")

    def infinite(self, lost: NDArray[np.bool_], rows: Integers, channel: Channel) -> None:
        """Note values that are too large in SI."""
        for i in np.flatnonzero(lost):
            self._note(int(rows[i]), channel.column, f"too large for a double in {channel.unit}")

    def _note(self, row: int, name: str, what: str) -> None:
        self.count += 1
        if self.count <= _TOLD:
            self._told.append(f"{self._path}: row {row}, column {name}: {what}")

    def raised(self) -> None:
        """Raise UsageError if there are any."""
        if self.count:
            more = [f"{self._path}: {self.count - _TOLD} more"] if self.count > _TOLD else []
            hints = ["--skip-missing leaves them out" * any(_LOST.search(told) for told in self._told)]
            hints += ["--rate RATE takes no times from the file" * any("the time" in told for told in self._told)]
            raise UsageError("\n".join([*self._told, *more, *filter(None, hints)]))
