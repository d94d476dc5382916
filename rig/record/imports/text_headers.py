"""What the lines above a table state in the files of LabVIEW (.lvm) and of oscilloscopes: units, rate and begin."""

from __future__ import annotations

import math
import re
from collections.abc import Mapping, Sequence
from typing import NamedTuple

from rig.errors import UsageError
from rig.record.imports import clock_times

_LABVIEW = "LabVIEW Measurement"
_MARKS = re.compile(r"[:,;\t]+")
_X = "X_Value"  # its column of times
_COMMENT = "Comment"
_STEPS = ("XInc", "XIncrement", "Sample Interval", "Delta_X")
_STARTS = ("XOrg", "XOrigin", "X0")
_UNITS = ("YUnits", "YUnit", "Vertical Units", "Y_Unit_Label")


class TextHeader(NamedTuple):
    """What the lines above a table state. `units`: by column, "" where none is stated; empty: nothing at all.

    `rates` [Hz] and `starts` [s], by column, if it states the distance of its samples in place of times; else empty.
    """

    units: tuple[str, ...] = ()
    rates: tuple[float, ...] = ()
    starts: tuple[float, ...] = ()
    began_ns: int | None = None


def read(lines: Sequence[str], separator: str, labels: Sequence[str]) -> TextHeader:
    """Read the lines above the columns `labels`."""
    is_labview = bool(lines) and lines[0].strip().startswith(_LABVIEW)
    table: dict[str, list[str]] = {}
    for line in lines:
        key, *cells = (cell.strip(' "') for cell in (line.split(separator) if is_labview else _MARKS.split(line)))
        table[key] = cells
    return _labview(table, labels) if is_labview else _oscilloscope(table, labels)


def _labview(table: Mapping[str, Sequence[str]], labels: Sequence[str]) -> TextHeader:
    """Of LabVIEW: each row of its header has a cell for each channel."""
    channels = [label for label in labels if label not in (_X, _COMMENT)]
    stated = iter(table.get("Y_Unit_Label", ()))
    of_time = next(iter(table.get("X_Dimension", ())), "Time") == "Time"
    units = {label: next(stated, "") for label in channels}
    units[_X] = "s" if of_time else ""
    steps = [_number(cell) for cell in table.get("Delta_X", ())]
    begins = [_number(cell) for cell in table.get("X0", ())]
    rates: tuple[float, ...] = ()
    starts: tuple[float, ...] = ()
    if next(iter(table.get("X_Columns", ())), "One") == "No" and steps and steps[0] > 0.0:
        rates = tuple(1.0 / steps[0] for _ in labels)
        starts = tuple(begins[0] if begins and math.isfinite(begins[0]) else 0.0 for _ in labels)
    return TextHeader(tuple(units.get(label, "") for label in labels), rates, starts, _began(table))


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
