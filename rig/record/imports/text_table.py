"""A table of numbers in a text file, as data acquisition systems write it.

Its form is found from the first lines (rig.record.imports.text_form). The numbers are read in blocks. If a row
cannot be read, the file is read again line by line, and all faults are told with row and column. If there are none, its
cells are read one by one: pyarrow knows no grouped digits, for instance, and no blanks in place of a value.
"""

from __future__ import annotations

import io
import math
import re
from collections.abc import Collection, Iterator, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, field
from functools import cached_property
from itertools import islice
from pathlib import Path
from typing import Any, BinaryIO

import numpy as np

from rig.errors import UsageError
from rig.printable import counted
from rig.record.imports import clock_times, text_headers
from rig.record.imports.row_faults import NO_CLOCK, NO_NUMBER, NO_TIME_OF_DAY, OPEN_QUOTES, RAGGED, RowFaults
from rig.record.imports.text_form import NO_VALUE, SEPARATORS, Form, cell_of, is_doubtful, is_number, number, split
from rig.record.imports.text_headers import TextHeader
from rig.record.run_data import Reals

_HEADS = (1 << 16, 1 << 20, 1 << 23)
"""Lengths of the part in which the form of the table is looked for, until it has `_ROWS` rows [bytes]."""
_ROWS = 10  # chosen: enough to tell the form of a table
BLOCK = 2 << 20
"""Length of the part of a file that is read at once [bytes]."""
_ISO = re.compile(r"\d{4}-\d\d-\d\d[T ]\d\d:\d\d(?::\d\d(?:\.\d{1,9})?)?")
_LONG = re.compile(r"[-+]?\d{16,19}")
_BACK = clock_times.DAY_NS // 2  # a time of day that falls by more is that of the next day. chosen
_ZEROS = 0.2  # share of bytes that are 0, every second one, in UTF-16 without a mark. chosen


