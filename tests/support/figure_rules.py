"""What every figure of the project must satisfy so that it can be read. tests/conftest.py applies it to all figures
that a test saves.
"""

import re
from itertools import combinations

import numpy as np
from matplotlib.colors import ListedColormap
from matplotlib.patches import Rectangle
from matplotlib.text import Text

UNIT = re.compile(r"\[[^\]]+\]")
KEY = re.compile(r"[A-Za-z]\w*\.[a-z]\w+|\w_\w")
WORD = re.compile(r"[A-Za-z]{3,}")
PURE = re.compile(
    r"coefficient|ratio|fraction|share|relative|over that|over resonance|factor|coherence|part$|counts?\b|number|cycle$"
)
"""Words of quantities without a unit."""
PAPER = (6.7, 9.8)
"""Text block of an A4 page [inches]."""
SMALLEST = 3.3
"""Smallest letters on that page, upright or turned [pt]."""


def faults(figure):
    """Return what makes `figure`, which was drawn before, hard to read: one sentence for each fault."""
    rules = (_labels, _units, _overlaps, _cut, _legends, _colour_bars, _page)
    return [fault for rule in rules for fault in rule(figure)]


def _labels(figure):
    for axes in figure.axes:
        if not axes.axison or not axes.get_visible():
            continue
        for axis in (axes.xaxis, axes.yaxis):
            text = axis.get_label_text().strip()
            if not text or not axis.get_visible():
                continue
            if KEY.search(UNIT.sub("", text)):
                yield f"label {text!r} has a key instead of words"
            if not WORD.search(UNIT.sub("", text)):
                yield f"label {text!r} has no word"
            counted = any(tick.label1.get_visible() and tick.label1.get_text() for tick in axis.get_major_ticks())
            if counted and not UNIT.search(text) and not PURE.search(text):
                yield f"label {text!r} has no unit"


def _units(figure):
    """A quantity has one unit: not displacement in m on one axis, and in mm on another."""
    known = {}
    for axes in figure.axes:
        if not axes.axison or not axes.get_visible():
            continue
        for axis in (axes.xaxis, axes.yaxis):
            words, _, unit = axis.get_label_text().strip().partition(" [")
            if unit and not unit.startswith("dB") and axis.get_visible() and known.setdefault(words, unit) != unit:
                yield f"{words!r} in [{known[words]} and in [{unit}"


def _axis_texts(axis):
    low, high = sorted(axis.get_view_interval())
    for tick in (*axis.get_major_ticks(), *axis.get_minor_ticks()):
        slack = 1e-9 * abs(tick.get_loc())
        if low - slack <= tick.get_loc() <= high + slack:
            yield from (text for text in (tick.label1, tick.label2))
    yield axis.label
    yield axis.offsetText


def _boxes(figure):
    """Texts and legends with their boxes in pixels; slanted texts are left out."""
    texts = [*figure.texts]
    for axes in figure.axes:
        if not axes.get_visible():
            continue
        texts += [one for one in axes.get_children() if isinstance(one, Text)]  # titles too
        if axes.axison:
            texts += [text for axis in (axes.xaxis, axes.yaxis) if axis.get_visible() for text in _axis_texts(axis)]
    for text in texts:
        cut = text.get_clip_on() and (text.get_clip_box() or text.get_clip_path())
        if text.get_visible() and text.get_text().strip() and not cut and text.get_rotation() % 90.0 == 0.0:
            yield repr(text.get_text()), text.get_window_extent()
    for legend in (*figure.legends, *(axes.get_legend() for axes in figure.axes)):
        if legend is not None and legend.get_visible():
            yield "legend", legend.get_window_extent()


