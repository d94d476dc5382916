"""A table of numbers in a text file, as data acquisition systems write it.

Separator, decimal comma, lines before the table, names and units are found from the first lines: the separator is the
one with which the most lines, up to the last of them, are rows of numbers. The numbers are read in blocks. If a row
cannot be read, the file is read again line by line, and all faults are told with row and column.
"""

from __future__ import annotations

import csv as cells_of
import io
import math
import re
from collections.abc import Collection, Iterator, Mapping, Sequence
from dataclasses import dataclass
from datetime import date
from itertools import islice
from pathlib import Path
from typing import Any, BinaryIO

import numpy as np

from rig.errors import UsageError
from rig.printable import counted
from rig.record.run_data import Reals
from rig.units import si_unit

_SEPARATORS = (";", "\t", ",", "|", " ")
_HEADS = (1 << 16, 1 << 20, 1 << 23)
"""Lengths of the part in which the form of the table is looked for, until it has `_ROWS` rows [bytes]."""
_ROWS = 10  # chosen: enough to tell the form of a table
BLOCK = 2 << 20
"""Length of the part of a file that is read at once [bytes]."""
_MOST = 20
"""Number of faults that are told; further ones are counted."""
_NO_VALUE = ("", "nan", "NaN", "NAN", "NA", "n/a", "N/A", "null", "-")
_BLANK_VALUES = [blanks * " " + text + end for text in _NO_VALUE for blanks in range(32) for end in ("", " ")]
_NUMBER = {
    mark: re.compile(rf"[-+]?(?:\d+(?:{re.escape(mark)}\d*)?|{re.escape(mark)}\d+)(?:[eE][-+]?\d+)?|[-+]?[iI]nf")
    for mark in ".,"
}
_ISO = re.compile(r"\d{4}-\d\d-\d\d[T ]\d\d:\d\d(?::\d\d(?:\.\d{1,9})?)?")
_TIME = re.compile(
    r"(?:(?:(?P<year>\d{4})[-/.](?P<month>\d\d?)[-/.](?P<day>\d\d?)|(?P<d>\d\d?)\.(?P<m>\d\d?)\.(?P<y>\d{4}))[T ]\s*)?"
    r"(?P<hour>\d\d?):(?P<minute>\d\d)(?::(?P<second>\d\d)(?:[.,](?P<part>\d{1,9}))?)?\s?(?P<zone>Z|[-+]\d\d:?\d\d)?"
)
_UNIT_LINE = re.compile(r"[\[(].*[\])]|[-%°µμΩ\w^/*·. ]{1,12}|")
_1970 = date(1970, 1, 1).toordinal()
_DAY_NS = 86_400_000_000_000


