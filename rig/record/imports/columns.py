"""What every measurement file becomes: columns with units and time bases, and the reasons for what is not read.

ArrayColumns collects the arrays of a file that is read as a whole.
"""

from __future__ import annotations

import math
import re
from collections.abc import Callable, Collection, Iterator, Mapping
from dataclasses import dataclass, field
from functools import cached_property
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from rig.printable import distinct
from rig.record.imports.instrument_units import is_time, meaning
from rig.record.run_data import Reals

Block = Mapping[str, Reals]
"""Column -> its next values; columns of one length have equally many. Large whole numbers are integers."""

WORDS = "it has words, no numbers"
"""Why a column of texts is not read."""
UNIT_KEYS = ("units", "unit", "unit_string", "unit_label", "ni_unitdescription", "einheit")
"""Attributes that state a unit, in small letters."""
_BRACKETS = re.compile(r"(?P<name>.*?)(?:\s*/)?\s*(?:\[(?P<square>[^\]]*)\]|\((?P<round>[^)]*)\))\s*")
_WHOLE = 2.0**53  # below, a double holds each whole number


class Column(NamedTuple):
    """One column of a file."""

    name: str
    unit: str = ""
    """As the file states it; "" if it states none."""
    rate: float = 0.0
    """Samples per second, if the file states it [Hz]."""
    start: float = 0.0
    """Time of the first sample [s]."""
    length: int | None = None
    """Number of values; None if the file has to be read for it."""


@dataclass(frozen=True)
class MeasurementFile:
    """A file with its columns. `blocks(names)` yields their values; it raises UsageError, which lists all faults.

    `began_ns`: the wall clock at time 0, in ns since 1970 (UTC), if the file states it.
    """

    path: Path
    columns: tuple[Column, ...]
    blocks: Callable[[Collection[str]], Iterator[Block]]
    began_ns: int | None = None
    first_row: int = 1
    """Number of the row with the first values, as a user counts it."""
    rows: Callable[[Collection[str]], Iterator[tuple[int, dict[str, float]]]] | None = None
    """Row by row what can be read of a text whose `blocks` raise."""
    left_out: Mapping[str, str] = field(default_factory=dict)
    """Columns that are not read -> why."""
    unread: tuple[str, ...] = ()
    """Lines of a text that are not read, with the reason."""
    midnights: Callable[[str], int] = lambda _: 0
    """How often the times of day of a column without dates passed midnight in what was read last."""

    @cached_property
    def _by_name(self) -> dict[str, Column]:
        return {column.name: column for column in self.columns}

    def column(self, name: str) -> Column:
        """The column `name`. Raises KeyError."""
        return self._by_name[name]


def name_and_unit(label: str) -> tuple[str, str]:
    """Name and unit of a label, "velocity [mm/s]" or "velocity / (mm/s)"; the unit is "" without brackets."""
    match = _BRACKETS.fullmatch(label.strip())
    if match is None or not match["name"]:
        return label.strip(), ""
    return match["name"], (match["square"] if match["square"] is not None else match["round"]).strip()


def stated_unit(about: Mapping[str, Any]) -> str:
    """The unit that attributes state, however their name is written; "" if none does."""
    by_key = {key.lower(): word(value) for key, value in about.items() if key.lower() in UNIT_KEYS}
    return next(filter(None, (by_key.get(key, "") for key in UNIT_KEYS)), "")


def word(given: Any) -> str:
    """A text attribute, which some programs store as an array of one text."""
    values = np.asarray("" if given is None else given).ravel()
    value = values[0] if values.size == 1 else ""
    if isinstance(value, bytes):
        return value.decode(errors="replace")
    return str(value) if isinstance(value, str) else ""


class ArrayColumns:
    """Collects the arrays of a file that is read as a whole."""

    def __init__(self, path: Path) -> None:
        self.path = path
        self.columns: list[Column] = []
        self.values: dict[str, Reals] = {}
        self.left_out: dict[str, str] = {}

    def add(self, label: str, values: Any, unit: str = "", rate: float = 0.0, start: float = 0.0) -> None:
        """Add an array: a vector is a column, of a matrix each column, of a table each field.

        What has no numbers is left out.
        """
        array = np.asarray(values)
        if array.dtype.names:
            for name in array.dtype.names:
                self.add(f"{label}.{name}", array[name], unit, rate, start)
            return
        if array.dtype.kind == "M":
            ns = array.astype("datetime64[ns]").astype(np.int64)
            array = (ns - ns.flat[0]) * 1e-9 if ns.size else array
            unit = "s"
        if why := _no_column(array):
            self.leave_out(label, why)
            return
        array = np.squeeze(array)
        if array.ndim == 2:
            array = array if array.shape[0] >= array.shape[1] else array.T
            for i in range(array.shape[1]):
                self.add(f"{label}.{i + 1}", array[:, i], unit, rate, start)
            return
        name, own = name_and_unit(label)
        if name in self.values:
            name = distinct((*self.values, name), "{} ({})")[-1]
        self.columns.append(Column(name, own or unit, rate, start, array.size))
        self.values[name] = exact(array)

    def add_sampled(self, label: str, values: Any, unit: str, step: float, begin: float, of_time: str) -> None:
        """Add an array of samples every `step`, from `begin` on, both in the unit `of_time`.

        A step that is not above 0 states no rate.
        """
        if not 0.0 < step < math.inf:
            self.add(label, values, unit)
        elif not is_time(of_time):
            self.leave_out(label, f"its abscissa is in {of_time!r:.20}, which is no unit of time")
        else:
            second = meaning(of_time, "s").factor
            self.add(label, values, unit, 1.0 / (step * second), begin * second)

    def leave_out(self, label: str, why: str) -> None:
        """Note a column that is not read."""
        self.left_out[distinct((*self.left_out, label), "{} ({})")[-1] if label in self.left_out else label] = why

    def file(self, began_ns: int | None = None) -> MeasurementFile:
        """The file."""

        def blocks(names: Collection[str]) -> Iterator[Block]:
            yield {name: self.values[name] for name in names}

        return MeasurementFile(self.path, tuple(self.columns), blocks, began_ns, left_out=self.left_out)


def exact(array: NDArray[Any]) -> Reals:
    """Doubles; whole numbers that a double does not hold, such as ns since 1970, stay as they are."""
    if array.dtype.kind in "iu" and array.size and _WHOLE <= float(array.max()) < 2.0**63:
        return np.asarray(array, np.int64)
    return np.asarray(array, np.float64)


def _no_column(array: NDArray[Any]) -> str:
    """Why an array is no column of numbers over time; "" if it is one."""
    if array.dtype.kind == "c":
        return "it is complex: a spectrum or a transfer function, no measurement over time"
    if array.dtype.kind in "SU" or (array.dtype.kind == "O" and array.size and isinstance(array.flat[0], str | bytes)):
        return WORDS
    if array.dtype.kind not in "fiub":
        return "it is no array of numbers" if array.dtype.kind == "O" else f"it has the type {array.dtype}"
    return no_shape(array.shape)


def no_shape(shape: tuple[int, ...]) -> str:
    """Why an array of this shape is no column over time; "" if it is one."""
    if math.prod(shape) < 2:
        return "it is a single value" if math.prod(shape) else "it is empty"
    dimensions = sum(size > 1 for size in shape)
    return f"it has {dimensions} dimensions; expected a vector or a matrix" if dimensions > 2 else ""
