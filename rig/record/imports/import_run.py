"""Measurements become a recording without a plant: their channels are sensors, in SI units, from time 0 on.

Files are read and written block by block. Several files of one run get a common time: by a trigger, or by a channel
that all of them contain. The recording appears under its name when it is complete.
"""

from __future__ import annotations

import hashlib
import os
from collections.abc import Callable, Iterator, Sequence
from contextlib import suppress
from dataclasses import dataclass, field
from datetime import UTC, datetime
from itertools import pairwise
from pathlib import Path
from typing import Any, ClassVar

import numpy as np

from rig.bus import encode, run_setup
from rig.errors import OutputError, UsageError
from rig.printable import counted
from rig.record.imports.channel_map import Channel, ChannelMap, proposed, stated_fault
from rig.record.imports.columns import MeasurementFile
from rig.record.imports.common_time import join_parts
from rig.record.imports.file_part import FARTHEST, Part
from rig.record.imports.instrument_units import is_time, meaning
from rig.record.imports.measurement_file import opened
from rig.record.imports.time_base import TimeBase, rounding
from rig.record.provenance import package_version
from rig.record.run_data import Integers
from rig.record.writer import Writer
from rig.results import Column, Result, Table
from rig.units import si

_SLICE_NS = 250_000_000  # of a message. chosen
# Fewest and most samples of a message. chosen: 32 to 512 KiB
_LEAST = 4096
_MOST = 1 << 16
_HIGHEST_RATE = 1e9  # Hz: times are whole ns
FRAME_NS = 1_000_000
"""Period at which a replay publishes a measurement, and a controller is asked."""
MADE = "measured"
"""How the recording of a measurement was made, in its metadata."""


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
    unread: list[str] = field(default_factory=list)
    """Lines of the files that are no row of a column, with the reason."""

    def shown(self) -> Iterator[str | Table]:
        """Yield the channels with their ranges, and the time bases."""
        yield f"{self.path}: {counted(len(self.channels), 'channel')}"
        numbers = (Column("lowest", digits=".6g"), Column("highest", digits=".6g"))
        rows = []
        for name, source in self.channels.items():
            unit, low, high = self.ranges[name]
            rows.append((name, *((low, high) if low <= high else (None, None)), unit, source))
        yield Table("columns", (Column("channel"), *numbers, Column("unit"), Column("from")), rows)
        yield from (f"  {base.text()}" for base in self.bases)
        yield from (f"  not read: {line}" for line in self.unread)
        if self.missing:
            yield f"  {counted(self.missing, 'missing value')} left out"

    def facts(self) -> dict[str, Any]:
        """Return channels, ranges and time bases."""
        bases = [base.to_json() for base in self.bases]
        return {
            "path": str(self.path),
            "channels": self.channels,
            "ranges": self.ranges,
            "time": bases,
            "missing": self.missing,
            "unread": self.unread,
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
        first: dict[str, Any] = {}
        rising = set(names)
        in_time = {column.name: column.unit for column in file.columns if is_time(column.unit)}
        seconds = {name: meaning(in_time[name], "s").factor if name in in_time else 1.0 for name in names}
        times: dict[str, TimeBase] = {name: TimeBase(file.path.name) for name in names}
        for block in file.blocks(names):
            for name, v in block.items():
                known = v[np.isfinite(v)]
                count[name] += known.size
                if not known.size:
                    continue
                origin = first.setdefault(name, known[0])
                low[name] = min(low[name], float(known.min()))
                high[name] = max(high[name], float(known.max()))
                if name in rising and known[0] > last[name] and np.all(known[1:] > known[:-1]):
                    with np.errstate(over="ignore"):  # a column that rises may be no time
                        times[name].add(np.asarray((known - origin) * seconds[name], np.float64))
                    times[name].origin = float(origin) * seconds[name]
                    times[name].rounding = rounding(known) * seconds[name]
                    last[name] = known[-1]
                else:
                    rising.discard(name)
        for column in file.columns:
            name = column.name
            ends = (float(low[name]), float(high[name]))
            rows.append((file.path.name, name, column.unit, *ends, count[name], column.rate))
        left_out += [(file.path.name, name, why) for name, why in file.left_out.items()]
        proposal = proposed(file, [name for name in names if name in rising and times[name].samples > 1])
        time, _ = proposal.time_and_unit(file.columns)
        if time in in_time:
            times[time].midnights = file.midnights(time)
            bases.append(times[time])
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
        join_parts(parts, join)
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


def _parts(files: Sequence[MeasurementFile], given: ChannelMap, join: str, skip_missing: bool) -> list[Part]:
    """What each file becomes. Raises UsageError with the faults of all of them."""
    if not given.channels:
        raise UsageError('no channel is named: add --map "COLUMN = NAME, UNIT"; without it the columns are listed')
    parts = list[Part]()
    faults = list[str]()
    met = set[str]()
    try:
        rate = si(given.rate, "Hz") if given.rate else 0.0
    except ValueError as fault:
        raise UsageError(f"--rate {given.rate}: {fault}") from None
    if given.rate and not 0.0 < rate <= _HIGHEST_RATE:
        raise UsageError(f"--rate {given.rate}: expected more than 0 Hz, and at most 1 GHz")
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
            parts.append(Part(file, time, scale, rate, made, skip_missing))
        except UsageError as fault:
            faults.append(str(fault))
    if len(files) > 1:
        faults += [f"no file has a column {column!r}" for column in given.channels if column not in met]
    if faults:
        raise UsageError("\n".join(faults))
    return parts


def _written(
    parts: Sequence[Part],
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
    began_ns += round(begin * 1e9) if abs(begin) <= FARTHEST else 0  # beyond, the file is refused
    began_ns = max(began_ns, 0)
    for part, base in zip(parts, bases):
        base.shift = part.shift + parts[0].origin_s - part.origin_s
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
        last = max(base.last + part.shift for base, part in zip(bases, parts))
        account = {"messages": writer.messages, "seconds": last - begin}
        told = [base.to_json() for base in bases]
        writer.close(account, {"map": given.text(), "time": told})
    finally:
        writer.abandon()
    sources = {c.name: _source(part, c) for part in parts for c in part.channels}
    unread = [f"{part.file.path.name}, {lines}" for part in parts for lines in part.file.unread]
    return Imported(out, sources, ranges, bases, sum(part.missing for part in parts), unread)


def _source(part: Part, channel: Channel) -> str:
    """File and column of a channel."""
    other = f" (the file states {channel.stated}; the map decides)" if channel.stated else ""
    return f"{part.file.path.name}, {channel.column}{other}"


def _cuts(t_ns: Integers) -> list[int]:
    """Where messages begin: they hold a slice of time, or as many samples as are worth a message."""
    step = max(int(t_ns[-1] - t_ns[0]) // max(t_ns.size - 1, 1), 1)
    count = min(max(_SLICE_NS // step, _LEAST), _MOST)
    return [*range(0, t_ns.size, count), t_ns.size]


def _provenance(parts: Sequence[Part], given: ChannelMap, begin: float) -> dict[str, str]:
    files = {}
    for part in parts:
        with part.file.path.open("rb") as file:
            files[part.file.path.name] = hashlib.file_digest(file, "sha256").hexdigest()
    return {
        "date": datetime.now(UTC).isoformat(timespec="seconds"),
        "friction-rig": package_version("friction-rig"),
        "files": ", ".join(f"{name} (SHA-256 {digest})" for name, digest in files.items()),
        "map": given.text(),
        "begin": f"{begin + parts[0].origin_s!r} s of the first file",
    }
