"""The form of a table in a text: separator, decimal mark, where its rows begin, names and units of its columns.

The form is the one with which the most lines, up to the last of them, are rows of numbers; columns of words are allowed
only if there is no table without them.
"""

from __future__ import annotations

import csv as cells_of
import re
from collections.abc import Sequence
from itertools import groupby, takewhile

from rig.record.imports import clock_times
from rig.record.imports.instrument_units import is_unit

SEPARATORS = (";", "\t", ",", "|", " ")
NO_VALUE = (
    *("", "nan", "NaN", "NAN", "NA", "n/a", "N/A", "null", "NULL", "None", "-", "--", "---"),
    *("#N/A", "#NV", "#DIV/0!", "1.#QNAN", "-1.#IND", "1.#IND", "-1.#QNAN"),
)
"""What stands where there is no value."""
_SHOWN = 100  # rows that tell what a column is. chosen
_HEADINGS = 60  # lines above the rows in which names with units in brackets are looked for. chosen
_UNITS_ABOVE = 5  # the same of a line of names above a line of units. chosen
_END = "***"  # of a header of LabVIEW
_TABLE = 3  # lines of numbers with as many cells are a table of their own. chosen
_EXPONENT = r"(?:[eEdD][-+]?\d+)?"  # D: of Fortran
_MINUS = "\u2212"  # of typeset numbers
# Characters that group the digits of a number, by its decimal mark
_BLANKS = "\u2019\xa0\u2007\u2009\u202f "
_GROUPS = {".": f",'{_BLANKS}", ",": f".'{_BLANKS}"}
_PLAIN = {
    mark: re.compile(rf"[-+]?(?:\d+(?:{re.escape(mark)}\d*)?|{re.escape(mark)}\d+){_EXPONENT}|[-+]?[iI]nf")
    for mark in ".,"
}
# 1.234,5 and 1.234.567: in 1.234 the point may be a decimal mark
_GROUPED = {
    mark: re.compile(
        rf"[-+]?\d{{1,3}}([{groups}])\d{{3}}(?:(?:\1\d{{3}})+(?:{re.escape(mark)}\d*)?|{re.escape(mark)}\d*){_EXPONENT}"
    )
    for mark, groups in _GROUPS.items()
}
_EITHER = re.compile(r"[-+]?[1-9]\d{0,2}[.,]\d{3}")
_UNIT_LINE = re.compile(r"[\[(].*[\])]|[-%°µμΩ²³⁻¹\"\w^/*·. ]{1,16}|")
_KEY = re.compile(r"[a-z] [a-z]|unit", re.IGNORECASE)
_NAMES = ("t", "T", "F", "d", "h", "l", "L", "H", "1")  # of quantities and channels more often than of units
_IN_BRACKETS = re.compile(r".*\S\s*[\[(]([^\])]*)[\])]\s*")
_BEFORE_BRACKET = re.compile(r"\s+(?=[\[(])")


def is_number(cell: str, mark: str) -> bool:
    """Whether a cell is a number with this decimal mark, whose digits may be grouped."""
    return bool(_PLAIN[mark].fullmatch(cell) or _GROUPED[mark].fullmatch(cell))


def is_doubtful(cell: str) -> bool:
    """Whether the mark in a number may be a decimal mark or group its digits: 1.234."""
    return _EITHER.fullmatch(cell) is not None


def number(cell: str, mark: str) -> float:
    """The number of a cell for which `is_number` holds."""
    return float(ungrouped(cell, mark).replace(mark, ".").replace("D", "e").replace("d", "e"))


def ungrouped(cell: str, mark: str) -> str:
    """A number without the characters that group its digits."""
    match = _GROUPED[mark].fullmatch(cell)
    return cell.replace(match[1], "") if match else cell


def cell_of(text: str) -> str:
    """A cell without the blanks around it, with the minus sign that numbers have."""
    return text.strip().replace(_MINUS, "-")


def split(line: str, separator: str) -> list[str]:
    """The cells of a line."""
    line = line.rstrip("\r\n").replace(_MINUS, "-")
    if '"' in line:
        line = " ".join(line.split()) if separator == " " else line
        return [cell.strip() for cell in next(cells_of.reader([line], delimiter=separator, skipinitialspace=True), [])]
    cells = line.split() if separator == " " else line.split(separator)
    return [cell.strip() for cell in cells]