def _cut(figure):
    """A text ends with its words, and is not cut by the axes."""
    texts = [text for axes in figure.axes if axes.get_visible() for text in axes.texts]
    for text in (*figure.texts, *texts):
        if not text.get_visible() or not text.get_text().strip():
            continue
        if text.get_text().rstrip().endswith(("…", "...")):
            yield f"{text.get_text()!r} is not whole"
        clip, box = text.get_clip_on() and text.get_clip_box(), text.get_window_extent()
        if clip and box.overlaps(clip) and not (clip.x0 - 2 <= box.x0 and box.x1 <= clip.x1 + 2):
            yield f"{text.get_text()!r} is cut"


def _overlaps(figure):
    found = list(_boxes(figure))
    width, height = figure.bbox.width, figure.bbox.height
    for (one, a), (other, b) in combinations(found, 2):
        across = min(a.x1, b.x1) - max(a.x0, b.x0)
        high = min(a.y1, b.y1) - max(a.y0, b.y0)
        if across > 1.0 and high > 2.0:
            yield f"{one} overlaps {other}"
    for name, box in found:
        if box.x0 < -2.0 or box.y0 < -2.0 or box.x1 > width + 2.0 or box.y1 > height + 2.0:
            yield f"{name} leaves the figure of {width:.0f} x {height:.0f}: {box.extents.round()}"


def _legends(figure):
    for axes in figure.axes:
        legend = axes.get_legend()
        if legend is None or not legend.get_visible():
            continue
        box = legend.get_window_extent().padded(-2.0)
        if not box.overlaps(axes.bbox):
            continue
        if any(
            mesh.get_array() is not None and np.size(mesh.get_array()) > 1 for mesh in axes.collections + axes.images
        ):
            yield "a legend covers a coloured map"
        for line in axes.lines:
            points = line.get_path().vertices
            guide = len(points) == 2 and (points[0] == points[1]).any()
            if guide or not line.get_visible() or not len(points):
                continue
            drawn = line.get_transform().transform_path(line.get_path())
            joined = line.get_linestyle() not in ("None", "", " ")
            inside = drawn.intersects_bbox(box, filled=False) if joined and len(points) > 1 else False
            if inside or box.count_contains(drawn.vertices):
                yield f"legend {legend.get_texts()[0].get_text()!r} covers the data of {line.get_label()!r}"
        for patch in axes.patches:
            if isinstance(patch, Rectangle) and patch.get_transform().contains_branch(axes.transData):
                spans = patch.get_data_transform() if hasattr(patch, "get_data_transform") else None
                if spans is axes.transData and box.overlaps(patch.get_window_extent()):
                    yield "a legend covers a bar"


def _colour_bars(figure):
    plots = [axes for axes in figure.axes if axes.get_label() != "<colorbar>"]
    shown = [m for axes in plots for m in (*axes.collections, *axes.images)]
    mapped = [m for m in shown if m.get_array() is not None and np.size(m.get_array()) > 1]
    scales = [m for m in shown if m.colorbar is not None]
    for one in mapped:
        array = np.asarray(one.get_array())
        if array.ndim == 3 or (isinstance(one.cmap, ListedColormap) and one.cmap.N <= 8):
            continue  # true colours, or kinds, which a legend explains
        same = [
            m
            for m in scales
            if m is one or ((m.norm is one.norm or m.get_clim() == one.get_clim()) and m.cmap == one.cmap)
        ]
        if not same:
            yield f"{type(one).__name__} without a colour bar"
    for one in scales:
        bar = one.colorbar.ax
        text = f"{bar.get_xlabel()}{bar.get_ylabel()}"
        if not text:
            yield "a colour bar without a label"


def _page(figure):
    width, height = figure.get_size_inches()
    scale = max(min(1.0, PAPER[0] / width, PAPER[1] / height), min(1.0, PAPER[1] / width, PAPER[0] / height))
    sizes = [text.get_fontsize() for axes in figure.axes for text in axes.texts if text.get_text()]
    smallest = scale * min([*sizes, 10.0])
    if smallest < SMALLEST:
        yield f"{width:.1f} x {height:.1f} inches: on a page its letters are {smallest:.1f} pt high"
