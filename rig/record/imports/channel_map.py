"""What the columns of a measurement are: the channels they become, with scale and unit, and the time base.

    COLUMN = NAME, SCALE UNIT, offset VALUE UNIT

    vel = vibrometer                          the file states a unit
    vel = vibrometer, mm/s                    the unit of the column
    ch1 = vibrometer, 125 mm/s/V              sensitivity of a column in V
    ch2 = load, 100 N/V, offset -2.5 N        added after the scale

The map decides where the file states another unit.

A TOML file keeps the map of a bench for later files:

    time = "t, s"                             or rate = "2 kHz"
    [channels]
    ch1 = "vibrometer, 125 mm/s/V"
"""

from __future__ import annotations

import re
import tomllib
from collections.abc import Callable, Iterable, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, field
from pathlib import Path
from types import MappingProxyType
from typing import NamedTuple

import numpy as np

from rig.errors import UsageError
from rig.machine import files
from rig.record.imports.columns import Column, MeasurementFile
from rig.record.imports.instrument_units import UnitFault, is_time, meaning
from rig.record.run_data import Reals
from rig.scenes.faults import near
from rig.units import brief, parted

NAME = "import.toml"
"""The file beside the measurements that keeps their map."""
# Sensitivities: 125 mm/s/V, 2 kN/(mV/V)
_PER = re.compile(r"(?P<unit>.*?)\s*/\s*(?:\((?P<ratio>[mkµu]?V/V)\)|(?P<per>[mkµu]?V|[mµu]?A|count|bit))")
_TIMES = re.compile(r"(time|zeit|temps|t|timestamp|date.?time)(_?s)?", re.IGNORECASE)
_UNIT_OF_1 = re.compile(r"1(?:\s*/.*)?")  # 1, 1/min
_SLUG = re.compile(r"[^a-z0-9]+")


class Channel(NamedTuple):
    """A channel of the recording and the column it is made of: value = factor * column + offset, in `unit` (SI)."""

    column: str
    name: str
    unit: str
    factor: float
    offset: float
    stated: str = ""
    """The unit that the file states, where the map has another one."""

    def values(self, column: Reals) -> Reals:
        """The values of the channel; infinite where they are too large for a double."""
        if (self.factor, self.offset) == (1.0, 0.0):
            return column
        with np.errstate(over="ignore"):
            return column * self.factor + self.offset


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
        nested = [key for key, text in channels.items() if isinstance(text, dict)] if isinstance(channels, dict) else []
        if nested:
            inner = next(iter(channels[nested[0]]), "x")
            raise UsageError(
                f"{path}: [channels] {nested[0]} is a table; a name with a point stands in quotes: "
                f'"{nested[0]}.{inner}" = "vibrometer, mm/s"'
            )
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

    def time_column(
        self, columns: Sequence[Column], where: str, left_out: Mapping[str, str] = MappingProxyType({})
    ) -> tuple[str, float]:
        """The column with the time and its unit in seconds; "" without one. Raises UsageError."""
        if not self.time:
            return "", 1.0
        name, unit = self.time_and_unit(columns)
        column = _known(name, {column.name: column for column in columns}, where, left_out)
        unit = unit or column.unit
        if not unit:
            raise UsageError(f'{where}: column {name} states no unit; give the time with its unit, such as "{name}, s"')
        try:
            return name, meaning(unit, "s").factor
        except UnitFault as fault:
            way = f'; give it with the time, such as "{name}, ms"'
            raise UsageError(f"{where}: time {self.time}: the unit {fault}{way}") from None

    def time_and_unit(self, columns: Iterable[Column]) -> tuple[str, str]:
        """The name of the column with the time, which may contain a comma, and the unit that the map states."""
        whole = self.time.strip()
        if any(column.name == whole for column in columns):
            return whole, ""
        name, _, unit = map(str.strip, self.time.rpartition(",") if "," in whole else (whole, "", ""))
        return name, unit

    def channels_of(
        self, columns: Sequence[Column], where: str, left_out: Mapping[str, str] = MappingProxyType({})
    ) -> list[Channel]:
        """The channels that the columns of a file become. Raises UsageError with all faults.

        `left_out`: the columns of the file that are not read, with the reason.
        """
        made = list[Channel]()
        faults = list[str]()
        by_name = {column.name: column for column in columns}
        for column, text in self.channels.items():
            try:
                made.append(_channel(_known(column, by_name, where, left_out), text, where))
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
    named = [column for column in times if _TIMES.fullmatch(column.name.rpartition(".")[2]) or is_time(column.unit)]
    time = named[0] if named and not all(column.rate for column in file.columns) else None
    rest = [column for column in file.columns if column is not time]
    names: dict[str, str] = {}
    taken = set[str]()
    for column in rest:
        slug = _SLUG.sub("_", column.name.lower()).strip("_") or "channel"
        slug = slug if slug[0].isalpha() else f"c{slug}"
        names[column.name] = slug if slug not in taken else f"{slug}_{len(names) + 1}"
        taken.add(names[column.name])
    channels = {column.name: f"{names[column.name]}, {_proposed_unit(column.unit)}" for column in rest}
    untimed = time is None and not all(column.rate for column in rest)
    return ChannelMap(
        channels, f"{time.name}, {time.unit if is_time(time.unit) else '?'}" if time else "", "? Hz" if untimed else ""
    )


