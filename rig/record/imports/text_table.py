"""A table of numbers in a text file, as data acquisition systems write it.

Separator, decimal comma, lines before the table, names and units are found from the first lines: the separator is the
one with which the most lines, up to the last of them, are rows of numbers. The numbers are read in blocks. If a row
cannot be read, the file is read again line by line, and all faults are told with row and column.
"""

from __future__ import annotations

import io
import re
from collections.abc import Collection, Iterator, Mapping, Sequence
from dataclasses import dataclass
from itertools import islice
from pathlib import Path
from typing import Any, BinaryIO

import numpy as np

from rig.errors import UsageError
from rig.record.run_data import Reals

_SEPARATORS = (";", "\t", ",", "|", " ")
_HEAD = 1 << 16
"""Length of the part in which the form of the table is looked for [bytes]."""
BLOCK = 2 << 20
"""Length of the part of a file that is read at once [bytes]."""
_MOST = 20
"""Number of faults that are told; further ones are counted."""
_NO_VALUE = ("", "nan", "NaN", "NAN", "NA", "n/a", "N/A", "null", "-")
_NUMBER = {
    mark: re.compile(rf"[-+]?(?:\d+(?:{re.escape(mark)}\d*)?|{re.escape(mark)}\d+)(?:[eE][-+]?\d+)?|[-+]?[iI]nf")
    for mark in ".,"
}
_TIME = re.compile(r"\d{4}-\d\d-\d\d[T ]\d\d:\d\d(?::\d\d(?:[.,]\d{1,9})?)?Z?")
_UNIT_LINE = re.compile(r"[\[(].*[\])]|[-%°µμ\w^/*·]{1,12}|")


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
    began_ns: int | None
    """The first time of day, in ns since 1970."""

    @classmethod
    def read(cls, path: Path) -> TextTable:
        """Find the form of the table in a file. Raises UsageError if it contains none, OSError if it is unreadable."""
        with path.open("rb") as file:
            head = file.read(_HEAD)
        encoding = _encoding(head)
        lines = head.decode(encoding, errors="replace").splitlines()
        if len(head) == _HEAD:
            lines.pop()  # may be cut
        while lines and not lines[-1].strip():
            lines.pop()
        forms = [(separator, mark) for separator in _SEPARATORS for mark in ".," if separator != mark]
        form = max((_Form.of(lines, *form) for form in forms), key=lambda form: form.merit)
        if not form.rows:
            raise UsageError(
                f"{path}: there is no table of numbers in its first {len(lines)} lines; expected rows of numbers "
                f"with one separator of {', '.join(map(repr, _SEPARATORS))}"
            )
        stamps = [text for text in form.split(lines[form.skip]) if _TIME.fullmatch(text)]
        began = int(np.datetime64(stamps[0].rstrip("Z").replace(",", "."), "ns").astype(np.int64)) if stamps else None
        return cls(path, encoding, form.separator, form.mark, form.skip, *form.described(lines), began)

    def blocks(self, names: Sequence[str], wanted: Collection[str]) -> Iterator[Mapping[str, Reals]]:
        """Yield the columns `wanted`, of those called `names`, block by block; a value that is not there is NaN.

        Raises UsageError with all rows that are not as the others.
        """
        import pyarrow as pa
        from pyarrow import csv

        kinds = {
            name: pa.timestamp("ns") if stamped else pa.float64()
            for name, stamped in zip(names, self.stamped, strict=True)
        }
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
                        use_threads=False, block_size=BLOCK, skip_rows=self.skip, column_names=list(names),
                        encoding="utf8" if self.encoding != "latin-1" else "latin1",
                    ),
                    csv.ParseOptions(delimiter=self.separator, invalid_row_handler=refuse),
                    csv.ConvertOptions(
                        column_types={name: kinds[name] for name in wanted},
                        include_columns=list(wanted),
                        decimal_point=self.decimal,
                        null_values=list(_NO_VALUE),
                        check_utf8=False,
                    ),
                ) as reader:  # fmt: skip
                    for batch in reader:
                        if ragged:
                            break
                        yield {name: self._values(batch.column(name)) for name in wanted}
            except pa.ArrowInvalid as fault:
                raise UsageError(self._faults(names, wanted) or f"{self.path}: {fault}") from None
        if ragged:
            raise UsageError(self._faults(names, wanted))

    def _values(self, column: Any) -> Reals:
        from pyarrow import int64, types

        if types.is_timestamp(column.type):
            ns = column.cast(int64()).to_numpy(zero_copy_only=False)
            return np.asarray((ns - self.began_ns) * 1e-9, np.float64)
        return np.asarray(column.to_numpy(zero_copy_only=False), np.float64)

    def _faults(self, names: Sequence[str], wanted: Collection[str]) -> str:
        """All rows that cannot be read, one a line."""
        told, count = list[str](), 0
        with self.path.open(encoding=self.encoding, errors="replace", newline="") as file:
            for number, line in enumerate(islice(file, self.skip, None), self.skip + 1):
                for fault in self._of_row(line, names, wanted):
                    count += 1
                    if count <= _MOST:
                        told.append(f"{self.path}: row {number}: {fault}")
        return "\n".join([*told, f"... and {count - _MOST} more"] if count > _MOST else told)

    def _of_row(self, line: str, names: Sequence[str], wanted: Collection[str]) -> Iterator[str]:
        cells, text = _split(line, self.separator), line.strip()
        if not text:
            return
        if len(cells) != len(names):
            ended = " (the file ends in the middle of it)" if not line.endswith(("\n", "\r")) else ""
            others = [s for s in _SEPARATORS if s != self.separator and len(_split(line, s)) == len(names)]
            hint = f"; with {others[0]!r} in place of {self.separator!r} it would be right" if others else ""
            yield f"{len(cells)} values, the other rows have {len(names)}{ended}{hint}"
            return
        for name, cell, stamped in zip(names, cells, self.stamped, strict=True):
            right = _TIME if stamped else _NUMBER[self.decimal]
            if name in wanted and cell not in _NO_VALUE and not right.fullmatch(cell):
                yield f"column {name}: {cell!r:.40} is not a {'time' if stamped else 'number'}"


