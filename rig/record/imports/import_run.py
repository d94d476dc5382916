"""Measurements become a recording without a plant: their channels are sensors, in SI units, from time 0 on.

Files are read and written block by block. Several files of one run get a common time: by a trigger, or by a channel
that all of them contain. The recording appears under its name when it is complete.
"""

from __future__ import annotations

import hashlib
import os
import re
from collections.abc import Callable, Iterator, Sequence
from contextlib import suppress
from dataclasses import asdict, dataclass, field
from datetime import UTC, datetime
from itertools import pairwise
from pathlib import Path
from typing import ClassVar

import numpy as np
from numpy.typing import NDArray

from rig.bus import encode, run_setup
from rig.errors import OutputError, UsageError
from rig.printable import counted
from rig.quantities import Condition, finite
from rig.record.imports.channel_map import Channel, ChannelMap, proposed, stated_fault
from rig.record.imports.measurement_file import MeasurementFile, opened
from rig.record.imports.text_table import BLOCK
from rig.record.provenance import package_version
from rig.record.run_data import Integers, Reals
from rig.record.writer import Writer
from rig.results import Result

_SLICE_NS = 250_000_000  # of a message. chosen
# Fewest and most samples of a message. chosen: 32 to 512 KiB
_LEAST = 4096
_MOST = 1 << 16
_GAP = 1.5  # periods: a longer distance of two samples is a gap
_EVEN = 0.01  # of a period
_TOLD = 20  # faults of a file that are listed; of more their number
_SPARSE = 8.0  # periods for each sample: with more the shift of a channel is not looked for. chosen
_LOST = re.compile("there is no (value|time)$|the value is infinite$")
_FARTHEST = 9e9  # s: times in ns reach no farther
_ALIKE = 0.5  # least correlation of a channel that two files have in common
FRAME_NS = 1_000_000
"""Period at which a replay publishes a measurement, and a controller is asked."""
MADE = "measured"
"""How the recording of a measurement was made, in its metadata."""


@dataclass
class TimeBase:
    """The times of one file: samples, mean period, gaps and unevenness."""

    file: str
    samples: int = 0
    begin: float = 0.0
    """Time of the first sample, as the file states it [s]."""
    period: float = 0.0
    """Median of the distances of samples in the first block [s]."""
    last: float = 0.0
    """Time of the latest sample [s]."""
    gaps: int = 0
    longest: float = 0.0
    """Longest gap [s]."""
    lost: float = 0.0
    """Duration of all gaps [s]."""
    uneven: float = 0.0
    """Largest deviation of a distance, of those that are no gap, from the period, in periods."""
    drift: float = 0.0
    """Relative change of the mean period from the first quarter of the first block to the last one of the latest."""
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
        """The same as plain values."""
        return {key: value for key, value in asdict(self).items() if key[0] != "_"}

    def text(self) -> str:
        """The time base in words."""
        whole = self.last - self.begin - self.lost
        count = self.samples - 1 - self.gaps  # times may be rounded: the mean
        rate = f", {count / whole:.6g} Hz" if count > 0 and whole > 0.0 else ""
        told = f"{self.file}: {counted(self.samples, 'sample')}{rate}, t = {self.begin:g} to {self.last:g} s"
        told += f"; moved by {self.shift:.9g} s" if self.shift else ""
        if self.gaps:
            told += f"; {counted(self.gaps, 'gap')}, the longest {self.longest:.6g} s"
        if self.uneven > _EVEN:
            told += f"; uneven: a distance differs from the period by {100.0 * self.uneven:.3g} %"
        if abs(self.drift) > max(1e-6, 2.0 * self.uneven / self._quarter):  # more than rounding of the times
            told += f"; the period drifts by {1e6 * self.drift:.3g} ppm"
        return told


