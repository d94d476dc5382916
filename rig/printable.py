"""Text to print: of unknown origin made safe, and counts with their noun.

File names, notes and messages of recordings may contain control characters, which a terminal would obey, and bytes that
are not UTF-8, which Python keeps as lone surrogates and cannot write.

Tables as text, with columns as wide as their content.
"""

from __future__ import annotations

import re
from collections.abc import Iterable, Iterator, Sequence
from itertools import chain, count
from pathlib import Path

# Control characters except tab and end of line, and lone surrogates
_UNPRINTABLE = re.compile(r"[\x00-\x08\x0b-\x1f\x7f-\x9f\ud800-\udfff]")

_INDENT = "  "
_BETWEEN = "  "


def unprintable(text: str) -> list[str]:
    """Return the characters of `text` that `printable` replaces, each once."""
    return list(dict.fromkeys(_UNPRINTABLE.findall(text)))


def printable(text: str) -> str:
    r"""Return `text` with each such character as its escape, e.g. `\u001b`, which means the same in JSON."""
    return _UNPRINTABLE.sub(lambda match: f"\\u{ord(match[0]):04x}", text)


def utf8(path: Path) -> bool:
    """Whether the name of a file or folder is UTF-8, so that it can be written down."""
    try:
        str(path).encode()
    except UnicodeEncodeError:
        return False
    return True


def counted(number: int, noun: str) -> str:
    """A number with its noun: "1 event", "2 events", "0 events"."""
    return f"{number} {noun}" if number == 1 else f"{number} {noun}s"


def with_unit(name: str, unit: str) -> str:
    """A name with its unit, if it has one: the head of a column, the label of an axis."""
    return name if unit in ("", "1") else f"{name} [{unit}]"


def distinct(names: Iterable[str], numbered: str) -> list[str]:
    """Names of which none stands twice: later ones get a number, in the form `numbered`, such as "{} ({})"."""
    made: dict[str, None] = {}
    for name in names:
        others = chain([name], (numbered.format(name, number) for number in count(2)))
        made[next(other for other in others if other not in made)] = None
    return [*made]


def columns(rows: Iterable[Sequence[str]], align: str) -> Iterator[str]:
    """Format `rows` of cells, including the head, as lines; `align`: "<" or ">" for each column.

    At least two spaces separate the columns.
    """
    table = [tuple(row) for row in rows]
    widths = [max(map(len, column)) for column in zip(*table, strict=True)]
    for row in table:
        cells = (f"{cell:{side}{width}}" for cell, side, width in zip(row, align, widths, strict=True))
        yield (_INDENT + _BETWEEN.join(cells)).rstrip()
