"""HTML made of elements: every text is escaped, unless an element of this module made it."""

from __future__ import annotations

import re
from collections.abc import Iterable, Sequence
from html import escape

_EMPTY = frozenset({"img", "meta"})
_UNPRINTABLE = re.compile("[\x00-\x08\x0b-\x1f\x7f-\x9f\ud800-\udfff\u202a-\u202e\u2066-\u2069\ufffe\uffff]")
"""What UTF-8 or HTML cannot contain, and what changes the direction of the text after it."""


class Html(str):
    """Text that is HTML already."""

    __slots__ = ()


def text(content: object) -> Html:
    """Return a text as HTML: escaped, characters that cannot be shown replaced."""
    return content if isinstance(content, Html) else Html(escape(_UNPRINTABLE.sub("\ufffd", str(content))))


def element(name: str, /, *contents: object, **attributes: object) -> Html:
    """Return an element with its contents. An attribute None is left out; `class_` is class."""
    given = ((key.rstrip("_").replace("_", "-"), value) for key, value in attributes.items() if value is not None)
    opening = "".join([name, *(f' {key}="{text(str(value))}"' for key, value in given)])
    return Html(f"<{opening}>" if name in _EMPTY else f"<{opening}>{''.join(map(text, contents))}</{name}>")


def joined(parts: Iterable[object]) -> Html:
    """Return several parts in a row."""
    return Html("".join(map(text, parts)))


def table(title: str, columns: Sequence[str], rows: Iterable[Sequence[object]]) -> Html:
    """Return a table with a caption. It scrolls by itself where it is wider than the page.

    The first column names the row. Without rows the result is empty.
    """
    body = [_row(row) for row in rows]
    if not body:
        return Html()
    head = element("tr", *(element("th", column, scope="col") for column in columns))
    made = element("table", element("caption", title), element("thead", head), element("tbody", *body))
    return element("div", made, class_="wide", role="region", tabindex=0, aria_label=title)


def _row(cells: Sequence[object]) -> Html:
    first, *others = cells
    return element("tr", element("th", first, scope="row"), *map(_cell, others))


def _cell(content: object) -> Html:
    if isinstance(content, bool):
        return element("td", "yes" if content else "no")
    if isinstance(content, float | int):
        return element("td", number(content), class_="number")
    return element("td", content)


def number(value: float) -> str:
    """A number with six significant digits; a whole number in full; a dash for one that is not known."""
    if isinstance(value, int):
        return str(value)
    return "\N{EN DASH}" if value != value else f"{value:.6g}"


def facts(rows: Iterable[tuple[str, object]]) -> Html:
    """Return names and what is known under them; without rows the result is empty."""
    found = joined(joined((element("dt", name), element("dd", what))) for name, what in rows)
    return element("dl", found) if found else Html()