@dataclass(frozen=True)
class TextTable:
    """A table: its form, and the labels of its columns with units ("" where none is stated)."""

    path: Path
    encoding: str
    form: Form
    labels: tuple[str, ...]
    units: tuple[str, ...]
    stamped: tuple[bool, ...]
    """Columns of times of day."""
    left_out: tuple[str, ...]
    """Why a column is not read: it has words, or follows a separator at the end of the rows; "" for the others."""
    first: str
    """The first time of day."""
    of_dates: str
    """The order of day and month in dates with slashes."""
    iso: bool
    """Times of day have the form 2024-01-31 10:00:00.001."""
    about: TextHeader
    """Units, rate and begin that the lines above the table state."""
    long: tuple[bool, ...]
    """Columns of whole numbers that a double does not hold, such as ns since 1970."""
    unnamed: tuple[int, int]
    """Number and cells of the line above the rows whose words are not the names of columns; 0, 0: there is none."""
    day: int | None = None
    """The column with the dates of times of day that have none."""
    midnights: dict[int, int] = field(default_factory=dict)
    """Column of times of day without a date -> how often they passed midnight in what was read last."""

    @property
    def skip(self) -> int:
        """Number of lines before the first row."""
        return self.form.skip

    @cached_property
    def first_ns(self) -> int:
        """The first time of day, in ns since 1970, or since midnight without a date."""
        return clock_times.nanoseconds(self.first, self.of_dates) if self.first else 0

    @property
    def began_ns(self) -> int | None:
        """The wall clock at the first row, in ns since 1970, if the table or the lines above it have dates."""
        is_open = self.of_dates == clock_times.OPEN and clock_times.has_open_date(self.first)
        return self.first_ns if self.first_ns >= clock_times.DAY_NS and not is_open else self.about.began_ns

    @classmethod
    def read(cls, path: Path) -> TextTable:
        """Find the form of the table in a file. Raises UsageError if it contains none, OSError if it is unreadable."""
        for size in _HEADS:
            with path.open("rb") as file:
                head = file.read(size)
            encoding = _encoding(head)
            lines = _lines(head.decode(encoding, errors="replace"))
            if len(head) == size:
                lines.pop()  # may be cut
            while lines and not lines[-1].strip():
                lines.pop()
            form = Form.best(lines)
            if len(head) < size or form.rows >= _ROWS:
                break
        if not any(line.strip() for line in lines):
            raise UsageError(f"{path}: it is empty; expected rows of numbers")
        if not form.rows:
            raise UsageError(
                f"{path}: there is no table of numbers in its first {counted(len(lines), 'line')}; expected rows of "
                f"numbers with one separator of {', '.join(map(repr, SEPARATORS))}"
            )
        text_headers.refuse_segments(path, lines[: form.skip])
        _refuse_commas(path, form, lines)
        labels, units, stamped, left_out = form.described(lines)
        rows = [form.cells(line, i) for i, line in enumerate(lines[form.skip :])]
        day = _day_column(rows, stamped)
        cells = [_dated(row, i, day) for row in rows for i, stamp in enumerate(stamped[: len(row)]) if stamp]
        of_dates = clock_times.order(cells)
        stamps = [cell for cell in cells if clock_times.is_valid(cell, of_dates)]
        about = text_headers.read(lines[: form.skip], form.separator, labels)
        if about.labels:
            labels = tuple(label or f"column {i}" for i, label in enumerate(about.labels, 1))
            units = tuple("s" if stamp else "" for stamp in stamped)
        if day is not None:
            of_clock = ", ".join(label for label, stamp in zip(labels, stamped, strict=True) if stamp)
            told = f"it has dates without a time of day, which those of {of_clock} get"
            left_out = (*left_out[:day], told, *left_out[day + 1 :])
        return cls(
            path,
            encoding,
            form,
            labels,
            tuple(own or stated for own, stated in zip(units, about.units or units, strict=True)),
            stamped,
            left_out,
            stamps[0] if stamps else "",
            of_dates,
            day is None and all(map(_ISO.fullmatch, stamps)),
            about,
            tuple(all(map(_LONG.fullmatch, column)) for column in zip(*_whole_rows(rows[:_ROWS], labels), strict=True)),
            form.unnamed(lines),
            day,
        )

    def blocks(
        self, names: Sequence[str], wanted: Collection[str], cell_by_cell: bool = False
    ) -> Iterator[Mapping[str, Reals]]:
        """Yield the columns `wanted`, of those called `names`, block by block; a value that is not there is NaN.

        Raises UsageError with all rows that are not as the others.
        """
        import pyarrow as pa
        from pyarrow import csv

        of_times = pa.timestamp("ns") if self.iso and not cell_by_cell else pa.string()
        of_numbers = pa.string() if cell_by_cell else pa.float64()
        kinds = {name: of_times if stamped else of_numbers for name, stamped in zip(names, self.stamped, strict=True)}
        if not cell_by_cell:
            kinds |= {name: pa.int64() for name, long in zip(names, self.long, strict=True) if long}
        places = {name: i for i, name in enumerate(names) if self.stamped[i]}
        dates = names[self.day] if self.day is not None and places.keys() & set(wanted) else ""
        read = list(dict.fromkeys([*wanted, *filter(None, [dates])]))
        if dates:
            kinds[dates] = pa.string()
        clocks = {name: _Clock(self, places[name]) for name in wanted if name in places}
        ragged = list[Any]()
        done = 0

        def refuse(row: Any) -> str:
            if row.text.strip():
                ragged.append(row)
            return "skip"

        form = self.form
        as_it_is = form.separator != " " and not form.beside and self.encoding in ("utf-8-sig", "latin-1")
        why = ""
        with self.path.open("rb") as file, file if as_it_is else _Plain(file, self) as source:
            try:
                with csv.open_csv(
                    source,
                    csv.ReadOptions(
                        use_threads=False,
                        block_size=BLOCK,
                        skip_rows=form.skip,
                        column_names=list(names),
                        encoding="utf8" if self.encoding != "latin-1" else "latin1",
                    ),
                    csv.ParseOptions(delimiter=form.separator, invalid_row_handler=refuse),
                    csv.ConvertOptions(
                        column_types={name: kinds[name] for name in read},
                        include_columns=read,
                        decimal_point=form.mark,
                        null_values=list(NO_VALUE),
                        check_utf8=False,
                    ),
                ) as reader:
                    for batch in reader:
                        if ragged:
                            break
                        columns = dict(zip(read, batch.columns, strict=True))  # by name: the square of their number
                        days = columns[dates].to_pylist() if dates else None
                        yield {name: self._values(columns[name], clocks.get(name), days) for name in wanted}
                        done += 1
            except pa.ArrowInvalid as fault:
                why = " ".join(str(fault).split())  # of a cell in quotes, many lines
        if ragged:
            why = f"row {ragged[0].number}: {ragged[0].text!r:.60}"
        if not why:
            return
        if faults := self._faults(names, wanted):
            raise UsageError(faults)
        if ragged or cell_by_cell:
            raise UsageError(f"{self.path}: {why:.200}")
        yield from islice(self.blocks(names, wanted, cell_by_cell=True), done, None)

    def _values(self, column: Any, clock: _Clock | None, days: Sequence[str | None] | None) -> Reals:
        from pyarrow import int64, types

        if types.is_string(column.type) and clock is not None:
            texts = column.to_pylist()
            dated = map(_with_date, texts, days) if days is not None else texts
            return np.array([clock.seconds(text) for text in dated], np.float64)
        if types.is_string(column.type):
            return self._numbers(column)
        if types.is_timestamp(column.type):
            ns = column.cast(int64()).to_numpy(zero_copy_only=False)
            return np.asarray((ns - self.first_ns) * 1e-9, np.float64)
        return np.asarray(column.to_numpy(zero_copy_only=False))

    def _numbers(self, column: Any) -> Reals:
        """The numbers of texts; NaN where there is none."""
        from pyarrow import ArrowInvalid, array, compute, float64

        cells = compute.utf8_trim_whitespace(column)
        known = compute.if_else(compute.is_in(cells, value_set=array(NO_VALUE)), None, cells)
        if self.form.mark == ".":  # all at once, if none needs more
            with suppress(ArrowInvalid):
                return np.asarray(known.cast(float64()).to_numpy(zero_copy_only=False))
        return np.array([self._number(text) for text in column.to_pylist()], np.float64)

    def _number(self, text: str | None) -> float:
        """A number whose digits may be grouped; NaN if there is none. Raises ArrowInvalid, as pyarrow does."""
        cell = cell_of(text or "")
        if cell in NO_VALUE:
            return math.nan
        if not is_number(cell, self.form.mark):
            raise _invalid(f"{cell!r:.40} {NO_NUMBER}")
        return number(cell, self.form.mark)

    def time_fault(self, cell: str) -> str:
        """Why a cell is no time that can be placed among the others, in words that follow it; "" if it is one."""
        if not clock_times.is_time(cell):
            return NO_CLOCK
        if self.day is not None and not clock_times.has_date(cell):
            return "has no date beside it"
        if clock_times.is_short(cell):
            return (
                "may be hours and minutes or minutes and seconds; write three fields, as in 10:05:00, or give the rate "
                "of the samples (--rate) in place of times"
            )
        first = clock_times.has_open_date(self.first)
        if self.of_dates == clock_times.OPEN and clock_times.has_open_date(cell) != first:
            return (
                "may have the day or the month first; write dates as 2024-01-31, or give the rate of the samples "
                "(--rate) in place of times"
            )
        return "" if clock_times.is_valid(cell, self.of_dates) else NO_TIME_OF_DAY

    def _faults(self, names: Sequence[str], wanted: Collection[str]) -> str:
        """All rows that cannot be read, each kind of fault in a line; "" if every row can."""
        faults = RowFaults(self.path)
        segment = list[str]()
        with self.path.open(encoding=self.encoding, errors="replace", newline="") as file:
            for place, line in enumerate(islice(file, self.skip, None), self.skip + 1):
                if text_headers.begins_segment(line):
                    segment.append(text_headers.segment_fault(self.path, place))
                    break
                for column, kind, text in self._of_row(line, place, names, wanted):
                    faults.note(np.array([place]), column, kind, text)
        return "\n".join([*segment, *faults.lines()])

    def rows(self, names: Sequence[str], wanted: Collection[str]) -> Iterator[tuple[int, dict[str, float]]]:
        """Yield number and values of each row, line by line, without what cannot be read; NaN: there is no value."""
        clocks = [_Clock(self, i) if stamped else None for i, stamped in enumerate(self.stamped)]
        with self.path.open(encoding=self.encoding, errors="replace", newline="") as file:
            for place, line in enumerate(islice(file, self.skip, None), self.skip + 1):
                if text_headers.begins_segment(line):
                    return
                cells = self.form.cells(line, place - self.skip - 1)
                values = dict[str, float]()
                for i, name in enumerate(names) if len(cells) == len(names) else ():
                    clock = clocks[i]
                    if name not in wanted:
                        continue
                    if cells[i] in NO_VALUE:
                        values[name] = math.nan
                    elif clock is not None and not self.time_fault(dated := _dated(cells, i, self.day)):
                        values[name] = clock.seconds(dated)
                    elif clock is None and is_number(cells[i], self.form.mark):
                        values[name] = number(cells[i], self.form.mark)
                if values:
                    yield place, values

    def _of_row(
        self, line: str, place: int, names: Sequence[str], wanted: Collection[str]
    ) -> Iterator[tuple[str, str, str]]:
        """Column, kind and text of each fault of a row; the column is "" for the whole row."""
        cells = self.form.cells(line, place - self.skip - 1)
        if not line.strip():
            return
        if line.count('"') % 2:
            yield "", OPEN_QUOTES, OPEN_QUOTES
            return
        if len(cells) != len(names):
            ended = " (the file ends in the middle of it)" if not line.endswith(("\n", "\r")) else ""
            other = self._other_separator(line, len(names))
            hint = f"; with {other!r} in place of {self.form.separator!r} it would be right" if other else ""
            yield "", RAGGED, f"{counted(len(cells), 'value')}, the other rows have {len(names)}{ended}{hint}"
            return
        for i, (name, cell) in enumerate(zip(names, cells, strict=True)):
            if name not in wanted or cell in NO_VALUE:
                continue
            if self.stamped[i]:
                dated = _dated(cells, i, self.day)
                if kind := self.time_fault(dated):
                    yield name, kind, f"{dated!r:.40} {kind}"
            elif not is_number(cell, self.form.mark):
                doubt = "; are its digits grouped? Write them without groups" if is_doubtful(cell) else ""
                kind = f"{NO_NUMBER}{doubt}"
                yield name, kind, f"{cell!r:.40} {kind}"

    def _other_separator(self, line: str, width: int) -> str:
        """The separator with which a line has `width` numbers; "" if there is none."""
        for separator in SEPARATORS:
            if separator != self.form.separator:
                cells = split(line, separator)
                if len(cells) == width and all(is_number(cell, self.form.mark) for cell in cells):
                    return separator
        return ""


