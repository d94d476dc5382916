"""Parts of a page of HTML: elements with every text escaped, tables, and small curves over time as SVG."""

from __future__ import annotations

import re
from collections.abc import Iterable, Iterator, Sequence
from html import escape
from itertools import pairwise

import numpy as np

from rig.record.run import Integers, Reals

COLUMNS = 480
"""Columns of a curve: in each of them it reaches from its lowest to its highest sample."""
HEIGHT = 100
"""Height of a curve, in the units of its columns."""
_GAP = 1.5  # longest distance of neighbouring samples without a gap, in median distances
_EMPTY = frozenset({"img", "meta"})
# What UTF-8 or HTML cannot contain, and what changes the direction of the text after it
_UNPRINTABLE = re.compile("[\x00-\x08\x0b-\x1f\x7f-\x9f\ud800-\udfff\u202a-\u202e\u2066-\u2069\ufffe\uffff]")


class Html(str):
    """Text that is HTML already."""

    __slots__ = ()


def text(content: object) -> Html:
    """Return a text as HTML: escaped, characters that cannot be shown replaced."""
    return content if isinstance(content, Html) else Html(escape(_UNPRINTABLE.sub("\ufffd", str(content))))


def element(name: str, /, *contents: object, **attributes: object) -> Html:
    """Return an element with its contents. An attribute None is left out; `class_` is class."""
    opening = name
    for key, value in attributes.items():
        if value is not None:
            attribute = key.rstrip("_").replace("_", "-")
            opening += f' {attribute}="{text(str(value))}"'
    if name in _EMPTY:
        return Html(f"<{opening}>")
    return Html(f"<{opening}>{joined(contents)}</{name}>")


def joined(parts: Iterable[object]) -> Html:
    """Return several parts in a row."""
    return Html("".join(map(text, parts)))


def table(title: str, columns: Sequence[str], rows: Iterable[Sequence[object]]) -> Html:
    """Return a table with a caption. It scrolls by itself where it is wider than the page.

    The first column names the row. Without rows the result is empty.
    """
    body = []
    for first, *others in rows:
        name = element("th", first, scope="row")
        body.append(element("tr", name, *map(_cell, others)))
    if not body:
        return Html()
    names = (element("th", column, scope="col") for column in columns)
    head = element("thead", element("tr", *names))
    content = element("table", element("caption", title), head, element("tbody", *body))
    return element("div", content, class_="wide", role="region", tabindex=0, aria_label=title)


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
    terms = joined(joined((element("dt", name), element("dd", what))) for name, what in rows)
    return element("dl", terms) if terms else Html()


def sketch(t_ns: Integers, v: Reals, span: tuple[float, float], marks: list[float], label: str) -> Html:
    """Draw samples `v` at `t_ns` within a `span` [s]: fast vibration as a band, a gap where there is no sample.

    `marks`: times of vertical lines [s]; `label` says in words what is drawn. Nothing for samples that are not numbers.
    """
    known = np.isfinite(v)
    t = t_ns[known] * 1e-9
    v = v[known]
    begin, end = span
    if not v.size or end <= begin:
        return Html()
    order = np.argsort(t, kind="stable")
    x = COLUMNS * np.clip((t[order] - begin) / (end - begin), 0.0, 1.0)
    v = v[order]
    low = float(v.min())
    high = float(v.max())
    if high > low:
        y = HEIGHT * (0.96 - 0.92 * (v - low) / (high - low))
    else:
        y = np.full(v.size, 0.5 * HEIGHT)
    inside = [COLUMNS * (mark - begin) / (end - begin) for mark in marks if begin < mark < end]
    lines = [element("path", d=f"M{at:.1f} 0V{HEIGHT}", class_="mark") for at in inside]
    lines.append(element("path", d="".join(_pieces(x, y)), class_="line"))
    box = f"0 0 {COLUMNS} {HEIGHT}"
    return element("svg", *lines, viewBox=box, preserveAspectRatio="none", role="img", aria_label=label)


def _pieces(x: Reals, y: Reals) -> Iterator[str]:
    """The paths between gaps that are wider than a column; of many samples the lowest and highest in each column."""
    steps = np.diff(x)
    longest = max(_GAP * float(np.median(steps)), 1.0) if x.size > 2 else np.inf
    gaps = np.flatnonzero(steps > longest) + 1
    for a, b in pairwise([0, *gaps.tolist(), x.size]):
        at = x[a:b]
        ends = y[a:b]
        if x.size > 2 * COLUMNS:
            column = np.minimum(at.astype(np.int64), COLUMNS - 1)
            first = np.flatnonzero(np.diff(column, prepend=-1))
            at = np.repeat(column[first] + 0.5, 2)
            least = np.minimum.reduceat(ends, first)
            most = np.maximum.reduceat(ends, first)
            ends = np.stack([least, most], axis=1).ravel()
        points = "L".join(f"{u:.1f} {v:.1f}" for u, v in zip(at.tolist(), ends.tolist()))
        yield f"M{points}" if at.size > 1 else f"M{points}h1"
