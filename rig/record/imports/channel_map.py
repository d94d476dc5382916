"""What the columns of a measurement are: the channels they become, with scale and unit, and the time base.

    COLUMN = NAME, SCALE UNIT, offset VALUE UNIT

    vel = vibrometer                          the file states a unit
    vel = vibrometer, mm/s                    the unit of the column
    ch1 = vibrometer, 125 mm/s/V              sensitivity of a column in V
    ch2 = load, 100 N/V, offset -2.5 N        added after the scale

A TOML file keeps the map of a bench for later files:

    time = "t, s"                             or rate = "2 kHz"
    [channels]
    ch1 = "vibrometer, 125 mm/s/V"
"""

from __future__ import annotations

import re
import tomllib
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import NamedTuple

import numpy as np

from rig.errors import UsageError
from rig.machine import files
from rig.record.imports.measurement_file import Column, MeasurementFile
from rig.record.run_data import Reals
from rig.scenes.faults import near
from rig.units import brief, conversion, parted, si_unit

NAME = "import.toml"
"""The file beside the measurements that keeps their map."""
_PER = re.compile(r"(?P<unit>.*?)\s*/\s*(?P<per>[mkµu]?V|m?A|count|bit)")
_TIMES = re.compile(r"(time|zeit|temps|t|timestamp|date.?time)(_?s)?", re.IGNORECASE)
_SLUG = re.compile(r"[^a-z0-9]+")


class Channel(NamedTuple):
    """A channel of the recording and the column it is made of: value = factor * column + offset, in `unit` (SI)."""

    column: str
    name: str
    unit: str
    factor: float
    offset: float

    def values(self, column: Reals) -> Reals:
        """The values of the channel."""
        return column * self.factor + self.offset if (self.factor, self.offset) != (1.0, 0.0) else column


@dataclass(frozen=True)
class ChannelMap:
    """The columns to import with what each becomes, as texts, and the time base of the files that state none."""

    channels: Mapping[str, str] = field(default_factory=dict)
    """Column -> "NAME, SCALE UNIT, offset VALUE UNIT"."""
    time: str = ""
    """The column with the time, and its unit if the file states none: "t, ms"."""
    rate: str = ""
    """Samples per second, "2 kHz"."""

    @classmethod
    def of_texts(cls, texts: Sequence[str], time: str = "", rate: str = "") -> ChannelMap:
        """Read "COLUMN = NAME, ...". Raises UsageError."""
        channels: dict[str, str] = {}
        for text in texts:
            column, equals, rest = text.rpartition("=")
            if not equals or not column.strip() or not rest.strip():
                raise UsageError(f'--map {text}: expected COLUMN = NAME, such as "ch1 = vibrometer, 125 mm/s/V"')
            if column.strip() in channels:
                raise UsageError(f"--map {text}: column {column.strip()} is given twice")
            channels[column.strip()] = rest.strip()
        return cls(channels, time, rate)

    @classmethod
    def read(cls, path: Path) -> ChannelMap:
        """Read the map that a TOML file keeps. Raises UsageError."""
        try:
            tables = tomllib.loads(files.contents(path, files.TEXT).decode())
        except OSError as fault:
            raise UsageError(f"{path}: cannot be read: {fault.strerror}") from None
        except ValueError as fault:
            raise UsageError(f"{path}: is no TOML: {fault}") from None
        channels = tables.pop("channels", {})
        time = tables.pop("time", "")
        rate = tables.pop("rate", "")
        if tables:
            raise UsageError(f"{path}: unknown key {next(iter(tables))}; known: time, rate, channels")
        texts = isinstance(channels, dict) and all(isinstance(t, str) for t in (time, rate, *channels.values()))
        if not texts:
            raise UsageError(f'{path}: expected texts, such as time = "t, s" and ch1 = "vibrometer, 125 mm/s/V"')
        return cls(channels, time, rate)

    def text(self) -> str:
        """The map as TOML."""
        head = []
        if self.time:
            head.append(f"time = {_quoted(self.time)}")
        if self.rate:
            head.append(f"rate = {_quoted(self.rate)}")
        rows = [f"{_quoted(column)} = {_quoted(text)}" for column, text in self.channels.items()]
        return "\n".join([*head, "", "[channels]", *rows, ""]).lstrip("\n")

    def time_column(self, columns: Iterable[Column], where: str) -> tuple[str, float]:
        """The column with the time and its unit in seconds; "" without one. Raises UsageError."""
        if not self.time:
            return "", 1.0
        name, _, unit = map(str.strip, self.time.partition(","))
        column = _known(name, columns, where)
        unit = unit or column.unit
        if not unit:
            raise UsageError(f'{where}: column {name} states no unit; give the time with its unit, such as "{name}, s"')
        return name, _factor(unit, "s", f"{where}: time {self.time}")[0]

    def channels_of(self, columns: Sequence[Column], where: str) -> list[Channel]:
        """The channels that the columns of a file become. Raises UsageError with all faults."""
        made = list[Channel]()
        faults = list[str]()
        for column, text in self.channels.items():
            try:
                made.append(_channel(_known(column, columns, where), text, where))
            except UsageError as fault:
                faults.append(str(fault))
        names = [channel.name for channel in made]
        faults += [f"{where}: two columns become {name}" for name in dict.fromkeys(names) if names.count(name) > 1]
        if faults:
            raise UsageError("\n".join(faults))
        return made