class _Clock:
    """Reads the times of day of one column, row by row; without a date they go on past midnight."""

    def __init__(self, table: TextTable, column: int) -> None:
        self._table = table
        self._column = column
        self._last = table.first_ns
        table.midnights[column] = 0

    def seconds(self, text: str | None) -> float:
        """A time of day as seconds since the first one; NaN if there is none. Raises ArrowInvalid, as pyarrow does."""
        table = self._table
        cell = (text or "").strip()
        if cell in NO_VALUE:
            return math.nan
        if fault := table.time_fault(cell):
            raise _invalid(f"{cell!r:.40} {fault}")
        ns = clock_times.nanoseconds(cell, table.of_dates)
        if not clock_times.has_date(cell):
            ns += table.midnights[self._column] * clock_times.DAY_NS
            if ns < self._last - _BACK:
                ns += clock_times.DAY_NS
                table.midnights[self._column] += 1
            self._last = ns
        return (ns - table.first_ns) * 1e-9


def _refuse_commas(path: Path, form: Form, lines: Sequence[str]) -> None:
    """Refuse numbers with a decimal comma that commas separate: "0,001,1,500"."""
    if form.separator != ",":
        return
    row, names = form.unnamed(lines)
    if form.width == 2 * names:
        found = f"row {row} has {names} names, the rows have {form.width} cells"
    elif not form.headed and form.has_decimals_alone(lines):
        found = f"row {form.skip + 1} has {lines[form.skip]!r:.40}"
    else:
        return
    raise UsageError(
        f"{path}: {found}: the comma separates the cells and is the decimal mark too; write decimal points, or "
        "separate the cells by semicolons"
    )


