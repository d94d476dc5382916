"""A directive whose content is Markdown that the program's own declarations give; and the Markdown of tables."""

import re
from collections.abc import Callable, Iterable, Sequence

from docutils import nodes
from sphinx.application import Sphinx
from sphinx.util.docutils import SphinxDirective

_SPECIAL = re.compile(r"([\\*_\[\]<>|#$~^])")
_CODE = re.compile(r"(`[^`]*`)")


def plain(text: str) -> str:
    """Text of a docstring or a help, safe in Markdown; what stands in backquotes stays code."""
    parts = _CODE.split(" ".join(text.split()))
    return "".join(part.replace("|", r"\|") if part.startswith("`") else _SPECIAL.sub(r"\\\1", part) for part in parts)


def code(text: str) -> str:
    """Text as code in a cell of a table; nothing for no text."""
    return f"`{text}`".replace("|", r"\|") if text else ""


def table(heads: Sequence[str], rows: Iterable[Sequence[str]]) -> list[str]:
    """The lines of a table; no line if there are no rows. Columns without any content are left out."""
    cells = [list(row) for row in rows]
    used = [i for i in range(len(heads)) if any(row[i] for row in cells)]
    kept = [[row[i] for i in used] for row in cells]
    if not kept:
        return []
    lines = [[heads[i] for i in used], ["---"] * len(used), *kept]
    return ["", *(f"| {' | '.join(line)} |" for line in lines), ""]


def directive(app: Sphinx, name: str, write: Callable[..., Iterable[str]], arguments: int = 0) -> None:
    """Add the directive `name`, whose content is the Markdown lines that `write(*arguments)` returns."""

    class Generated(SphinxDirective):
        required_arguments = arguments

        def run(self) -> list[nodes.Node]:
            text = "\n".join(write(*self.arguments))
            return self.parse_text_to_nodes(text, allow_section_headings=True)

    app.add_directive(name, Generated)