def _quoted(text: str) -> str:
    return '"' + text.replace("\\", "\\\\").replace('"', '\\"') + '"'


def _proposed_unit(stated: str) -> str:
    """The unit that a file states, if its meaning is known; otherwise "?"."""
    return "?" if not stated or stated_fault(stated) else stated


def _is_usable(unit: str) -> bool:
    """Whether a unit, or one of its two meanings, is that of a quantity of a bench."""
    try:
        meaning(unit)
    except UnitFault as fault:
        return any(_is_usable(way) for way, _ in fault.ways)
    return True


def stated_fault(unit: str) -> str:
    """Why a unit that a file states cannot be taken as it is, in words; "" if it can."""
    try:
        meaning(unit)
    except UnitFault as fault:
        ways = " or ".join(f"{way} ({told})" for way, told in fault.ways)
        return f"the unit {fault}{f': {ways}' if ways else ''}"
    return ""


def _known(name: str, columns: Mapping[str, Column], where: str, left_out: Mapping[str, str]) -> Column:
    if name in columns:
        return columns[name]
    if name in left_out:
        raise UsageError(f"{where}: column {name} is not read: {left_out[name]}")
    raise UsageError(f"{where}: there is no column {name!r}; {near(name, columns, 'rig import FILE lists them')}")


def _channel(column: Column, text: str, where: str) -> Channel:
    name, *parts = map(str.strip, text.split(","))
    told = f"{where}: {column.name} = {text}"
    if not re.fullmatch(r"[A-Za-z]\w{0,63}", name, re.ASCII):
        raise UsageError(f"{told}: {brief(name)} is no name; expected letters from A to Z, digits and _, at most 64")
    offset = next((part for part in parts if part.startswith("offset")), "")
    scales = [part for part in parts if part and part is not offset]
    if len(scales) > 1 or "?" in text:
        raise UsageError(f"{told}: expected NAME, SCALE UNIT such as vibrometer, 125 mm/s/V")
    scaled = bool(scales) and scales[0][0] in "+-.0123456789" and not _UNIT_OF_1.fullmatch(scales[0])
    number, unit = parted(scales[0]) if scaled else ("", "".join(scales))
    scale = _number(number, told) if number else 1.0
    if number and scale == 0.0:
        raise UsageError(f"{told}: a scale of 0 leaves nothing of the column; state what one unit of it is")
    own = not (number or unit)  # the file states the unit
    unit = unit or ("1" if number else column.unit)
    if not unit:
        raise UsageError(
            f'{told}: the file states no unit for {column.name}; add it, such as "{name}, mm/s" or "{name}, 1"'
        )
    unit, per = _parted_scale(unit, column.unit) if number else (unit, "")
    if number and not per and (inverse := _inverse(scale, unit, column.unit)):
        way = ", ".join(filter(None, (f"{column.name} = {name}", inverse, offset)))
        raise UsageError(f'{told}: a scale is what one unit of the column is, not the inverse; write "{way}"')
    ratio = _ratio(column.unit, per) if number else None

    def mapped(way: str) -> str:
        """The entry of the map with another unit."""
        size = f"{number} {way}/{f'({per})' if '/' in per else per}" if per else f"{number} {way}".strip()
        return ", ".join(filter(None, (f"{column.name} = {name}", size, offset)))

    if number and not per and ratio != 1.0 and column.unit:
        scale_of = f"{number} {unit}/{f'({column.unit})' if '/' in column.unit else column.unit}"
        way = ", ".join(filter(None, (f"{column.name} = {name}", scale_of, offset)))
        raise UsageError(f'{told}: the column is in {column.unit}; expected a scale per {column.unit}, such as "{way}"')
    source = "that the file states, " if own else ""
    target, factor, shift = _in_si(unit, told, source, mapped)
    added = 0.0
    if offset:
        shown, of_offset = parted(offset.removeprefix("offset"))
        try:
            _, size, zero = meaning(of_offset or "1", target)
        except UnitFault as fault:
            raise UsageError(f"{told}: the unit of the offset {fault}; expected one of {target}") from None
        added = _number(shown, told) * size + (0.0 if shift else zero)  # the unit of the column may have its zero
    other = not own and bool(column.unit) and ratio is None and not _equal(column.unit, unit)
    return Channel(
        column.name, name, target, scale * (ratio or 1.0) * factor, shift + added, column.unit if other else ""
    )