def _day_column(rows: Sequence[Sequence[str]], stamped: Sequence[bool]) -> int | None:
    """The only column of dates, if a column has times of day without a date; else None."""
    columns = [*zip(*_whole_rows(rows, stamped), strict=True)]
    clocks = [cell for column, stamp in zip(columns, stamped, strict=False) if stamp for cell in column]
    if not any(map(clock_times.is_time, clocks)) or any(map(clock_times.has_date, clocks)):
        return None
    days = []
    for i, column in enumerate(columns):
        stated = [cell for cell in column if cell not in NO_VALUE]
        if stated and all(map(clock_times.is_date, stated)):
            days.append(i)
    return days[0] if len(days) == 1 else None


def _whole_rows(rows: Sequence[Sequence[str]], columns: Sequence[object]) -> Iterator[Sequence[str]]:
    """The rows with a cell for each of the columns."""
    return (row for row in rows if len(row) == len(columns))


def _dated(cells: Sequence[str], column: int, day: int | None) -> str:
    """The cell of a time of day, with the date that stands beside it."""
    return cells[column] if day is None else _with_date(cells[column], cells[day])


def _with_date(clock: str | None, day: str | None) -> str:
    """A time of day with a date; "" where there is none."""
    return f"{day or ''} {clock}".strip() if clock and clock.strip() not in NO_VALUE else ""


