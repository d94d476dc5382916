"""What every result has: lines and tables, from which its text, HTML, CSV and JSON are made, and a figure.

A class of results states once what it shows. A table has columns with a name, a unit and digits. Its text, its HTML and
its CSV have the same heads, and its records in JSON have the names of the columns as keys.

A class of results names the function that draws it in `FIGURE`. Commands write what `plot` returns to the file of
`--figure`, so that both are one picture.
"""

from __future__ import annotations

import base64
import csv
import html
import importlib
import io
import math
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, ClassVar, NamedTuple

from rig.errors import RigError, UsageError
from rig.printable import columns, with_unit

if TYPE_CHECKING:
    from matplotlib.figure import Figure

_HEAD = 40
"""Most lines that Python prints of a result. # chosen"""
_CELL = 'style="text-align:{};white-space:pre;padding:0 1.2em 0 0"'
"""Style of a cell of a table."""
_NOTHING = "-"
"""A missing value in a text."""
_NONE = "none"
"""A list without values in a text."""


class Column(NamedTuple):
    """A column of a table: its name, the unit of its values, and the digits of a number in a text; "": it has texts.

    `shown`: the unit in a text, if it is another one, of the size `scale` in `unit`.
    """

    name: str
    unit: str = ""
    digits: str = ""
    shown: str = ""
    scale: float = 1.0

    @property
    def head(self) -> str:
        """The name with the unit in a text."""
        return with_unit(self.name, self.shown or self.unit)

    @property
    def side(self) -> str:
        """The side on which its cells are aligned: texts left, numbers right."""
        return ">" if self.digits else "<"

    def cell(self, value: Any) -> str:
        """Return a value as text: a tuple of two as a range, a list as its values or "none", "-" for None and NaN."""
        if isinstance(value, str):
            return value
        if isinstance(value, bool):
            return "yes" if value else "no"
        if isinstance(value, list | tuple):
            return (" to " if isinstance(value, tuple) else ", ").join(map(self.cell, value)) or _NONE
        return _NOTHING if value is None or math.isnan(value) else format(value / self.scale, self.digits)


@dataclass(frozen=True)
class Table:
    """Rows of values with typed columns; `name` is its key in JSON.

    `most`: number of rows in a text; CSV and JSON have all.
    """

    name: str
    columns: Sequence[Column]
    rows: Sequence[Sequence[Any]]
    most: int | None = None

    def cells(self) -> dict[Column, list[str]]:
        """Return the columns of a text with their cells; a column without any text is left out."""
        rows = self.rows[: self.most]
        cells = {}
        for k, column in enumerate(self.columns):
            texts = [column.cell(row[k]) for row in rows]
            if any(texts):
                cells[column] = texts
        return cells

    @property
    def left_out(self) -> str:
        """How many rows a text leaves out, in words; "" if none."""
        left = len(self.rows[self.most :]) if self.most is not None else 0
        return f"  and {left} more" if left else ""

    def text(self) -> str:
        """Return the table as lines."""
        cells = self.cells()
        heads = [column.head for column in cells]
        lines = columns([heads, *zip(*cells.values())], "".join(column.side for column in cells))
        return "\n".join([*lines, *filter(None, [self.left_out])])

    def html(self) -> str:
        """Return the table as HTML."""
        cells = self.cells()
        styles = [_CELL.format("right" if column.digits else "left") for column in cells]
        heads = _row("th", styles, [column.head for column in cells])
        rows = [heads, *(_row("td", styles, row) for row in zip(*cells.values()))]
        return f'<table style="font-size:inherit">{"".join(rows)}</table>{_paragraph(self.left_out)}'

    def csv(self) -> str:
        """Return the table as CSV: the unit of the values in the head, numbers with all digits."""
        text = io.StringIO()
        writer = csv.writer(text, lineterminator="\n")
        writer.writerow(with_unit(column.name, column.unit) for column in self.columns)
        writer.writerows(map(_csv_row, self.rows))
        return text.getvalue()

    def records(self) -> list[dict[str, Any]]:
        """Return each row as name -> value."""
        names = [column.name for column in self.columns]
        return [dict(zip(names, row, strict=True)) for row in self.rows]


