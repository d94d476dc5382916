"""Tables as text: columns as wide as what is in them."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence

_INDENT, _BETWEEN = "  ", "  "


def columns(rows: Iterable[Sequence[str]], align: str) -> Iterator[str]:
    """`rows` of cells as lines, the head among them; `align`: "<" or ">" for each column.

    Two spaces at least stand between columns.
    """
    table = [tuple(row) for row in rows]
    widths = [max(map(len, column)) for column in zip(*table, strict=True)]
    for row in table:
        cells = (f"{cell:{side}{width}}" for cell, side, width in zip(row, align, widths, strict=True))
        yield (_INDENT + _BETWEEN.join(cells)).rstrip()