@dataclass
class Imported(Result):
    """A measurement that was imported. `ranges`: channel -> unit, lowest and highest value."""

    FIGURE: ClassVar[str] = "rig.view.run_figure:figure_of_import"
    path: Path
    channels: dict[str, str]
    """Channel -> file and column."""
    ranges: dict[str, tuple[str, float, float]]
    bases: list[TimeBase] = field(default_factory=list)
    missing: int = 0
    """Number of values that were left out because there was none."""

    def text(self) -> str:
        """Channels with ranges, and the time bases."""
        rows = [f"{self.path}: {counted(len(self.channels), 'channel')}"]
        for name, source in self.channels.items():
            unit, low, high = self.ranges[name]
            rows.append(f"  {name:<20} {_span(low, high)} {'' if unit == '1' else unit}  from {source}".rstrip())
        rows += [f"  {base.text()}" for base in self.bases]
        if self.missing:
            rows.append(f"  {counted(self.missing, 'missing value')} left out")
        return "\n".join(rows)

    def to_json(self) -> dict[str, object]:
        """The same as plain values."""
        bases = [base.to_json() for base in self.bases]
        return {
            "path": str(self.path),
            "channels": self.channels,
            "ranges": self.ranges,
            "time": bases,
            "missing": self.missing,
        }


def _span(low: float, high: float) -> str:
    """The lowest and the highest value in words; a column may have none."""
    return f"{low:.6g} .. {high:.6g}" if low <= high else "no values,"


@dataclass
class Listed:
    """The columns of measurement files, and a map that is proposed for them."""

    rows: list[tuple[str, str, str, float, float, int, float]]
    """File, column, unit, lowest and highest value, number of values, samples per second (0: not stated) [Hz]."""
    left_out: list[tuple[str, str, str]]
    """File, column, and why it is not read."""
    bases: list[TimeBase]
    proposal: ChannelMap

    def text(self) -> str:
        """A line for each column, the time bases, and the proposal as TOML."""
        names = [row[1] for row in self.rows] + [name for _, name, _ in self.left_out]
        width = max(map(len, names))
        lines = []
        for file, name, unit, low, high, count, rate in self.rows:
            at = f" at {rate:.6g} Hz" if rate > 0.0 else ""
            values = f"{_span(low, high)} {unit or '(no unit stated)'}, {counted(count, 'value')}{at}"
            fault = f"; {told}" if unit and (told := stated_fault(unit)) else ""
            lines.append(f"{file}: {name:<{width}}  {values}{fault}")
        lines += [f"{file}: {name:<{width}}  not read: {why}" for file, name, why in self.left_out]
        lines += [base.text() for base in self.bases]
        proposal = self.proposal.text()
        ask = "; replace each ? by the unit" if "?" in proposal else ""
        lines += ["", f"a map for these columns (import.toml beside the files){ask}:", "", proposal]
        return "\n".join(lines)

    def to_json(self) -> dict[str, object]:
        """The same as plain values."""
        proposal = {"time": self.proposal.time, "rate": self.proposal.rate, "channels": dict(self.proposal.channels)}
        return {"columns": self.rows, "left_out": self.left_out, "proposal": proposal}


def listed(paths: Sequence[Path]) -> Listed:
    """Read the files through and propose a map. Raises UsageError with the faults of all of them."""
    rows = []
    left_out = []
    bases = []
    together = ChannelMap()
    for file in _all_opened(paths):
        names = [column.name for column in file.columns]
        low = dict.fromkeys(names, np.inf)
        high = dict.fromkeys(names, -np.inf)
        count = dict.fromkeys(names, 0)
        last = dict.fromkeys(names, -np.inf)
        rising = set(names)
        times: dict[str, TimeBase] = {name: TimeBase(file.path.name) for name in names}
        for block in file.blocks(names):
            for name, v in block.items():
                known = v[np.isfinite(v)]
                if not v.size:
                    continue
                count[name] += known.size
                low[name] = min(low[name], known.min(initial=np.inf))
                high[name] = max(high[name], known.max(initial=-np.inf))
                if name in rising and known.size and known[0] > last[name] and np.all(known[1:] > known[:-1]):
                    with np.errstate(over="ignore"):  # a column that rises may be no time
                        times[name].add(known)
                    last[name] = known[-1]
                elif known.size:
                    rising.discard(name)
        for column in file.columns:
            name = column.name
            ends = (float(low[name]), float(high[name]))
            rows.append((file.path.name, name, column.unit, *ends, count[name], column.rate))
        left_out += [(file.path.name, name, why) for name, why in file.left_out.items()]
        proposal = proposed(file, [name for name in names if name in rising and times[name].samples > 1])
        time = proposal.time.partition(",")[0]
        bases += [times[time]] if time else []
        together = ChannelMap(
            {**together.channels, **proposal.channels}, together.time or proposal.time, together.rate or proposal.rate
        )
    return Listed(rows, left_out, bases, together)