@dataclass(frozen=True)
class TextTable:
    """A table: its form, and the labels of its columns with units ("" where none is stated)."""

    path: Path
    encoding: str
    separator: str
    decimal: str
    skip: int
    """Number of lines before the first row."""
    labels: tuple[str, ...]
    units: tuple[str, ...]
    stamped: tuple[bool, ...]
    """Columns of times of day."""
    used: tuple[bool, ...]
    """Columns that may have values: neither words nor what follows a separator at the end of the rows."""
    first_ns: int
    """The first time of day, in ns since 1970, or since midnight without a date."""
    iso: bool
    """Times of day have the form 2024-01-31 10:00:00.001."""

    @property
    def began_ns(self) -> int | None:
        """The wall clock at the first row, in ns since 1970, if the table has dates."""
        return self.first_ns if self.first_ns >= _DAY_NS else None

    @classmethod
    def read(cls, path: Path) -> TextTable:
        """Find the form of the table in a file. Raises UsageError if it contains none, OSError if it is unreadable."""
        for size in _HEADS:
            with path.open("rb") as file:
                head = file.read(size)
            encoding = _encoding(head)
            lines = head.decode(encoding, errors="replace").splitlines()
            if len(head) == size:
                lines.pop()  # may be cut
            while lines and not lines[-1].strip():
                lines.pop()
            form = _Form.best(lines)
            if len(head) < size or form.rows >= _ROWS:
                break
        if not any(line.strip() for line in lines):
            raise UsageError(f"{path}: it is empty; expected rows of numbers")
        if not form.rows:
            raise UsageError(
                f"{path}: there is no table of numbers in its first {counted(len(lines), 'line')}; expected rows of "
                f"numbers with one separator of {', '.join(map(repr, _SEPARATORS))}"
            )
        stamps = [text for text in form.split(lines[form.skip]) if _TIME.fullmatch(text)]
        iso = all(map(_ISO.fullmatch, stamps))
        first = _nanoseconds(stamps[0]) if stamps else 0
        return cls(path, encoding, form.separator, form.mark, form.skip, *form.described(lines), first, iso)

    def blocks(self, names: Sequence[str], wanted: Collection[str]) -> Iterator[Mapping[str, Reals]]:
        """Yield the columns `wanted`, of those called `names`, block by block; a value that is not there is NaN.

        Raises UsageError with all rows that are not as the others.
        """
        import pyarrow as pa
        from pyarrow import csv

        of_times = pa.timestamp("ns") if self.iso else pa.string()
        kinds = {}
        for name, stamped in zip(names, self.stamped, strict=True):
            kinds[name] = of_times if stamped else pa.float64()
        ragged = list[Any]()

        def refuse(row: Any) -> str:
            ragged.append(row)
            return "skip"

        as_it_is = self.separator != " " and self.encoding in ("utf-8-sig", "latin-1")
        with self.path.open("rb") as file:
            try:
                with csv.open_csv(
                    file if as_it_is else _Plain(file, self),
                    csv.ReadOptions(
                        use_threads=False,
                        block_size=BLOCK,
                        skip_rows=self.skip,
                        column_names=list(names),
                        encoding="utf8" if self.encoding != "latin-1" else "latin1",
                    ),
                    csv.ParseOptions(delimiter=self.separator, invalid_row_handler=refuse),
                    csv.ConvertOptions(
                        column_types={name: kinds[name] for name in wanted},
                        include_columns=list(wanted),
                        decimal_point=self.decimal,
                        null_values=_BLANK_VALUES,
                        check_utf8=False,
                    ),
                ) as reader:
                    for batch in reader:
                        if ragged:
                            break
                        yield {name: self._values(batch.column(name)) for name in wanted}
            except pa.ArrowInvalid as fault:
                raise UsageError(self._faults(names, wanted) or f"{self.path}: {fault}") from None
        if ragged:
            raise UsageError(
                self._faults(names, wanted) or f"{self.path}: row {ragged[0].number}: {ragged[0].text!r:.60}"
            )

    def _values(self, column: Any) -> Reals:
        from pyarrow import int64, types

        if types.is_string(column.type):
            return np.array([(_nanoseconds(text) - self.first_ns) * 1e-9 for text in column.to_pylist()])
        if types.is_timestamp(column.type):
            ns = column.cast(int64()).to_numpy(zero_copy_only=False)
            return np.asarray((ns - self.first_ns) * 1e-9, np.float64)
        return np.asarray(column.to_numpy(zero_copy_only=False), np.float64)

    def _faults(self, names: Sequence[str], wanted: Collection[str]) -> str:
        """All rows that cannot be read, one a line."""
        told = list[str]()
        count = 0
        with self.path.open(encoding=self.encoding, errors="replace", newline="") as file:
            for number, line in enumerate(islice(file, self.skip, None), self.skip + 1):
                for fault in self._of_row(line, names, wanted):
                    count += 1
                    if count <= _MOST:
                        told.append(f"{self.path}: row {number}: {fault}")
        return "\n".join([*told, f"... and {count - _MOST} more"] if count > _MOST else told)

    def rows(self, names: Sequence[str], wanted: Collection[str]) -> Iterator[tuple[int, dict[str, float]]]:
        """Yield number and values of each row, line by line, without what cannot be read; NaN: there is no value."""
        with self.path.open(encoding=self.encoding, errors="replace", newline="") as file:
            for number, line in enumerate(islice(file, self.skip, None), self.skip + 1):
                cells = _split(line, self.separator)
                values = dict[str, float]()
                for name, cell, stamped in zip(names, cells, self.stamped) if len(cells) == len(names) else ():
                    if name not in wanted:
                        continue
                    if cell in _NO_VALUE:
                        values[name] = math.nan
                    elif stamped and _TIME.fullmatch(cell):
                        values[name] = (_nanoseconds(cell) - self.first_ns) * 1e-9
                    elif not stamped and _NUMBER[self.decimal].fullmatch(cell):
                        values[name] = float(cell.replace(self.decimal, "."))
                if values:
                    yield number, values

    def _of_row(self, line: str, names: Sequence[str], wanted: Collection[str]) -> Iterator[str]:
        cells = _split(line, self.separator)
        text = line.strip()
        if not text:
            return
        if len(cells) != len(names):
            ended = " (the file ends in the middle of it)" if not line.endswith(("\n", "\r")) else ""
            other = self._other_separator(line, len(names))
            hint = f"; with {other!r} in place of {self.separator!r} it would be right" if other else ""
            yield f"{counted(len(cells), 'value')}, the other rows have {len(names)}{ended}{hint}"
            return
        for name, cell, stamped in zip(names, cells, self.stamped, strict=True):
            right = _TIME if stamped else _NUMBER[self.decimal]
            if name in wanted and cell not in _NO_VALUE and not right.fullmatch(cell):
                yield f"column {name}: {cell!r:.40} is not a {'time' if stamped else 'number'}"

    def _other_separator(self, line: str, width: int) -> str:
        """The separator with which a line has `width` numbers; "" if there is none."""
        for separator in _SEPARATORS:
            if separator != self.separator:
                cells = _split(line, separator)
                if len(cells) == width and all(map(_NUMBER[self.decimal].fullmatch, cells)):
                    return separator
        return ""