def _parted_scale(unit: str, stated: str) -> tuple[str, str]:
    """The unit of a sensitivity, and what it is per: a voltage, a current, or the unit that the file states."""
    for per in (f"/({stated})", f"/{stated}"):
        if stated and unit.endswith(per) and unit != per:
            return unit.removesuffix(per).strip(), stated
    match = _PER.fullmatch(unit)
    if match is None:
        return unit, ""
    return match["unit"] or "1", match["ratio"] or match["per"]


def _inverse(scale: float, unit: str, stated: str) -> str:
    """The sensitivity of a data sheet, "100 mV/g", the other way round, "0.01 g/mV"; "" for one that is no inverse."""
    signal, slash, quantity = (text.strip() for text in unit.partition("/"))
    if not slash or (stated and _ratio(stated, signal) is None) or (not stated and not _is_only_inverse(unit, signal)):
        return ""
    return f"{1.0 / scale:.15g} {quantity}/{signal}"


def _is_only_inverse(unit: str, signal: str) -> bool:
    """Whether a unit is a voltage or a current per quantity, mV/Pa, and no quantity of a bench itself."""
    with suppress(UnitFault):
        if meaning(signal).unit in ("V", "A"):
            return not _is_usable(unit)
    return False


def _ratio(stated: str, per: str) -> float | None:
    """The size of the unit that the file states, in the unit `per`; None if it states none, or another quantity."""
    if stated == per and per:
        return 1.0
    try:
        of_file, of_map = meaning(stated), meaning(per or "1")
    except UnitFault:
        return None
    return of_file.factor / of_map.factor if of_file.unit == of_map.unit else None


def _equal(stated: str, unit: str) -> bool:
    """Whether a unit of the map is one that the file states, however they are written, or one of its two meanings."""
    try:
        return stated == unit or meaning(stated) == meaning(unit)
    except UnitFault as fault:
        return any(meaning(way) == meaning(unit) for way, _ in fault.ways)


def _number(text: str, told: str) -> float:
    try:
        if np.isfinite(number := float(text)):
            return number
    except ValueError:
        pass
    raise UsageError(f"{told}: {brief(text)} is not a number")


def _in_si(unit: str, told: str, source: str, mapped: Callable[[str], str]) -> tuple[str, float, float]:
    """The SI unit for values in `unit`, and factor and offset that convert them. Raises UsageError with a remedy."""
    try:
        return meaning(unit)
    except UnitFault as fault:
        if fault.ways:
            ways = " or ".join(f'"{mapped(way)}" ({what})' for way, what in fault.ways)
            raise UsageError(f"{told}: the unit {source}{fault}; write {ways}") from None
        ways = f'"{mapped("mm/s")}" or, to keep the numbers as they are, "{mapped("1")}"'
        raise UsageError(f"{told}: the unit {source}{fault}; state another one in the map, such as {ways}") from None
