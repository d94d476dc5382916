"""What every result has: its text, which is also what Python prints, a figure, and a form for notebooks with both.

A class of results names the function that draws it in `FIGURE`. Commands write what `plot` returns to the file of
`--figure`, so that both are one picture.
"""

from __future__ import annotations

import base64
import csv
import html
import importlib
import io
from collections.abc import Iterable, Iterator, Sequence
from typing import TYPE_CHECKING, ClassVar

from rig.errors import RigError

if TYPE_CHECKING:
    from matplotlib.figure import Figure

_HEAD = 40
"""Most lines that Python prints of a result. # chosen"""
_CELL = '<td style="text-align:left;white-space:pre;padding:0 1.2em 0 0">'
"""Begin of a cell of a table."""


class Result:
    """A result with `text`, `plot` and an HTML form."""

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

    def text(self) -> str:
        """Return the report as text."""
        raise NotImplementedError

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
        """Return the text as tables and paragraphs, and the figure, or why there is none."""
        try:
            image = importlib.import_module("rig.view.palette").encoded(self.plot(), "png")
        except RigError as fault:
            return f"{html_of(self.text())}\n<p>No figure: {html.escape(str(fault))}</p>"
        source = f"data:image/png;base64,{base64.b64encode(image).decode()}"
        return f'{html_of(self.text())}\n<img alt="figure" style="max-width:100%" src="{source}">'


def csv_text(head: Iterable[str], rows: Iterable[Iterable[str | float]]) -> str:
    """Return a table as CSV, its numbers with nine digits."""
    text = io.StringIO()
    writer = csv.writer(text, lineterminator="\n")
    writer.writerow(head)
    writer.writerows(map(_csv_row, rows))
    return text.getvalue()


def html_of(text: str) -> str:
    """Return a report as HTML: lines with columns in common as tables, others as paragraphs."""
    return "\n".join(_parts(text.splitlines()))


def _csv_row(cells: Iterable[str | float]) -> list[str]:
    return [cell if isinstance(cell, str) else f"{cell:.9g}" for cell in cells]


def _parts(lines: Sequence[str]) -> Iterator[str]:
    at = 0
    while at < len(lines):
        last = at + 1
        edges = _edges(lines[at:last])
        while last < len(lines) and edges:
            common = _edges(lines[at : last + 1])
            if not common:
                break
            last += 1
            edges = common
        if edges and last > at + 1:
            rows = (_row(_cells(line, edges)) for line in lines[at:last])
            yield f'<table style="font-size:inherit">{"".join(rows)}</table>'
        elif lines[at].strip():
            yield f'<p style="margin:0;white-space:pre-wrap">{html.escape(lines[at])}</p>'
        at = last


def _row(cells: Sequence[str]) -> str:
    return f"<tr>{''.join(f'{_CELL}{html.escape(cell)}</td>' for cell in cells)}</tr>"


def _edges(lines: Sequence[str]) -> list[int]:
    """Where the columns of a table begin, after the first one: at least two blanks are before it in every line."""
    if not all(line.strip() for line in lines):
        return []
    width = max(map(len, lines))
    blank = [_is_blank(lines, column) for column in range(width)]
    begin = blank.index(False)
    return [i for i in range(begin + 2, width) if not blank[i] and blank[i - 1] and blank[i - 2]]


def _is_blank(lines: Sequence[str], column: int) -> bool:
    return all(line[column : column + 1] in ("", " ") for line in lines)


def _cells(line: str, edges: Sequence[int]) -> list[str]:
    """The cells of a line of a table."""
    return [line[low:high].strip() for low, high in zip([0, *edges], [*edges, None])]