class _Form:
    """How a text would be read with a separator and a decimal mark."""

    def __init__(self, separator: str, mark: str, words: bool) -> None:
        self.separator = separator
        self.mark = mark
        self.words = words
        self.rows = self.skip = self.width = 0
        self.headed = self.ended = False

    @classmethod
    def best(cls, lines: Sequence[str]) -> _Form:
        """The form with most rows; a table in which each row has a word, such as a state, only if there is no other."""
        forms = [(separator, mark) for separator in _SEPARATORS for mark in ".,"]
        form = max((cls.of(lines, *form, words=False) for form in forms), key=lambda form: form.merit)
        if not form.rows:
            form = max((cls.of(lines, *form, words=True) for form in forms[:-2]), key=lambda form: form.merit)
            if form.rows < 2 or not any(form.described(lines)[-1]):
                form.rows = 0
        return form

    @classmethod
    def of(cls, lines: Sequence[str], separator: str, mark: str, words: bool) -> _Form:
        """Find the rows: the longest block of lines with one number of columns, all of which are values.

        With `words`, columns of words are allowed beside a column of values.
        """
        form = cls(separator, mark, words)
        begin = 0
        width = -1
        widths = [form._width_of(line) for line in lines]
        for i, here in enumerate([*widths, -1]):
            if here < 0 or here != width:
                if width >= 0 and i - begin > form.rows:
                    form.rows = i - begin
                    form.skip = begin
                    form.width = width
                begin = i
                width = here
        form._skip_to_header(lines, widths)
        form.ended = form.rows > 0 and form.split(lines[form.skip])[-1] == ""
        form.headed = form.rows > 0 and form.skip > 0 and form.heading(lines[form.skip - 1]) is not None
        return form

    def _width_of(self, line: str) -> int:
        """The number of values of a row; -1 for a line that is none."""
        cells = self.split(line)
        known = [self._is_value(cell) for cell in cells]
        if not any(known):
            return -1
        if self.words:
            return len(cells) if len(cells) > 1 else -1
        unknown = [cell for cell, value in zip(cells, known) if not value]
        return len(cells) if all(cell in _NO_VALUE for cell in unknown) else -1

    def heading(self, line: str) -> list[str] | None:
        """The cells of a line above the rows, of which only one may end with a separator; None: it is no heading."""
        cells = self.split(line.lstrip("#%! "))
        if len(cells) == self.width + 1 and not cells[-1]:
            cells.pop()
        if len(cells) == self.width - 1 and self.ended:
            cells.append("")
        return cells if len(cells) == self.width and not all(map(self._is_value, cells)) else None

    def _skip_to_header(self, lines: Sequence[str], widths: Sequence[int]) -> None:
        """Begin below an earlier header, if most lines from there on are rows: the other ones are faults."""
        for i in range(1, self.skip):
            rows = widths[i : self.skip]
            headed = widths[i - 1] < 0 and len(self.split(lines[i - 1])) == self.width
            if headed and rows[0] == self.width and 2 * rows.count(self.width) >= len(rows):
                self.skip = i
                self.rows += rows.count(self.width)
                return

    @property
    def merit(self) -> tuple[int, bool, int]:
        """A form is better with more rows, with a header of the same width, with more columns."""
        return self.rows, self.headed, self.width

    def split(self, line: str) -> list[str]:
        """The cells of a line."""
        return _split(line, self.separator)

    def _is_value(self, cell: str) -> bool:
        return bool(_NUMBER[self.mark].fullmatch(cell) or _TIME.fullmatch(cell))

    def _may_have_values(self, label: str, column: Sequence[str]) -> bool:
        """Whether enough cells are values, or all cells of a column with a label say that there is none."""
        if 2 * sum(map(self._is_value, column)) > len(column) * self.words:
            return True
        return bool(label) and all(cell in _NO_VALUE for cell in column)

    def described(
        self, lines: Sequence[str]
    ) -> tuple[tuple[str, ...], tuple[str, ...], tuple[bool, ...], tuple[bool, ...]]:
        """Labels, units, which columns are times of day, and which may have values."""
        above = [self.heading(line) for line in lines[max(self.skip - 5, 0) : self.skip] if line.strip()]
        headings = list[list[str]]()  # from the rows upwards
        for cells in reversed(above):
            if cells is None:
                break
            headings.append(cells)
        units = [""] * self.width
        labels = headings[0] if headings else [""] * self.width
        for named, stated in zip(headings[1:], headings, strict=False):
            if _are_units(stated) and sum(map(bool, named)) >= max(sum(map(bool, stated)), self.width - self.ended):
                units = [cell.strip("[]() ") for cell in stated]
                labels = named
                break
        rows = [self.split(line) for line in lines[self.skip : self.skip + 100]]
        columns = list(zip(*(cells for cells in rows if len(cells) == self.width), strict=True))
        stamped = tuple(bool(_TIME.fullmatch(cell)) for cell in self.split(lines[self.skip]))
        used = tuple(self._may_have_values(label, column) for label, column in zip(labels, columns, strict=True))
        units = ["s" if stamp else unit for unit, stamp in zip(units, stamped, strict=True)]
        return tuple(label or f"column {i}" for i, label in enumerate(labels, 1)), tuple(units), stamped, used


