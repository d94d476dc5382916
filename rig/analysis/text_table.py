"""Tables as text, with columns as wide as their content."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence

_INDENT, _BETWEEN = "  ", "  "


def columns(rows: Iterable[Sequence[str]], align: str) -> Iterator[str]:
    """Format `rows` of cells, including the head, as lines; `align`: "<" or ">" for each column.

    At least two spaces separate the columns.
    """
    table = [tuple(row) for row in rows]
    widths = [max(map(len, column)) for column in zip(*table, strict=True)]
    for row in table:
        cells = (f"{cell:{side}{width}}" for cell, side, width in zip(row, align, widths, strict=True))
        yield (_INDENT + _BETWEEN.join(cells)).rstrip()
