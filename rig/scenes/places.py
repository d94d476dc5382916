"""Origins of values, and the lines of their keys in a TOML text, which tomllib does not return.

The text must be one that tomllib reads and whose lists and tables are not nested too deeply (`rig.scenes.source`).
"""

from __future__ import annotations

import re
import tomllib
from bisect import bisect
from typing import NamedTuple

_BLANK = re.compile(r"(?:[ \t\r\n]|#[^\n]*)*")
_PART = re.compile(r"""[A-Za-z0-9_-]+|"(?:\\.|[^"\\])*"|'[^']*'""")
_DOT = re.compile(r"[ \t]*\.[ \t]*")
_VALUE = re.compile(
    r""""{3}(?:\\.|[^\\])*?"{3,5}|'{3}.*?'{3,5}|"(?:\\.|[^"\\])*"|'[^']*'|[^,\]}\n#]*""",
    re.DOTALL,
)


class Origin(NamedTuple):
    """The origin of a value: one of `rig.quantities.ORIGINS`, and a note."""

    origin: str
    note: str = ""


class Place(NamedTuple):
    """The place of a value: a file as users know it and a line, counted from 1. Line 0: a change, `file` says by what.

    The texts of changes are "with -p" or another option, "in the call" (of Python), "on the page".
    """

    file: str
    line: int

    def __str__(self) -> str:
        return f"{self.file}, line {self.line}" if self.line else f"given {self.file}"


IN_THE_CALL = Place("in the call", 0)


def lines(text: str) -> dict[str, int]:
    """Dotted key -> its line, counted from 1. Entries of a list of tables are counted from one: `protocol[2].time`."""
    return _Text(text).found


class _Text:
    def __init__(self, text: str) -> None:
        self._text = text
        self._ends = [match.start() for match in re.finditer("\n", text)]
        self._entries: dict[str, int] = {}
        """Array of tables -> its entries so far."""
        self.found: dict[str, int] = {}
        at = self._blank(0)
        table = ""
        while at < len(self._text):
            if self._text[at] == "[":
                at, table = self._header(at)
            else:
                at = self._pair(at, table)
            at = self._blank(at)

    def _blank(self, at: int) -> int:
        """The end of blanks, line ends and comments."""
        blank = _BLANK.match(self._text, at)
        return blank.end() if blank else at

    def _inline(self, at: int) -> int:
        while self._text[at] in " \t":
            at += 1
        return at

    def _note(self, key: str, begin: int) -> None:
        self.found.setdefault(key, bisect(self._ends, begin - 1) + 1)

    def _key(self, at: int, table: str = "", many: bool = False) -> tuple[str, int]:
        """Read a dotted key in `table`. Return the whole key and its end. `many`: it begins another entry of a list."""
        key = table
        begin = at
        while (part := _PART.match(self._text, at)) is not None:
            begin = part.start()
            at = part.end()
            name = part[0]
            name = tomllib.loads(f"name = {name}")["name"] if name[0] in "\"'" else name
            key = f"{key}.{name}" if key else name
            dot = _DOT.match(self._text, at)
            if dot is not None:
                at = dot.end()
            elif many:
                self._entries[key] = self._entries.get(key, 0) + 1
            if key in self._entries:
                key += f"[{self._entries[key]}]"
            if dot is None:
                break
        self._note(key, begin)
        return key, at

    def _header(self, at: int) -> tuple[int, str]:
        """Read `[table]` or `[[array of tables]]`. Return its end, and the key of the table that follows."""
        many = self._text.startswith("[[", at)
        key, at = self._key(self._inline(at + 1 + many), many=many)
        return self._text.index("]", at) + 1 + many, key

    def _pair(self, at: int, table: str) -> int:
        """Read `key = value`. Return its end."""
        key, at = self._key(at, table)
        return self._value(self._inline(self._text.index("=", at) + 1), key)

    def _value(self, at: int, key: str) -> int:
        first = self._text[at]
        if first not in "[{":
            literal = _VALUE.match(self._text, at)
            return literal.end() if literal else at + 1
        at = self._blank(at + 1)
        entry = 0
        while self._text[at] not in "]}":
            if first == "{":
                at = self._pair(at, key)
            else:
                entry += 1
                inside = f"{key}[{entry}]"
                if self._text[at] in "{[":
                    self._note(inside, at)
                at = self._value(at, inside)
            at = self._blank(at)
            if self._text[at] == ",":
                at = self._blank(at + 1)
        return at + 1
