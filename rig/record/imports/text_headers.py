"""What the lines above a table state in the files of LabVIEW, loggers and oscilloscopes: names, units, rate, begin."""

from __future__ import annotations

import math
import re
from collections.abc import Mapping, Sequence
from itertools import pairwise
from pathlib import Path
from typing import NamedTuple

from rig.errors import UsageError
from rig.record.imports import clock_times
from rig.record.imports.text_form import split

_LABVIEW = "LabVIEW Measurement"
_MARKS = re.compile(r"[:,;\t]+")
_X = "X_Value"  # its column of times
_COMMENT = "Comment"
_STEPS = ("XInc", "XIncrement", "Sample Interval", "Delta_X")
_STARTS = ("XOrg", "XOrigin", "X0")
_UNITS = ("YUnits", "YUnit", "Vertical Units", "Y_Unit_Label")
_LOGGER = ("TOA5", "TOACI1")  # of Campbell: names and units stand in the lines below
_TRACES = "TraceName"  # of Yokogawa: each line of its header has a cell for each column behind the first one
_NUMBER = r"\s*=?\s*([-+]?[\d.]+(?:[eE][-+]?\d+)?)"
_RIGOL_NAMED = (re.compile(rf"\btInc{_NUMBER}"), re.compile(rf"\bt0{_NUMBER}"))
_CHANNELS = "Channels\t"
_SEGMENT = (_LABVIEW, "***End_of_Header***", _CHANNELS, "Samples\t")


class TextHeader(NamedTuple):
    """What the lines above a table state. `units`: by column, "" where none is stated; empty: nothing at all.

    `rates` [Hz] and `starts` [s], by column, if it states the distance of its samples in place of times; else empty.
    `labels`: of the columns, where they do not stand in one line above the rows; else empty.
    """

    units: tuple[str, ...] = ()
    rates: tuple[float, ...] = ()
    starts: tuple[float, ...] = ()
    began_ns: int | None = None
    labels: tuple[str, ...] = ()


def begins_segment(line: str) -> bool:
    """Whether a line below the first rows belongs to the header of another segment of LabVIEW."""
    return line.lstrip("\ufeff").startswith(_SEGMENT)


def segment_fault(path: Path, row: int) -> str:
    """What is wrong with a file in which another segment of LabVIEW begins at a row."""
    return (
        f"{path}: row {row}: another segment of LabVIEW begins here, and a recording has one table; save each segment "
        "as a file of its own, with the lines above its rows"
    )


def refuse_segments(path: Path, lines: Sequence[str]) -> None:
    """Raise UsageError if the lines above a table have the headers of several segments of LabVIEW."""
    begins = [i for i, line in enumerate(lines, 1) if line.startswith(_CHANNELS)]
    if len(begins) > 1 and lines[0].startswith(_LABVIEW):
        raise UsageError(segment_fault(path, begins[1]))


def read(lines: Sequence[str], separator: str, labels: Sequence[str]) -> TextHeader:
    """Read the lines above the columns `labels`."""
    is_labview = bool(lines) and lines[0].strip().startswith(_LABVIEW)
    table: dict[str, list[str]] = {}
    for line in lines:
        key, *cells = (cell.strip(' "') for cell in (line.split(separator) if is_labview else _MARKS.split(line)))
        table[key] = cells
    if is_labview:
        return _labview(table, labels)
    in_cells = [split(line, separator) for line in lines]
    first = in_cells[0][0].lstrip("\ufeff") if in_cells and in_cells[0] else ""
    if first in _LOGGER and len(lines) > 2 and len(in_cells[1]) == len(in_cells[2]) == len(labels):
        return TextHeader(tuple(in_cells[2]), labels=tuple(in_cells[1]))
    by_key = {cells[0]: cells[1:] for cells in in_cells if cells}
    if _TRACES in by_key and len(by_key[_TRACES]) == len(labels) - 1:
        return _yokogawa(by_key)
    return _rigol(in_cells, labels) or _oscilloscope(table, labels)


def _yokogawa(table: Mapping[str, Sequence[str]]) -> TextHeader:
    """Of Yokogawa: the first cell of each line names what the others state for the columns."""
    names = table[_TRACES]
    steps = [_number(cell) for cell in table.get("HResolution", ())]
    begins = [_number(cell) for cell in table.get("HOffset", ())]
    of_time = set(table.get("HUnit", ("s",))) <= {"s", ""}
    units = ("", *table.get("VUnit", [""] * len(names)))
    labels = ("", *names)
    if not of_time or len(steps) != len(names) or not min(steps) > 0.0:
        return TextHeader(units, labels=labels)
    starts = begins if len(begins) == len(names) and all(map(math.isfinite, begins)) else [0.0] * len(names)
    rates = (1.0 / steps[0], *(1.0 / step for step in steps))
    return TextHeader(units, rates, (starts[0], *starts), _began(table), labels)