class Form:
    """How a text is read with a separator and a decimal mark: `skip` lines, then rows of `width` cells.

    `beside`: number of the first rows that have more cells, such as remarks, of which only `width` are read. `ended`:
    number of the cells without a value at the end of the first row. `unread`: number of the lines above the rows that
    begin with a number too, or are another table.
    """

    def __init__(self, separator: str, mark: str, words: bool) -> None:
        self.separator = separator
        self.mark = mark
        self.words = words
        self.rows = self.skip = self.width = self.beside = self.ended = self.unread = 0
        self.headed = False
        self.fitting = 0
        """Cells of the first rows that are values, minus those that are words."""

    @classmethod
    def best(cls, lines: Sequence[str]) -> Form:
        """The form with most rows; a table in which each row has a word, such as a state, only if there is no other."""
        text = "\n".join(lines)
        present = [separator for separator in SEPARATORS if separator == ";" or separator in text]
        forms = [(separator, mark) for separator in present for mark in ".,"]
        form = max((cls.of(lines, *form, words=False) for form in forms), key=lambda form: form.merit)
        if not form.rows:
            parted = [(separator, mark) for separator, mark in forms if separator != " "]
            form = max((cls.of(lines, *form, words=True) for form in parted), key=lambda form: form.merit)
            if form.rows < 2 or all(form.described(lines)[-1]):
                form.rows = 0
        return form

    @classmethod
    def of(cls, lines: Sequence[str], separator: str, mark: str, words: bool) -> Form:
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
        if form.rows:
            form._skip_to_remarks(lines)
            form._count_unread(lines, widths)
            form.ended = len([*takewhile(lambda cell: not cell, reversed(form._cells(lines[form.skip + form.beside])))])
            form.headed = form.skip > 0 and form.heading(lines[form.skip - 1]) is not None
            form.fitting = sum(1 if form._is_value(cell) else -1 for cell in form._first_cells(lines) if cell)
        return form

    def cells(self, line: str, row: int) -> list[str]:
        """The cells of row `row`, counted from 0; without the remarks beside the first rows."""
        cells = self._cells(line)
        return cells[: self.width] if row < self.beside else cells

    def described(
        self, lines: Sequence[str]
    ) -> tuple[tuple[str, ...], tuple[str, ...], tuple[bool, ...], tuple[str, ...]]:
        """Labels, units, which columns are times of day, and why columns are not read ("" for those that are)."""
        headings = self._headings(lines)
        units = [""] * self.width
        fullest = max(headings[:_UNITS_ABOVE], key=_filled, default=[""] * self.width)
        labels = next((cells for cells in headings if _have_units(cells)), fullest)
        if not _have_units(labels):
            for named, stated in zip(headings[1:_UNITS_ABOVE], headings, strict=False):
                if _are_units(stated) and _filled(named) >= max(_filled(stated), self.width - self.ended):
                    units = [cell.strip("[]() ") for cell in stated]
                    labels = named
                    break
        if all(cell[:1] in ("", "[", "(") for cell in labels) and _are_units(labels):  # units alone
            units = [cell.strip("[]() ") for cell in labels]
            labels = [""] * self.width
        columns = self._columns(lines)
        stamped = tuple(map(self._is_stamped, columns))
        left_out = tuple(self._left_out(label, column) for label, column in zip(labels, columns, strict=True))
        units = ["s" if stamp else unit for unit, stamp in zip(units, stamped, strict=True)]
        return (
            tuple(label.rstrip(": ") or f"column {i}" for i, label in enumerate(labels, 1)),
            tuple(units),
            stamped,
            left_out,
        )

    def has_decimals_alone(self, lines: Sequence[str]) -> bool:
        """Whether every second column has digits as decimals have (0,001,1,500): one length, some with a zero first."""
        columns = self._columns(lines)[1::2]
        return self.width % 2 == 0 and all(map(_are_decimals, columns))

    def unnamed(self, lines: Sequence[str]) -> tuple[int, int]:
        """Number and cells of the last line above the rows, if its words are not the names of columns; else 0, 0."""
        above = [i for i, line in enumerate(lines[: self.skip], 1) if line.strip()]
        if self._headings(lines) or not above:
            return 0, 0
        cells = self._cells(lines[above[-1] - 1])
        words = len(cells) > 1 and not any(map(self._is_value, cells))
        return (above[-1], len(cells)) if words else (0, 0)

    @property
    def merit(self) -> tuple[int, bool, bool, int, int]:
        """A form is better with more rows, a header of the same width, a separator that is no blank, more values.

        More values means fewer words too; of equal ones the form with more columns is better.
        """
        return self.rows, self.headed, self.separator != " ", self.fitting, self.width

    def heading(self, line: str) -> list[str] | None:
        """The cells of a line above the rows, of which only one may end with a separator; None: it is no heading.

        Numbers with a decimal mark, such as the increment of an oscilloscope, are no names.
        """
        line = line.lstrip("#%! ")
        cells = self._cells(line)
        if self.separator == " " and len(cells) > self.width:  # t [s] v [m/s]
            cells = self._other_heading(line) or self._cells(_BEFORE_BRACKET.sub("", line))
        if len(cells) == self.width + 1 and cells[-1] in ("", "Comment"):  # of LabVIEW: rows may lack the last cell
            cells.pop()
        if self.width - self.ended <= len(cells) < self.width:
            cells += [""] * (self.width - len(cells))
        if self.beside and len(cells) > self.width:
            cells = cells[: self.width]
        first = next(filter(None, cells), "")
        if len(cells) != self.width or not first or self._is_value(first):
            return None
        return ["" if self._is_value(cell) and not cell.isdigit() else cell for cell in cells]

    def _headings(self, lines: Sequence[str]) -> list[list[str]]:
        """The cells of the lines above the rows that may have names or units, from the rows upwards."""
        blank = f"{self.separator} "
        above = [line for line in lines[max(self.skip - _HEADINGS, 0) : self.skip] if line.strip(blank)]
        headings = list[list[str]]()
        for line in reversed(self._joined(above)):
            cells = self.heading(line) or (None if headings else self._other_heading(line))
            if cells is None or line.startswith(_END):
                break
            headings.append(cells)
        return headings

    def _other_heading(self, line: str) -> list[str] | None:
        """The names of a line with another separator than the rows have: "# t, v" above rows with blanks."""
        for separator in SEPARATORS:
            cells = split(line.lstrip("#%! "), separator)
            if separator != " " and len(cells) == self.width > 1 and not any(map(self._is_value, cells)):
                return cells
        return None

    def _joined(self, lines: Sequence[str]) -> list[str]:
        """Lines of which those between two quotes are one."""
        opened = re.compile(rf'(?:^|{re.escape(self.separator)})\s*"')
        joined = list[str]()
        for line in lines:
            if joined and joined[-1].count('"') % 2 and opened.search(joined[-1]):
                joined[-1] += f" {line}"
            else:
                joined.append(line)
        return joined

    def _cells(self, line: str) -> list[str]:
        return split(line, self.separator)

    def _first_rows(self, lines: Sequence[str]) -> list[list[str]]:
        rows = [self.cells(line, i) for i, line in enumerate(lines[self.skip : self.skip + self.beside + _SHOWN])]
        return [cells for cells in rows if len(cells) == self.width]

    def _first_cells(self, lines: Sequence[str]) -> list[str]:
        return [cell for cells in self._first_rows(lines) for cell in cells]

    def _columns(self, lines: Sequence[str]) -> list[tuple[str, ...]]:
        return list(zip(*self._first_rows(lines), strict=True))

    def _width_of(self, line: str) -> int:
        """The number of values of a row; -1 for a line that is none."""
        cells = self._cells(line)
        known = [self._is_value(cell) for cell in cells]
        if not any(known):
            return -1
        if self.words:
            return len(cells) if len(cells) > 1 else -1
        unknown = [cell for cell, value in zip(cells, known) if not value]
        return len(cells) if all(map(_belongs, unknown)) else -1

    def _is_value(self, cell: str) -> bool:
        return is_number(cell, self.mark) or clock_times.is_time(cell)

    def _is_stamped(self, column: Sequence[str]) -> bool:
        """Whether a column has times of day: more of them than numbers."""
        stamps = sum(map(clock_times.is_time, column))
        return stamps > sum(is_number(cell, self.mark) for cell in column)

    def _left_out(self, label: str, column: Sequence[str]) -> str:
        """Why a column is not read; "" if enough cells are values, or if a labelled one says that there is none."""
        values = sum(map(self._is_value, column))
        stated = [cell for cell in column if cell not in NO_VALUE]
        if doubtful := self._doubtful(stated):
            plain = doubtful.replace(".", "").replace(",", "")
            decimal = doubtful.replace(".", self.mark).replace(",", self.mark)
            return f"{doubtful} may be {plain} or {decimal}0; write it as one of these"
        if (values and (2 * values > len(column) * self.words or values == len(stated))) or (label and not stated):
            return ""
        if not stated:
            return "it has no values"
        other = "." if self.mark == "," else ","
        if all(is_number(cell, other) for cell in stated):
            return f"its decimal mark is {other!r}, that of other columns {self.mark!r}, such as in {stated[0]!r:.40}"
        if all(map(clock_times.is_date, stated)):
            return "it has dates without a time of day"
        return f"it has words, no numbers, such as {next(cell for cell in stated if not self._is_value(cell))!r:.40}"

    def _doubtful(self, stated: Sequence[str]) -> str:
        """A number whose mark may group its digits: no decimal mark here, or one that smaller numbers lack; else ""."""
        doubtful = [cell for cell in stated if is_doubtful(cell)]
        other = next((cell for cell in doubtful if self.mark not in cell), "")
        marked = [cell for cell in stated if self.mark in cell]
        small = [cell for cell in stated if cell.lstrip("+-").isdigit()]
        if other or len(marked) != len(doubtful) or len(small) + len(marked) < len(stated) or not small:
            return other
        return doubtful[0] if doubtful and max(len(cell.lstrip("+-")) for cell in small) <= 3 else ""

    def _skip_to_header(self, lines: Sequence[str], widths: Sequence[int]) -> None:
        """Begin below an earlier header, if most lines from there on are rows: the other ones are faults."""
        for i in range(1, self.skip):
            rows = widths[i : self.skip]
            above = next((line for line in reversed(lines[:i]) if line.strip()), "")
            headed = widths[i - 1] < 0 and len(self._cells(above)) == self.width
            if headed and rows[0] == self.width and 2 * rows.count(self.width) >= len(rows):
                self.skip = i
                self.rows += rows.count(self.width)
                return

    def _skip_to_remarks(self, lines: Sequence[str]) -> None:
        """Begin with the first rows that have remarks beside their values, or a word in place of one below a header.

        Remarks stand where the other rows have nothing, or behind their last cell. The words are faults.
        """
        filled = [any(map(self._is_value, column)) for column in self._columns(lines)]
        rows = [self._cells(line) for line in lines[: self.skip]]
        remarked = [
            *takewhile(lambda cells: self._is_remarked(cells, filled) or self._is_faulty(cells, filled), reversed(rows))
        ]
        above = rows[-len(remarked) - 1] if len(remarked) < len(rows) else []
        if len(above) < self.width or any(map(self._is_value, above)):  # without a header only remarks are sure
            remarked = [*takewhile(lambda cells: self._is_remarked(cells, filled), reversed(rows))]
        self.beside = len(remarked) if any(len(cells) > self.width for cells in remarked) else 0
        self.rows += len(remarked)
        self.skip -= len(remarked)

    def _count_unread(self, lines: Sequence[str], widths: Sequence[int]) -> None:
        """Count the lines directly above the rows that begin with a number, and those of other tables above them."""
        begins = (next(filter(None, self._cells(line)), "") for line in reversed(lines[: self.skip]))
        near = len([*takewhile(self._is_value, begins)])
        runs = [(width, len([*run])) for width, run in groupby(widths[: self.skip - near])]
        far = sum(count for width, count in runs if width > 0 and count >= _TABLE)
        self.unread = near + far

    def _is_remarked(self, cells: Sequence[str], filled: Sequence[bool]) -> bool:
        """Whether a line has values in the columns that are `filled`, and words only beside them."""
        beside = [cell for cell in cells[self.width :] if cell not in NO_VALUE]
        if len(cells) < self.width or (beside and all(map(self._is_value, beside))):
            return False
        inside = [cell for cell, value in zip(cells, filled, strict=False) if value]
        return any(map(self._is_value, inside)) and all(
            self._is_value(cell) or cell in NO_VALUE or is_doubtful(cell) for cell in inside
        )

    def _is_faulty(self, cells: Sequence[str], filled: Sequence[bool]) -> bool:
        """Whether a line has as many cells as the others, and a value in the first column that is `filled`."""
        return len(cells) == self.width and True in filled and self._is_value(cells[filled.index(True)])