def import_files(
    paths: Sequence[Path],
    out: Path,
    given: ChannelMap,
    join: str = "",
    skip_missing: bool = False,
    replace: bool = False,
    progress: Callable[[int, int], object] = lambda done, total: None,
) -> Imported:
    """Write the recording `out` of the measurement in `paths`; several files are one run.

    `join`: a condition, "trigger > 2 V", whose first sample is the same instant in all files, or a channel that all
    files contain. `skip_missing`: values that are not there (empty or NaN) are left out. `progress` gets the number of
    samples that are done, and of all. Raises UsageError with all faults of the files, OutputError if `out` cannot be
    written; then nothing is written.
    """
    files = _all_opened(paths)
    if len(files) > 1 and not join:
        raise UsageError(
            'several files of one run need a common time: add --join "CHANNEL > VALUE UNIT" (a trigger) or '
            "--join CHANNEL (one that all files contain); import separate runs one by one"
        )
    parts = _parts(files, given, join, skip_missing)
    if join:
        _join(parts, join)
    if out.exists() and not replace:
        raise UsageError(f"{out} exists; name another file, or add --force to replace it")
    begin = min(part.begin() for part in parts)
    draft = out.with_name(f".{out.name}.{os.getpid()}.part")
    try:
        result = _written(parts, draft, out, given, begin, progress)
        try:
            draft.replace(out)
        except OSError as fault:
            raise OutputError(f"{out} cannot be written: {fault.strerror}") from None
    finally:
        with suppress(OSError):
            draft.unlink(missing_ok=True)
    return result


def _all_opened(paths: Sequence[Path]) -> list[MeasurementFile]:
    files = list[MeasurementFile]()
    faults = list[str]()
    for path in paths:
        try:
            files.append(opened(path))
        except UsageError as fault:
            faults.append(str(fault))
    if faults:
        raise UsageError("\n".join(faults))
    return files


@dataclass
class _Part:
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
        faults = _Faults(self.file.path)
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

    def _faults_of_rows(self) -> _Faults:
        """The faults of times and values in a text, with the numbers of its lines, which may be blank between rows."""
        columns = [channel.column for channel in self.channels]
        faults = _Faults(self.file.path)
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
    near = t[np.abs(t) <= _FARTHEST]
    return round(float(np.median(np.diff(near))) * 1e9) if near.size > 1 else 0


class _Faults:
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
        for i in np.flatnonzero(~(t > before) | (np.abs(t) > _FARTHEST)):
            if not known[i]:
                self._note(int(rows[i]), name, "there is no time")
                continue
            what = "is that of the row before" if t[i] == before[i] else "falls"
            if t[i] > before[i]:
                what = f"lies beyond {_FARTHEST:g} s; state its unit"
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


def _parts(files: Sequence[MeasurementFile], given: ChannelMap, join: str, skip_missing: bool) -> list[_Part]:
    """What each file becomes. Raises UsageError with the faults of all of them."""
    if not given.channels:
        raise UsageError('no channel is named: add --map "COLUMN = NAME, UNIT"; without it the columns are listed')
    parts = list[_Part]()
    faults = list[str]()
    met = set[str]()
    try:
        rate = finite(given.rate, "Hz") if given.rate else 0.0
    except ValueError as fault:
        raise UsageError(f"--rate {given.rate}: {fault}") from None
    if given.rate and rate <= 0.0:
        raise UsageError(f"--rate {given.rate}: expected more than 0 Hz")
    for file in files:
        where = str(file.path)
        own = {column.name for column in file.columns} | file.left_out.keys()
        mine = given.channels if len(files) == 1 else {c: text for c, text in given.channels.items() if c in own}
        met |= mine.keys()
        try:
            made = ChannelMap(mine).channels_of(file.columns, where, file.left_out)
            time, scale = given.time_column(file.columns, where, file.left_out) if not rate else ("", 1.0)
            untimed = [c.column for c in made if not (time or rate or file.column(c.column).rate)]
            if untimed:
                raise UsageError(f'{where}: no time for {", ".join(untimed)}: add --time "COLUMN, s" or --rate "2 kHz"')
            if not made:
                raise UsageError(f"{where}: the map names none of its columns: {', '.join(sorted(own))}")
            parts.append(_Part(file, time, scale, rate, made, skip_missing))
        except UsageError as fault:
            faults.append(str(fault))
    if len(files) > 1:
        faults += [f"no file has a column {column!r}" for column in given.channels if column not in met]
    if faults:
        raise UsageError("\n".join(faults))
    return parts


