"""The phase portrait of the viewer: velocity over displacement at the latest steps, coloured by contact state.

Its points are one stretch of steps, none left out, and at most 2 s of them: points farther apart than a fast vibration
would be joined to a shape that there was not.

rerun's 2D view has no axes with numbers. So the curve is divided by a round scale, which grows when needed, and drawn
in a frame whose edges are labelled with the scale.
"""

from __future__ import annotations

import math
from collections import deque
from itertools import pairwise
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rig.view import contact
from rig.view.base import Columns, Shape

SHOWN_NS = 2_000_000_000
POINTS = 2000
_STEPS = (1.0, 1.2, 1.5, 2.0, 3.0, 5.0, 7.0, 10.0)
"""Round numbers of a scale, within a power of ten."""
_FRAME = [[(-1, -1), (1, -1), (1, 1), (-1, 1), (-1, -1)], [(-1, 0), (1, 0)], [(0, -1), (0, 1)]]
_GREY = (110, 116, 128)


class Portrait:
    """Collects states and draws the latest of them; `units` of displacement and velocity."""

    def __init__(self, units: tuple[str, str]) -> None:
        self._units = units
        self._points: deque[tuple[int, float, float, int]] = deque(maxlen=POINTS)
        self._scale = (0.0, 0.0)

    def add(self, t_ns: NDArray[np.int64], x: Any, v: Any, modes: Any, step_ns: int) -> None:
        """Add steps, one every `step_ns`. If they do not follow the last one, they begin a new stretch."""
        if self._points and not 0 < t_ns[0] - self._points[-1][0] <= 1.5 * step_ns:
            self._points.clear()
        latest = [column[-POINTS:].tolist() for column in (t_ns, x, v, modes)]
        for t, displacement, velocity, mode in zip(*latest):
            if math.isfinite(displacement) and math.isfinite(velocity):
                self._points.append((t, displacement, velocity, mode))

    def draw(self) -> list[Columns]:
        """The curve up to the last state, and the frame if its scale has changed."""
        if not self._points:
            return []
        last = self._points[-1][0]
        while self._points[0][0] < last - SHOWN_NS:
            self._points.popleft()
        now = np.array([last])
        table = np.array([(x, v) for _, x, v, _ in self._points])
        frame = self._frame(now, np.abs(table).max(axis=0))
        table = table / self._scale * (1.0, -1.0)
        modes = np.array([mode for *_, mode in self._points])
        changes = np.flatnonzero(np.diff(modes)) + 1
        cuts = [0, *changes.tolist(), len(modes)]
        strips = [table[begin : end + 1] for begin, end in pairwise(cuts)]
        colours = [contact.rgb(contact.COLOURS[modes[begin]]) for begin in cuts[:-1]]
        curve = Shape("LineStrips2D", strips=strips, colors=colours, radii=[0.012] * len(strips))
        dot = Shape("Points2D", positions=table[-1:], colors=colours[-1:], radii=[0.035])
        return [*frame, Columns("portrait/curve", now, curve), Columns("portrait/now", now, dot)]

    def _frame(self, now: NDArray[np.int64], largest: Any) -> list[Columns]:
        width, height = (max(_round_up(float(size)), before) for size, before in zip(largest, self._scale))
        if (width, height) == self._scale:
            return []
        self._scale = (width, height)
        words = [_with_unit(value, unit) for value, unit in zip(self._scale, self._units)]
        frame = Shape("LineStrips2D", strips=_FRAME, colors=[_GREY] * 3, radii=[0.004] * 3)
        labels = Shape(
            "Points2D", positions=[(1.0, 0.0), (0.0, -1.0)], labels=words, colors=[_GREY] * 2, radii=[0.0] * 2
        )
        return [Columns("portrait/frame", now, frame), Columns("portrait/edges", now, labels)]


def _with_unit(value: float, unit: str) -> str:
    """A value with its unit; small lengths and angles in mm, um, mrad or urad."""
    if unit not in ("m", "rad") or value >= 1.0:
        return f"{value:g} {unit}"
    if value >= 1e-4:
        return f"{1e3 * value:g} m{unit}"
    return f"{1e6 * value:g} u{unit}"


def _round_up(value: float) -> float:
    """Round up to a number with one or two digits, at least 1e-7."""
    value = max(value, 1e-7)
    base = 10.0 ** math.floor(math.log10(value))
    return next(step * base for step in _STEPS if value <= step * base * (1.0 + 1e-9))