def proposed(file: MeasurementFile, rising: Iterable[str]) -> ChannelMap:
    """A map of all columns of a file, to be completed where the file states no unit ("?").

    `rising`: the columns whose values rise evenly. The first of them that is called as a time is, or is in seconds, is
    the time; it is needed only if a column has no rate of its own.
    """
    times = [file.column(name) for name in rising]
    named = [
        column for column in times if _TIMES.fullmatch(column.name.rpartition(".")[2]) or column.unit in ("s", "ms")
    ]
    time = named[0] if named and not all(column.rate for column in file.columns) else None
    rest = [column for column in file.columns if column is not time]
    names: dict[str, str] = {}
    for column in rest:
        slug = _SLUG.sub("_", column.name.lower()).strip("_") or "channel"
        slug = slug if slug[0].isalpha() else f"c{slug}"
        names[column.name] = slug if slug not in names.values() else f"{slug}_{len(names) + 1}"
    channels = {column.name: f"{names[column.name]}, {column.unit or '?'}" for column in rest}
    untimed = time is None and not all(column.rate for column in rest)
    return ChannelMap(channels, f"{time.name}, {time.unit or '?'}" if time else "", "? Hz" if untimed else "")


def _quoted(text: str) -> str:
    return '"' + text.replace("\\", "\\\\").replace('"', '\\"') + '"'


def _known(name: str, columns: Iterable[Column], where: str) -> Column:
    by_name = {column.name: column for column in columns}
    if name not in by_name:
        raise UsageError(f"{where}: there is no column {name!r}; {near(name, by_name, 'rig import FILE lists them')}")
    return by_name[name]


def _factor(unit: str, target: str, where: str) -> tuple[float, float]:
    try:
        return conversion(unit, target)
    except ValueError as fault:
        raise UsageError(f"{where}: the unit {fault}") from None


def _channel(column: Column, text: str, where: str) -> Channel:
    name, *parts = map(str.strip, text.split(","))
    told = f"{where}: {column.name} = {text}"
    if not re.fullmatch(r"[A-Za-z]\w{0,63}", name):
        raise UsageError(f"{told}: {brief(name)} is no name; expected letters, digits and _, at most 64")
    offset = next((part for part in parts if part.startswith("offset")), "")
    scales = [part for part in parts if part and part is not offset]
    if len(scales) > 1 or "?" in text:
        raise UsageError(f"{told}: expected NAME, SCALE UNIT such as vibrometer, 125 mm/s/V")
    number, unit = parted(scales[0]) if scales and scales[0][0] in "+-.0123456789" else ("", "".join(scales))
    scale = _number(number, told) if number else 1.0
    unit = unit or ("1" if number else column.unit)
    if not unit:
        raise UsageError(
            f'{told}: the file states no unit for {column.name}; add it, such as "{name}, mm/s" or "{name}, 1"'
        )
    per = _PER.fullmatch(unit) if number else None
    if number and column.unit not in ("", "1"):
        try:
            scale *= conversion(column.unit, per["per"] if per else "1")[0]
        except ValueError:
            raise UsageError(f"{told}: the column is in {column.unit}; expected a scale per {column.unit}") from None
    elif not number and column.unit and column.unit != unit:
        raise UsageError(
            f"{told}: the file says that {column.name} is in {column.unit}; leave the unit out, or give a scale"
        )
    unit = per["unit"] if per else unit
    target, factor, shift = _in_si(unit, told)
    added = 0.0
    if offset:
        number, unit = parted(offset.removeprefix("offset"))
        size, zero = _factor(unit or "1", target, told)
        added = _number(number, told) * size + zero
    return Channel(column.name, name, target, scale * factor, shift + added)


def _number(text: str, told: str) -> float:
    try:
        if np.isfinite(number := float(text)):
            return number
    except ValueError:
        pass
    raise UsageError(f"{told}: {brief(text)} is not a number")


def _in_si(unit: str, told: str) -> tuple[str, float, float]:
    """The SI unit for values in `unit`, and factor and offset that convert them."""
    try:
        target = si_unit(unit)
    except ValueError as fault:
        raise UsageError(f"{told}: the unit {fault}") from None
    return target, *_factor(unit, target, told)