def _join(parts: Sequence[_Part], join: str) -> None:
    """Shift the times of all files but the first one to the common time."""
    condition = Condition.read(join, "--join", "<>|", "CHANNEL > VALUE UNIT") if any(s in join for s in "<>") else None
    name = condition.name if condition is not None else join.strip()
    whole = []
    for part in parts:
        channel = next((c for c in part.channels if name in (c.name, c.column)), None)
        if channel is None:
            raise UsageError(f"--join {join}: {part.file.path} has no channel {name}")
        t, v = part.samples(channel.column)
        if t.size < 2:
            raise UsageError(f"--join {join}: {part.file.path}: {name} has {counted(t.size, 'value')} with a time")
        whole.append((t, channel.values(v), channel.unit))
    if condition is not None:
        instants = [_fired(*samples, condition, part) for samples, part in zip(whole, parts)]
        for part, instant in zip(parts, instants):
            part.shift = instants[0] - instant
    else:
        for part, samples in zip(parts[1:], whole[1:]):
            part.shift = _lag(whole[0], samples, f"--join {join}: {part.file.path}")
    kept = {channel.name for channel in parts[0].channels}
    for part in parts[1:]:  # the channel that they have in common is one channel
        part.channels = [channel for channel in part.channels if channel.name not in kept]
        kept |= {channel.name for channel in part.channels}


def _fired(t: Reals, v: Reals, unit: str, condition: Condition, part: _Part) -> float:
    """The time of the first sample that meets the condition, between it and the one before [s]."""
    level = condition.level_in(unit)
    size = np.abs(v) if condition.size else v
    beyond = size - level if condition.sense == ">" else level - size
    met = np.flatnonzero(beyond > 0.0)
    if not met.size:
        raise UsageError(
            f"--join {condition}: never met in {part.file.path}: {size.min():.6g} to {size.max():.6g} {unit}"
        )
    i = int(met[0])
    if i == 0:
        return float(t[0])
    return float(t[i] - (t[i] - t[i - 1]) * beyond[i] / (beyond[i] - beyond[i - 1]))


def _lag(first: tuple[Reals, Reals, str], other: tuple[Reals, Reals, str], where: str) -> float:
    """The shift [s] of `other` with which a channel correlates best with the same channel of `first`."""
    from scipy.signal import correlate, correlation_lags

    step = min(float(np.median(np.diff(t))) for t, *_ in (first, other))
    for t, *_ in (first, other):
        if float(t[-1] - t[0]) > _SPARSE * step * t.size:
            raise UsageError(f"{where}: most of its time is a gap; name a trigger, CHANNEL > VALUE UNIT")
    a = _resampled(*first[:2], step)
    b = _resampled(*other[:2], step)
    c = correlate(a, b)
    k = int(np.argmax(c))
    likeness = float(c[k]) / max(float(np.sqrt((a @ a) * (b @ b))), np.finfo(float).tiny)
    if not likeness > _ALIKE:
        raise UsageError(
            f"{where} does not look alike (correlation {likeness:.2f}); name another channel, or a trigger"
        )
    bend = c[k - 1] - 2.0 * c[k] + c[k + 1] if 0 < k < c.size - 1 else 0.0
    between = 0.5 * (c[k - 1] - c[k + 1]) / bend if bend else 0.0
    lag = correlation_lags(a.size, b.size)[k] + between
    return float(first[0][0] - other[0][0] + lag * step)


def _resampled(t: Reals, v: Reals, step: float) -> Reals:
    """The samples v(t) without their mean, every `step` [s] by straight lines."""
    return np.asarray(np.interp(np.arange(t[0], t[-1], step), t, v - v.mean()))