def _are_units(cells: Sequence[str]) -> bool:
    """Whether a line below the names has their units: short, and at least half of them are known."""
    stated = [cell.strip("[]() ") for cell in cells if cell.strip("[]() ")]
    return bool(stated) and all(map(_UNIT_LINE.fullmatch, cells)) and 2 * sum(map(_is_unit, stated)) >= len(stated)


def _is_unit(text: str) -> bool:
    try:
        return bool(si_unit(text))
    except ValueError:
        return False


def _nanoseconds(text: str | None) -> int:
    """A time of day in ns since 1970, or since midnight without a date. Raises UsageError."""
    match = _TIME.fullmatch((text or "").strip())
    try:
        if match is None:
            raise ValueError
        day = 0
        if year := match["year"] or match["y"]:
            day = (
                date(int(year), int(match["month"] or match["m"]), int(match["day"] or match["d"])).toordinal() - _1970
            )
    except ValueError:
        raise UsageError(f"{text!r:.40} is not a time of day") from None
    seconds = 3600 * int(match["hour"]) + 60 * int(match["minute"]) + int(match["second"] or 0)
    if (zone := match["zone"] or "Z") != "Z":
        seconds -= int(f"{zone[0]}1") * (3600 * int(zone[1:3]) + 60 * int(zone[-2:]))
    return day * _DAY_NS + seconds * 1_000_000_000 + int((match["part"] or "").ljust(9, "0"))


def _split(line: str, separator: str) -> list[str]:
    line = line.rstrip("\r\n")
    if '"' in line:
        line = " ".join(line.split()) if separator == " " else line
        return [cell.strip() for cell in next(cells_of.reader([line], delimiter=separator, skipinitialspace=True), [])]
    cells = line.split() if separator == " " else line.split(separator)
    return [cell.strip() for cell in cells]


def _encoding(head: bytes) -> str:
    if head.startswith((b"\xff\xfe", b"\xfe\xff")):
        return "utf-16"
    try:
        head[:-4].decode("utf-8")
    except UnicodeDecodeError:
        return "latin-1"
    return "utf-8-sig"


class _Plain(io.RawIOBase):
    """The bytes of a file in UTF-8, with one blank between two values where blanks separate them."""

    def __init__(self, file: BinaryIO, table: TextTable) -> None:
        self._text = io.TextIOWrapper(file, table.encoding, newline="")
        self._blanks = table.separator == " "
        self._left = b""

    def readable(self) -> bool:
        """Yes."""
        return True

    def readinto(self, buffer: Any) -> int:
        """Fill the buffer with whole lines as far as they fit."""
        if not self._left:
            lines = self._text.readlines(len(buffer))
            text = "".join(" ".join(line.split()) + "\n" for line in lines) if self._blanks else "".join(lines)
            self._left = text.encode()
        part = self._left[: len(buffer)]
        self._left = self._left[len(buffer) :]
        buffer[: len(part)] = part
        return len(part)