class Result:
    """A result with `text`, `plot`, `csv`, `to_json` and an HTML form."""

    FIGURE: ClassVar[str]
    """The function that draws it, as "module:function"; named, because most figures are in rooms above the result."""

    def __init_subclass__(cls) -> None:
        """Print every class of results in one way: a dataclass keeps the `__repr__` that its class has."""
        super().__init_subclass__()
        cls.__repr__ = Result.__repr__  # type: ignore[method-assign]

    def __repr__(self) -> str:
        """Return the text, or its first lines and how many follow."""
        lines = self.text().splitlines()
        more = len(lines) - _HEAD
        if more <= 1:  # the line that counts them would take its place
            return "\n".join(lines)
        return "\n".join([*lines[:_HEAD], f"... and {more} more lines: .text() returns all"])

    def shown(self) -> Iterator[str | Table | Result]:
        """Yield the lines of the report, its tables, and results that are part of it."""
        raise NotImplementedError

    def listed(self) -> Table:
        """Return the table that `csv` writes: the last one of the report, or a longer one of all numbers.

        Raises rig.errors.UsageError if there is none.
        """
        tables = [part for part in self.shown() if isinstance(part, Table)]
        if not tables:
            raise UsageError("nothing to write as CSV: the result has no table")
        return tables[-1]

    def facts(self) -> dict[str, Any]:
        """Return what JSON has beside the tables of the report."""
        return {}

    def text(self) -> str:
        """Return the report as text."""
        return "\n".join(part if isinstance(part, str) else part.text() for part in self.shown())

    def html(self) -> str:
        """Return the report as HTML."""
        return "\n".join(_paragraph(part) if isinstance(part, str) else part.html() for part in self.shown())

    def csv(self) -> str:
        """Return `listed` as CSV."""
        return self.listed().csv()

    def to_json(self) -> dict[str, Any]:
        """Return the facts and the records of the tables as JSON values, in the units of CSV.

        A table whose name a list of the facts has too adds its columns to the records there.
        """
        content = self.facts()
        for part in self.shown():
            if isinstance(part, Table):
                own = content.get(part.name) or [{}] * len(part.rows)
                content[part.name] = [record | more for record, more in zip(part.records(), own, strict=True)]
        return content

    def plot(self) -> Figure:
        """Return its figure, which a notebook shows; `savefig` writes it to a file.

        It is the figure that the option `--figure` of the command draws. Raises rig.errors.UsageError if there is
        nothing to draw.
        """
        return self._drawn()

    def _drawn(self, *how: object) -> Figure:
        module, _, name = self.FIGURE.partition(":")
        figure: Figure = getattr(importlib.import_module(module), name)(self, *how)
        importlib.import_module("rig.view.palette").print_units(figure)
        return figure

    def _repr_html_(self) -> str:
        """Return the report as HTML, and the figure, or why there is none."""
        try:
            image = importlib.import_module("rig.view.palette").encoded(self.plot(), "png")
        except RigError as fault:
            return f"{self.html()}\n<p>No figure: {html.escape(str(fault))}</p>"
        source = f"data:image/png;base64,{base64.b64encode(image).decode()}"
        return f'{self.html()}\n<img alt="figure" style="max-width:100%" src="{source}">'


def plain(value: Any) -> Any:
    """Return a value as JSON has it: numbers that are not finite are None, arrays and tuples lists, keys texts."""
    if isinstance(value, dict):
        return {str(key): plain(inner) for key, inner in value.items()}
    if isinstance(value, list | tuple):
        return [plain(inner) for inner in value]
    if isinstance(value, float):
        return value if math.isfinite(value) else None
    if hasattr(value, "tolist"):
        return plain(value.tolist())
    return value if value is None or isinstance(value, str | int | bool) else str(value)


def _csv_row(values: Iterable[Any]) -> list[str]:
    return [_csv_cell(value) for value in values]


def _csv_cell(value: Any) -> str:
    if value is None or isinstance(value, str):
        return value or ""
    if isinstance(value, list | tuple):
        return " ".join(map(_csv_cell, value))
    return repr(float(value)).removesuffix(".0")


def _row(tag: str, styles: Iterable[str], cells: Iterable[str]) -> str:
    return f"<tr>{''.join(f'<{tag} {style}>{html.escape(cell)}</{tag}>' for style, cell in zip(styles, cells))}</tr>"


def _paragraph(text: str) -> str:
    return f'<p style="margin:0;white-space:pre-wrap">{html.escape(text)}</p>' if text.strip() else ""
