"""The steady state of a motion, decided from consecutive windows.

    sliding      nothing sticks; the slip speed varies by less than half of the stated perturbation, and does not grow
    stick-slip   the amplitudes of three windows in a row agree, and a contact sticks in each of them; or the cycles of
                 one window are the same (`closed`)
    vibration    the same, and nothing sticks
    stuck        the surfaces stand still and so does the rig
    undecided    none of this within the stated longest time
    stopped      the simulation had to stop, and why

On a surface with sectors of different friction nothing comes to rest, because every edge excites the rig. There a
window lasts at least one turn, and

    sliding      nothing sticks in two turns in a row, and the slip speed varies no more in the second
    stick-slip   a contact sticks in each of five turns

Near a fold a decaying motion looks like a cycle for a long time; a slow approach to a cycle and a slow departure look
alike. A drift distinguishes both from a cycle: a motion that still drifts to one side at the end is undecided. A motion
that does not repeat but has no drift is classified by whether it sticks.
"""

from __future__ import annotations

import math
from itertools import pairwise
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from rig.errors import NumericsError, RigError

Array = NDArray[np.float64]

NONE, SLIDING, STICK_SLIP, VIBRATION, STUCK, UNDECIDED, STOPPED = range(7)
NAMES = ("none", "sliding", "stick-slip", "vibration", "stuck", "undecided", "stopped")
SAME = 1e-4
"""Relative difference up to which the amplitudes of two windows agree."""
CLOSE = 2e-6
"""Of a period: difference up to which cycles are the same."""
CYCLES, _SETTLED = 3, 1e-7
TURNS = 5
"""Turns in which a contact over sectors must stick: a cycle may survive two crossings and end at the third."""
_EQUAL = 1.02  # ratio of amplitudes from turn to turn, which meet the edges at other phases
_GROWN = 4.0  # a near start has left sliding when its amplitude is this many perturbations
_INSTANT = 1e-9  # of a window
_NO = float("nan")


class Window(NamedTuple):
    """Statistics of one window.

    low, high   of the output                              rms      of the output about its mean
    travel      half of peak to peak along the contacts    slip     the same of the slip speed, over the surface's
                (root of the sum of squares)                        speed (of the contact where it is
                largest)
    share       of the time with a contact stuck           sticks   number of times sticking begins
    period      mean time between such beginnings [s]      moving   a surface moves
    closed      at least three cycles, which are the same

    `share` and `rms` refer to whole cycles if there are at least two beginnings.
    """

    low: float
    high: float
    rms: float
    travel: float
    slip: float
    share: float
    sticks: int
    period: float
    moving: bool
    closed: bool = False


class Point(NamedTuple):
    """The state of a point and its last window. `spent`: simulated seconds. `why` it had to stop, in words."""

    state: int
    window: Window
    spent: float
    why: str = ""


BLANK = Window(_NO, _NO, _NO, _NO, _NO, _NO, 0, _NO, False)
NOTHING = Point(NONE, BLANK, 0.0)


def stopped(error: RigError, spent: float = 0.0) -> Point:
    """Return the state of a run that had to stop."""
    what = error.what if isinstance(error, NumericsError) else " ".join(str(error).split())
    return Point(STOPPED, BLANK, spent, what)


def extremes(values: Array) -> tuple[float, float]:
    """Return the lowest and highest of evenly spaced samples; where they are smooth, by a parabola through three of
    them.
    """
    return -_top(-values), _top(values)


def _top(y: Array) -> float:
    i = int(y.argmax())
    if 2 <= i < len(y) - 2:
        a, b, c, d, e = y[i - 2 : i + 3].tolist()
        left, here, right = a - 2.0 * b + c, b - 2.0 * c + d, c - 2.0 * d + e
        if max(left, here, right) < 0.5 * min(left, here, right) < 0.0:  # not beside a corner
            return float(c - (d - b) ** 2 / (8.0 * here))
    return float(y[i])


class Sticking(NamedTuple):
    """The sticking of a contact in a window: share, beginnings, mean time between them, first and last beginning [s];
    the times at which it begins and ends.
    """

    share: float
    begins: int
    period: float
    first: float
    last: float
    begun: Array
    ended: Array