class _Form:
    """How a text would be read with a separator and a decimal mark."""

    def __init__(self, separator: str, mark: str) -> None:
        self.separator, self.mark = separator, mark
        self.rows = self.skip = self.width = 0
        self.headed = False

    @classmethod
    def of(cls, lines: Sequence[str], separator: str, mark: str) -> _Form:
        """Find the rows: the longest block of lines with one number of columns, all of which are values."""
        form, begin, width = cls(separator, mark), 0, -1
        widths = [form._width_of(line) for line in lines]
        for i, here in enumerate([*widths, -1]):
            if here < 0 or here != width:
                if width >= 0 and i - begin > form.rows:
                    form.rows, form.skip, form.width = i - begin, begin, width
                begin, width = i, here
        form._skip_to_header(lines, widths)
        form.headed = form.rows > 0 and form.skip > 0 and len(form.split(lines[form.skip - 1])) == form.width
        return form

    def _width_of(self, line: str) -> int:
        """The number of values of a row; -1 for a line that is none."""
        cells = self.split(line)
        known = [self._is_value(cell) for cell in cells]
        return (
            len(cells) if any(known) and all(map(lambda cell, value: value or cell in _NO_VALUE, cells, known)) else -1
        )

    def _skip_to_header(self, lines: Sequence[str], widths: Sequence[int]) -> None:
        """Begin below an earlier header, if most lines from there on are rows: the other ones are faults."""
        for i in range(1, self.skip):
            rows = widths[i : self.skip]
            headed = widths[i - 1] < 0 and len(self.split(lines[i - 1])) == self.width
            if headed and rows[0] == self.width and 2 * rows.count(self.width) >= len(rows):
                self.skip, self.rows = i, self.rows + rows.count(self.width)
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

    def described(self, lines: Sequence[str]) -> tuple[tuple[str, ...], tuple[str, ...], tuple[bool, ...]]:
        """Labels, units and which columns are times of day."""
        above = [self.split(line.lstrip("#%! ")) for line in lines[max(self.skip - 2, 0) : self.skip]]
        above = [cells for cells in above if len(cells) == self.width and not all(map(self._is_value, cells))]
        units = [""] * self.width
        if len(above) == 2 and all(map(_UNIT_LINE.fullmatch, above[1])) and all(above[0]):
            units = [cell.strip("[]() ") for cell in above.pop()]
        labels = above[-1] if above else [""] * self.width
        stamped = tuple(bool(_TIME.fullmatch(cell)) for cell in self.split(lines[self.skip]))
        units = ["s" if stamp else unit for unit, stamp in zip(units, stamped, strict=True)]
        return tuple(label or f"column {i}" for i, label in enumerate(labels, 1)), tuple(units), stamped


def _split(line: str, separator: str) -> list[str]:
    cells = line.split() if separator == " " else line.rstrip("\r\n").split(separator)
    return [cell.strip().strip('"') for cell in cells]


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
        part, self._left = self._left[: len(buffer)], self._left[len(buffer) :]
        buffer[: len(part)] = part
        return len(part)
