"""One file on its way into the recording: its channels with their times, block by block, and all of its faults."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field

import numpy as np

from rig.errors import UsageError
from rig.printable import counted
from rig.record.imports.channel_map import Channel
from rig.record.imports.columns import MeasurementFile
from rig.record.imports.row_faults import CLOSE, FALLS, INFINITE, NO_TIME, NO_VALUE, REPEATS, RowFaults
from rig.record.imports.text_table import BLOCK
from rig.record.imports.time_base import TimeBase, rounding
from rig.record.run_data import Integers, Reals

# Infinity and NaN of instruments with commands of SCPI; what netCDF has where nothing was written
_OVERLOADS = (9.9e37, 9.91e37, 9.969209968386869e36)
FARTHEST = 9e9
"""Times in ns reach no farther from the first one [s]."""
_CLOSEST = 0.999e-9  # s: times become whole ns. 0.1 % for the digits of a double. chosen
_LATEST = 1e11  # times in a file reach no farther from 0 [s]: 3000 years. chosen


@dataclass
class Part:
    """One file on its way into the recording."""

    file: MeasurementFile
    time: str
    scale: float
    """Unit of the column `time` [s]."""
    rate: float
    """Samples per second, in place of what the file states [Hz]; 0: none."""
    channels: list[Channel]
    skip_missing: bool
    shift: float = 0.0
    missing: int = 0
    expected: int = 0
    """Number of samples; of a text an estimate from its first part."""

    origin: float | None = None
    """First value of the column `time`, from which times are counted: whole ms since 1970 stay exact."""
    rounding: float = 0.0
    """Distance of two doubles beside the times of the latest block [s]."""
    periods: dict[str, int] = field(default_factory=dict)
    """Column -> median distance of its first samples [ns]."""

    @property
    def origin_s(self) -> float:
        """Time in the file from which times are counted [s]."""
        return float(self.origin or 0.0) * self.scale

    def begin(self) -> float:
        """Time of the first sample from `origin` on, with the shift [s]; notes the periods."""
        first = {c: t[np.isfinite(t)] for c, (t, _) in next(self._timed_or_refused()).items()}
        first = {c: t for c, t in first.items() if t.size}
        if not first:
            raise UsageError(f"{self.file.path}: column {self.time} has no time among its first values")
        self.periods = {c: _period_ns(t) for c, t in first.items()}
        return min(float(t[0]) for t in first.values()) + self.shift

    def blocks(self, base: TimeBase) -> Iterator[dict[str, tuple[Reals, Reals]]]:
        """Channel -> times [s] and values in SI, block by block. Raises UsageError with all faults of the file."""
        row = self.file.first_row
        faults = RowFaults(self.file.path)
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
                    latest = last.get(channel.column, -np.inf)
                    _note_times(faults, t, latest, rows, self.time or channel.column, self.origin_s)
                last[channel.column] = float(np.max(t, initial=last.get(channel.column, -np.inf), where=np.isfinite(t)))
                if i == 0 and t.size and not faults:
                    base.add(t)
                lost = ~np.isfinite(v)
                if self.skip_missing:
                    rows, t, v = rows[~lost], t[~lost], v[~lost]
                    self.missing += int(lost.sum())
                else:
                    _note_missing(faults, v, rows, channel.column)
                scaled = channel.values(v)
                large = np.isinf(scaled) & np.isfinite(v)
                faults.note(rows[large], channel.column, f"too large for a double in {channel.unit}")
                done[channel.name] = t + self.shift, scaled
            row += size
            base.origin = self.origin_s
            base.rounding = max(base.rounding, self.rounding)
            base.midnights = self.file.midnights(self.time) if self.time else 0
            if not faults:
                yield done
        (self._faults_of_rows() if faults and self.file.rows else faults).raised()
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
                lines = dict.fromkeys([*str(fault).split("\n"), *str(more).split("\n")])  # both may tell one remedy
                raise UsageError("\n".join(lines)) from None
            raise

    def _faults_of_rows(self) -> RowFaults:
        """The faults of times and values in a text, with the numbers of its lines, which may be blank between rows."""
        columns = [channel.column for channel in self.channels]
        faults = RowFaults(self.file.path)
        last = -np.inf
        for row, values in self.file.rows([self.time, *columns]) if self.file.rows else ():
            number = np.array([row])
            t = self._from_origin(np.array([values.get(self.time, np.nan)]))
            if self.time in values and not (self.skip_missing and np.isnan(t[0])):
                _note_times(faults, t, last, number, self.time, self.origin_s)
                last = last if np.isnan(t[0]) else float(t[0])
            for column in () if self.skip_missing else columns:
                _note_missing(faults, np.array([values.get(column, 0.0)]), number, column)
        return faults

    def _from_origin(self, values: Reals) -> Reals:
        """Times [s] from the first one of the file on."""
        known = values[np.isfinite(values)]
        if self.origin is None and known.size:
            self.origin = known[0]
        with np.errstate(over="ignore"):  # told as a time that lies too far
            return np.asarray((values - (self.origin or 0)) * self.scale, np.float64)

    def timed(self, names: Sequence[str]) -> Iterator[dict[str, tuple[Reals, Reals]]]:
        """Column -> times [s] and values, block by block."""
        wanted = list(dict.fromkeys([*([self.time] if self.time else []), *names]))
        done = dict.fromkeys(wanted, 0)
        for block in self.file.blocks(wanted):
            if self.time:
                t_file = self._from_origin(block[self.time])
                self.rounding = rounding(block[self.time]) * self.scale
            timed = dict[str, tuple[Reals, Reals]]()
            for name in names:
                column = self.file.column(name)
                v = block[name]
                v = np.where(np.isin(np.abs(v), _OVERLOADS), np.inf, v)
                if self.time and not column.rate and not self.rate:
                    t = t_file
                    if t.size != v.size:
                        sizes = f"{name} has {counted(v.size, 'value')}, {self.time} has {t.size}"
                        raise UsageError(f"{self.file.path}: {sizes}: it is not the time of this column")
                else:
                    t = column.start + (done[name] + np.arange(v.size)) / (self.rate or column.rate)
                done[name] += v.size
                timed[name] = t, v
            yield timed


def _period_ns(t: Reals) -> int:
    """The median distance of times [ns]; 0 where there is none, or one that no recording has."""
    near = t[np.abs(t) <= FARTHEST]
    return round(float(np.median(np.diff(near))) * 1e9) if near.size > 1 else 0


def _note_times(faults: RowFaults, t: Reals, last: float, rows: Integers, name: str, origin: float) -> None:
    """Note times after `origin` [s] that do not increase from `last` on, are none, or lie too far away."""
    known = np.isfinite(t)
    latest = np.maximum.accumulate(np.where(known, np.arange(t.size), -1))  # place of the latest known time
    latest = np.concatenate(([-1], latest[:-1])) if t.size else latest
    before = np.where(latest < 0, last, t[latest]) if t.size else t
    rises = t > before
    kinds = {
        REPEATS: known & (t == before),
        FALLS: known & (t < before),
        CLOSE: known & rises & (t - before < _CLOSEST),
        f"lies beyond {_LATEST:g} s; state its unit": known & rises & (np.abs(t + origin) > _LATEST),
        f"lies more than {FARTHEST:g} s after the first one": known & rises & (t > FARTHEST),
    }
    faults.note(rows[~known], name, NO_TIME)
    for kind, wrong in kinds.items():
        if wrong.any():
            faults.note(rows[wrong], name, kind, f"the time {t[wrong][0] + origin:.9g} s {kind}")


def _note_missing(faults: RowFaults, v: Reals, rows: Integers, name: str) -> None:
    """Note values that are not there, or are infinite."""
    faults.note(rows[np.isnan(v)], name, NO_VALUE)
    faults.note(rows[np.isinf(v)], name, INFINITE)