def sticking(times: Array, stuck: NDArray[np.bool_], after: bool, span: float) -> Sticking:
    """Compute it from the `times` of the events within `span` [s]; `stuck` before each of them, `after` behind the
    last.
    """
    held, edges = np.array([*stuck.tolist(), after]), np.array([0.0, *times.tolist(), span])  # np.append takes longer
    for i in np.flatnonzero(edges[1:] - edges[:-1] < _INSTANT * span):  # released and stuck at one instant
        held[i] = held[i - 1] if i else held[1]
    begins = times[~held[:-1] & held[1:]]
    count = len(begins)
    first, last = (float(begins[0]), float(begins[-1])) if count > 1 else (0.0, span)
    edges = np.minimum(np.maximum(edges, first), last)
    period = (last - first) / (count - 1) if count > 1 else _NO
    share = float((edges[1:] - edges[:-1]) @ held) / (last - first)
    return Sticking(share, count, period, first, last, begins, times[held[:-1] & ~held[1:]])


def closed(begins: Array, ends: Array) -> bool:
    """Whether at least three cycles, from one beginning of stick to the next, are the same and remain so.

    Their periods and times in stick differ by at most `CLOSE` periods, and so does the limit of these differences,
    which shrink like a geometric series.
    """
    if len(begins) < CYCLES + 1:
        return False
    cycles, stuck = begins[1:] - begins[:-1], ends[np.searchsorted(ends, begins[:-1])] - begins[:-1]
    steps = np.maximum(np.abs(cycles[1:] - cycles[:-1]), np.abs(stuck[1:] - stuck[:-1])) / cycles[0]
    left = steps[-1] ** 2 / (steps[-2] - steps[-1]) if steps[-1] < steps[-2] else math.inf
    return bool(steps.max() <= CLOSE and (left <= CLOSE or steps.max() <= _SETTLED))


class Judge:
    """Takes windows until the steady state is decided.

    `near`: the motion started at sliding, with a slip speed amplitude of `kick`. `pushed`: the edges of sectors excite
    it.
    """

    def __init__(self, kick: float, near: bool, pushed: bool = False) -> None:
        self.kick, self.near, self.pushed = kick, near, pushed
        self.windows: list[Window] = []

    def take(self, window: Window) -> int:
        """Return the state after one more window; UNDECIDED asks for another window."""
        self.windows.append(window)
        last = self.windows[-3:]
        if not window.moving and window.share >= 1.0:
            return STUCK
        if self.pushed:
            return self._over_sectors()
        stuck = [w.share > 0.0 for w in last]
        if len(last) > 1 and not any(stuck[-2:]) and window.slip < 0.5 * self.kick and window.slip <= last[-2].slip:
            return SLIDING
        if window.closed:
            return STICK_SLIP
        if len(last) < 3 or not all(abs(a.travel - b.travel) <= SAME * b.travel for a, b in pairwise(last)):
            return UNDECIDED
        if all(stuck):
            return STICK_SLIP
        swings = window.slip > (_GROWN if self.near else 0.5) * self.kick
        return VIBRATION if swings and not any(stuck) else UNDECIDED

    def _over_sectors(self) -> int:
        turns = self.windows[-TURNS:]
        if len(turns) == TURNS and all(w.share > 0.0 for w in turns):
            return STICK_SLIP
        calm = len(turns) > 1 and not any(w.share > 0.0 for w in turns[-2:])
        return SLIDING if calm and turns[-1].slip <= _EQUAL * turns[-2].slip else UNDECIDED

    def at_last(self) -> int:
        """Return the state when the time is over: that of a motion that does not repeat, unless it drifts."""
        if self.pushed:
            return UNDECIDED
        late = self.windows[len(self.windows) // 2 :]
        steps = np.diff([w.travel for w in late])
        half = len(steps) // 2
        drift = max(abs(float(steps[:half].sum())), abs(float(steps[half:].sum())))
        if len(steps) < 4 or drift > 0.5 * float(np.abs(steps).sum()):
            return UNDECIDED
        if all(w.share > 0.0 for w in late):
            return STICK_SLIP
        swings = all(w.slip > _GROWN * self.kick for w in late)
        return VIBRATION if swings and not any(w.share > 0.0 for w in late) else UNDECIDED