def _rigol(lines: Sequence[Sequence[str]], labels: Sequence[str]) -> TextHeader | None:
    """Of Rigol: begin and increment stand in the columns Start and Increment of its second line, or in names."""
    text = " ".join(cell for cells in lines for cell in cells)
    step, begin = (_number(match[1]) if (match := mark.search(text)) else math.nan for mark in _RIGOL_NAMED)
    units = tuple("" for _ in labels)
    known: tuple[str, ...] = ()
    for names, values in pairwise(lines):
        if names[:1] == ["X"] and {"Start", "Increment"} <= set(names) and len(names) >= len(labels):
            stated = dict(zip(names, values, strict=False))
            step, begin = (_number(stated.get(name, "")) for name in ("Increment", "Start"))
            known = tuple(names[: len(labels)])
            units = tuple("" if name in ("X", "Start", "Increment") else stated.get(name, "") for name in known)
    if not step > 0.0:
        return None
    start = begin if math.isfinite(begin) else 0.0
    return TextHeader(units, tuple(1.0 / step for _ in labels), tuple(start for _ in labels), labels=known)


def _labview(table: Mapping[str, Sequence[str]], labels: Sequence[str]) -> TextHeader:
    """Of LabVIEW: each row of its header has a cell for each channel."""
    places = [i for i, label in enumerate(labels) if _is_channel(label)]
    dimensions = _of_channels(table, "X_Dimension", places, len(labels), "Time")
    of_time = all(dimension == "Time" for dimension in dimensions)
    units = _of_channels(table, "Y_Unit_Label", places, len(labels), "")
    for i, label in enumerate(labels):
        if label.startswith(_X):
            units[i] = "s" if of_time else ""
    steps = [_number(cell) for cell in _of_channels(table, "Delta_X", places, len(labels), "")]
    begins = [_number(cell) for cell in _of_channels(table, "X0", places, len(labels), "")]
    stated = next(iter(table.get("X_Columns", ())), "One") in ("No", "Multi") and of_time
    rates = tuple(1.0 / step if step > 0.0 else 0.0 for step in steps) if stated else ()
    starts = tuple(begin if math.isfinite(begin) else 0.0 for begin in begins) if stated else ()
    return TextHeader(tuple(units), rates, starts, _began(table))


def _is_channel(label: str) -> bool:
    """Whether a column of LabVIEW has values, no times and no remarks."""
    return not label.startswith(_X) and label != _COMMENT


def _of_channels(
    table: Mapping[str, Sequence[str]], key: str, places: Sequence[int], width: int, missing: str
) -> list[str]:
    """What a row of a header of LabVIEW states for each column; `missing` where it states nothing."""
    stated = [missing] * width
    for place, cell in zip(places, table.get(key, ()), strict=False):
        stated[place] = cell or missing
    return stated


def _oscilloscope(table: Mapping[str, Sequence[str]], labels: Sequence[str]) -> TextHeader:
    """Of an oscilloscope that states increment and origin above a single column of voltages."""
    if len(labels) != 1:
        return TextHeader()
    step = _first(table, _STEPS)
    begin = _first(table, _STARTS)
    if not step > 0.0:
        return TextHeader()
    unit = next((cells[0] for key in _UNITS if (cells := table.get(key))), "")
    return TextHeader((unit,), (1.0 / step,), (begin if math.isfinite(begin) else 0.0,))


def _first(table: Mapping[str, Sequence[str]], keys: Sequence[str]) -> float:
    return next((_number(cells[0]) for key in keys if (cells := table.get(key))), math.nan)


def _began(table: Mapping[str, Sequence[str]]) -> int | None:
    """Date and time of the header, in ns since 1970."""
    day = next(iter(table.get("Date", ())), "")
    clock = next(iter(table.get("Time", ())), "")[:18]  # LabVIEW writes more digits than ns
    try:
        return clock_times.nanoseconds(f"{day} {clock}")
    except UsageError:
        return None


def _number(cell: str) -> float:
    try:
        return float(cell.replace(",", "."))
    except ValueError:
        return math.nan
