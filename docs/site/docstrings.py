"""Docstrings of this project on the site: what is aligned in columns becomes a list."""

import re
from collections.abc import Iterator
from typing import Any

from sphinx.application import Sphinx

_ROW = re.compile(r"(?P<indent> *)(?P<names>[A-Za-z_][\w.,|*/'\[\]\" ]*?) {2,}(?P<text>\S.*)")
_PARAGRAPH_END = re.compile(r"[.:;]$|^$")


def rows_as_list(lines: list[str]) -> Iterator[str]:
    """Lines in which rows `name   text`, with continuation lines further in, are a list of definitions."""
    within = ""
    for line in lines:
        row = _ROW.fullmatch(line)
        if row:
            yield from () if within else ("",)
            within = f"{row['indent']}    "
            yield f"{row['indent']}``{row['names']}``"
            yield f"{within}{row['text']}"
        elif within and line.startswith(within):
            yield f"{within}{line.strip()}"
        else:
            yield from ("",) if within and line else ()
            within = ""
            yield line


def _process(app: Sphinx, what: str, name: str, thing: Any, options: Any, lines: list[str]) -> None:
    lines[:] = list(rows_as_list(lines))


def setup(app: Sphinx) -> dict[str, bool]:
    """Process every docstring before it is read."""
    app.connect("autodoc-process-docstring", _process)
    return {"parallel_read_safe": True, "parallel_write_safe": True}