def _written(
    parts: Sequence[_Part],
    draft: Path,
    out: Path,
    given: ChannelMap,
    begin: float,
    progress: Callable[[int, int], object],
) -> Imported:
    bases = [TimeBase(part.file.path.name) for part in parts]
    units = {channel.name: channel.unit for part in parts for channel in part.channels}
    setup = run_setup.Setup(
        run=out.stem,
        scene="",
        frame_ns=FRAME_NS,
        step_ns=FRAME_NS,
        outputs={},
        sensors={c.name: (c.unit, part.periods.get(c.column, 0)) for part in parts for c in part.channels},
        provenance=_provenance(parts, given, begin),
    )
    stated = (part.file.began_ns for part in parts if part.file.began_ns is not None)
    began_ns = next(stated, parts[0].file.path.stat().st_mtime_ns)  # else the date of the file
    began_ns += round(begin * 1e9) if abs(begin) <= _FARTHEST else 0  # beyond, the file is refused
    began_ns = max(began_ns, 0)
    ranges = {name: (unit, np.inf, -np.inf) for name, unit in units.items()}
    writer = Writer(draft, setup, MADE)
    try:
        numbers = dict.fromkeys(units, -1)
        reached = [-np.inf] * len(parts)
        streams = [part.blocks(base) for part, base in zip(parts, bases)]
        faults = list[str]()
        while any(np.isfinite(reached) | np.isneginf(reached)):
            i = int(np.argmin(reached))
            try:
                block = next(streams[i])
            except StopIteration:
                reached[i] = np.inf
                continue
            except UsageError as fault:
                faults.append(str(fault))
                reached[i] = np.inf
                continue
            ends = [t[-1] for t, _ in block.values() if t.size]
            reached[i] = max(ends, default=reached[i])
            for name, (t, v) in block.items():
                if faults or not t.size:
                    continue
                unit, low, high = ranges[name]
                ranges[name] = unit, min(low, float(v.min())), max(high, float(v.max()))
                t_ns = np.rint((t - begin) * 1e9).astype(np.int64)
                for low_i, high_i in pairwise(_cuts(t_ns)):
                    numbers[name] += 1
                    piece = t_ns[low_i:high_i]
                    payload = encode.samples(0, piece, np.ascontiguousarray(v[low_i:high_i]))
                    writer.write(f"meas/{name}", payload, int(piece[0]), numbers[name], began_ns + int(piece[0]))
            until = min(reached)
            if np.isfinite(until) and not faults:
                writer.settle(round((until - begin) * 1e9))
            done = sum(base.samples for base in bases)
            total = sum(part.expected for part in parts)
            progress(done, max(done, total))
        if faults:
            raise UsageError("\n".join(faults))
        account = {"messages": writer.messages, "seconds": max(base.last + base.shift for base in bases) - begin}
        told = [base.to_json() for base in bases]
        writer.close(account, {"map": given.text(), "time": told})
    finally:
        writer.abandon()
    sources = {c.name: _source(part, c) for part in parts for c in part.channels}
    return Imported(out, sources, ranges, bases, sum(part.missing for part in parts))


def _source(part: _Part, channel: Channel) -> str:
    """File and column of a channel."""
    other = f" (the file states {channel.stated}; the map decides)" if channel.stated else ""
    return f"{part.file.path.name}, {channel.column}{other}"


def _cuts(t_ns: Integers) -> list[int]:
    """Where messages begin: they hold a slice of time, or as many samples as are worth a message."""
    step = max(int(t_ns[-1] - t_ns[0]) // max(t_ns.size - 1, 1), 1)
    count = min(max(_SLICE_NS // step, _LEAST), _MOST)
    return [*range(0, t_ns.size, count), t_ns.size]


def _provenance(parts: Sequence[_Part], given: ChannelMap, begin: float) -> dict[str, str]:
    files = {}
    for part in parts:
        with part.file.path.open("rb") as file:
            files[part.file.path.name] = hashlib.file_digest(file, "sha256").hexdigest()
    return {
        "date": datetime.now(UTC).isoformat(timespec="seconds"),
        "friction-rig": package_version("friction-rig"),
        "files": ", ".join(f"{name} (SHA-256 {digest})" for name, digest in files.items()),
        "map": given.text(),
        "begin": f"{begin!r} s of the first file",
    }