def _are_decimals(column: Sequence[str]) -> bool:
    """Whether the cells of a column are digits of one length, some of them with a zero first."""
    whole = all(map(str.isdigit, column)) and len(set(map(len, column))) == 1
    return whole and len(column[0]) > 1 and any(cell.startswith("0") for cell in column)


def _filled(cells: Sequence[str]) -> int:
    """How many cells are not empty."""
    return sum(map(bool, cells))


def _belongs(cell: str) -> bool:
    """Whether a cell that is no value may stand in a row of numbers."""
    return cell in NO_VALUE or clock_times.is_date(cell) or is_doubtful(cell)


def _have_units(cells: Sequence[str]) -> bool:
    """Whether most names of a line have a unit in brackets that is known."""
    stated = [match[1] for cell in cells if (match := _IN_BRACKETS.fullmatch(cell))]
    return 2 * sum(map(is_unit, stated)) > sum(map(bool, cells))


def _are_units(cells: Sequence[str]) -> bool:
    """Whether a line below the names has their units: short, and at least half of them are known.

    Two words, "Vertical Units", are no unit that is unknown.
    """
    stated = [cell.strip("[]() ") for cell in cells if cell.strip("[]() ")]
    known = [cell for cell in stated if is_unit(cell) and cell not in _NAMES]
    words = [cell for cell in stated if _KEY.search(cell) and not is_unit(cell)]
    return bool(stated) and not words and all(map(_UNIT_LINE.fullmatch, cells)) and 2 * len(known) >= len(stated)