def _invalid(text: str) -> Exception:
    from pyarrow import ArrowInvalid

    fault: Exception = ArrowInvalid(text)
    return fault


def _lines(text: str) -> list[str]:
    """The lines of a text, which ends with the last of them, as files have them."""
    return text.replace("\r\n", "\n").replace("\r", "\n").removesuffix("\n").split("\n")


def _encoding(head: bytes) -> str:
    if head.startswith((b"\xff\xfe\0\0", b"\0\0\xfe\xff")):
        return "utf-32"
    if head.startswith((b"\xff\xfe", b"\xfe\xff")):
        return "utf-16"
    for first, name in ((1, "utf-16-le"), (0, "utf-16-be")):
        if head[first::2].count(0) > 2.0 * _ZEROS * len(head[first::2]) and head[1 - first :: 2].count(0) == 0:
            return name
    try:
        head[:-4].decode("utf-8")
    except UnicodeDecodeError:
        return "latin-1"
    return "utf-8-sig"


class _Plain(io.RawIOBase):
    """The bytes of a file in UTF-8, without remarks beside the first rows, with one blank where blanks separate."""

    def __init__(self, file: BinaryIO, table: TextTable) -> None:
        self._text = io.TextIOWrapper(file, table.encoding, newline="")
        self._form = table.form
        self._line = 0
        self._left = b""

    def readable(self) -> bool:
        """Yes."""
        return True

    def close(self) -> None:
        """Close the file too."""
        self._text.close()
        super().close()

    def readinto(self, buffer: Any) -> int:
        """Fill the buffer with whole lines as far as they fit."""
        if not self._left:
            lines = self._text.readlines(len(buffer))
            self._left = "".join(map(self._plain, lines)).encode()
        part = self._left[: len(buffer)]
        self._left = self._left[len(buffer) :]
        buffer[: len(part)] = part
        return len(part)

    def _plain(self, line: str) -> str:
        """A line as the others are."""
        row = self._line - self._form.skip
        self._line += 1
        if 0 <= row < self._form.beside:
            return self._form.separator.join(self._form.cells(line, row)) + "\n"
        return " ".join(line.split()) + "\n" if self._form.separator == " " else line
