"""A small curve over time as inline SVG, in the colour of the text around it: sharp, light, and printed as it is."""

from __future__ import annotations

from itertools import pairwise

import numpy as np

from rig.analysis.report.html import Html, element
from rig.record.run import Integers, Reals

COLUMNS = 480
"""Columns of a curve: in each of them it reaches from its lowest to its highest sample."""
HEIGHT = 100
_GAP = 1.5
"""Longest distance of neighbouring samples without a gap, in median distances."""


def sketch(t_ns: Integers, v: Reals, span: tuple[float, float], marks: list[float], label: str) -> Html:
    """Draw samples `v` at `t_ns` within a `span` [s]: fast vibration as a band, a gap where there is no sample.

    `marks`: times of vertical lines [s]; `label` says in words what is drawn. Nothing for samples that are not numbers.
    """
    here = np.isfinite(v)
    t, v, (begin, end) = t_ns[here] * 1e-9, v[here], span
    if not v.size or end <= begin:
        return Html()
    order = np.argsort(t, kind="stable")
    x, v = COLUMNS * np.clip((t[order] - begin) / (end - begin), 0.0, 1.0), v[order]
    low, high = float(v.min()), float(v.max())
    y = HEIGHT * (0.96 - 0.92 * (v - low) / (high - low)) if high > low else np.full(v.size, 0.5 * HEIGHT)
    inside = [COLUMNS * (mark - begin) / (end - begin) for mark in marks if begin < mark < end]
    lines = [element("path", d=f"M{at:.1f} 0V{HEIGHT}", class_="mark") for at in inside]
    dense = x.size > 2 * COLUMNS
    shape = element("path", d=_outline(x, y, dense), class_="band" if dense else "line")
    return element(
        "svg",
        *lines,
        shape,
        viewBox=f"0 0 {COLUMNS} {HEIGHT}",
        preserveAspectRatio="none",
        role="img",
        aria_label=label,
    )


def _outline(x: Reals, y: Reals, dense: bool) -> str:
    """The path of a line, or if it is `dense` the outline of what lies between lowest and highest in each column."""
    pieces = list(pairwise([*_breaks(x), x.size]))
    if not dense:
        return "".join(_line(x[a:b], y[a:b]) for a, b in pieces)
    parts = []
    for a, b in pieces:
        column = np.minimum(x[a:b].astype(np.int64), COLUMNS - 1)
        first = np.flatnonzero(np.diff(column, prepend=-1))
        top, bottom = np.minimum.reduceat(y[a:b], first), np.maximum.reduceat(y[a:b], first)
        at = column[first] + 0.5
        parts.append(_line(np.concatenate([at, at[::-1]]), np.concatenate([top, bottom[::-1]])) + "Z")
    return "".join(parts)


def _breaks(x: Reals) -> list[int]:
    """Where a piece begins: at the start, and after each gap that is wider than a column."""
    if x.size < 3:
        return [0]
    steps = np.diff(x)
    longest = max(_GAP * float(np.median(steps)), 1.0)
    return [0, *(np.flatnonzero(steps > longest) + 1).tolist()]


def _line(x: Reals, y: Reals) -> str:
    points = "L".join(f"{a:.1f} {b:.1f}" for a, b in zip(x.tolist(), y.tolist()))
    return f"M{points}" if x.size > 1 else f"M{points}h1"
