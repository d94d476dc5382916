"""The steady state in which a motion settles, and its measures.

    sliding      the motion decays as the least stable mode of sliding does
    stick-slip   a cycle that repeats or that Newton's method closes, and in which a contact sticks
    vibration    the same, and nothing sticks
    stuck        the surfaces stand still and so does the rig
    undecided    none of this within the stated longest time
    stopped      the simulation had to stop, and why

The search for a cycle (rig.analysis.cycles.cycle) finds where a motion settles. A motion that does not repeat is
quasi-periodic, chaotic or slow. Windows of equal length tell: without a drift it is classified by whether it sticks in
each of them.

On a surface with sectors of different friction nothing comes to rest, because every edge excites the rig, and no cycle
closes. There a window lasts at least one turn, and

    sliding      nothing sticks in two turns in a row, and the slip speed varies no more in the second
    stick-slip   a contact sticks in each of five turns
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from rig.bench.free_rig import FreeRig
from rig.errors import NumericsError, RigError

Array = NDArray[np.float64]

NONE, SLIDING, STICK_SLIP, VIBRATION, STUCK, UNDECIDED, STOPPED = range(7)
NAMES = ("none", "sliding", "stick-slip", "vibration", "stuck", "undecided", "stopped")
TURNS = 5
"""Turns in which a contact over sectors must stick: a cycle may survive two crossings and end at the third."""
_EQUAL = 1.02  # ratio of amplitudes from turn to turn, which meet the edges at other phases
_GROWN = 4.0  # a motion without stick vibrates when its amplitude is this many times that of a near start
_FEWEST = 5  # windows in which a drift shows
_ALIKE = 1e-5  # relative difference of the measures of one cycle, as two runs find it
_INSTANT = 1e-9  # of a window: a shorter stick or slip is two events at one time
_BEYOND = 4  # ticks beyond a period: the highest value may lie where the period begins
_NO = float("nan")


class Window(NamedTuple):
    """Measures of one period of a cycle, or of a window of another motion.

    low, high   of the output
    rms         of the output about its mean
    share       of the time with a contact stuck
    period      of the cycle; of a motion that does not repeat the mean time between two beginnings of stick [s]
    maxima      local maxima of the output
    slip        half of peak to peak of the slip speed over the surface's speed, of the contact where it is largest; nan
                for a cycle
    """

    low: float
    high: float
    rms: float
    share: float
    period: float
    maxima: Array
    slip: float = _NO


class Point(NamedTuple):
    """The state of a point and its last window. `spent`: simulated seconds. `why` it had to stop, in words."""

    state: int
    window: Window
    spent: float
    why: str = ""

    def alike(self, other: Point) -> bool:
        """Whether two points at one value are the same cycle."""
        a = self.window
        b = other.window
        return bool(np.allclose((a.period, a.share, a.low, a.high), (b.period, b.share, b.low, b.high), _ALIKE, 0.0))


BLANK = Window(_NO, _NO, _NO, _NO, _NO, np.zeros(0))
NOTHING = Point(NONE, BLANK, 0.0)


def stopped(error: RigError, spent: float = 0.0) -> Point:
    """Return the state of a run that had to stop."""
    what = error.what if isinstance(error, NumericsError) else " ".join(str(error).split())
    return Point(STOPPED, BLANK, spent, what)


def at_rest(value: float) -> Window:
    """Return the measures of steady sliding, where the output has a value."""
    return Window(value, value, 0.0, 0.0, _NO, np.array([value]))


def of_cycle(rig: FreeRig, x: Array, period: float) -> tuple[Window, Array | None]:
    """Return the measures of the cycle through state x, and its state in the middle of the longest stick; None without
    stick.
    """
    step = rig.step
    run = rig.carried(x, 0.0, keep=True, ticks=math.ceil(period / step) + _BEYOND)
    within = int(period / step)
    weights = np.ones(within)
    weights[[0, -1]] = 0.5 * (period / step - within + 2.0)  # from the last tick to the first one of the next period
    times = np.array([time for time, _ in run.events if time <= period])
    keys = [*(event.before for _, event in run.events), run.key]
    held = np.array([bool(rig.stuck(key)) for key in keys[: len(times) + 1]])
    edges = np.array([0.0, *times, period])
    window = _measured(run.values[0], weights, edges, held)._replace(period=period)
    begins = times[~held[:-1] & held[1:]]
    ends = times[held[:-1] & ~held[1:]]
    if not (len(begins) and len(ends)):
        return window, None
    next_ends = ends[np.searchsorted(ends, begins) % len(ends)]
    lasts = (next_ends - begins) % period
    middle = (begins[lasts.argmax()] + 0.5 * lasts.max()) % period / step
    a = run.states[int(middle)]
    b = run.states[int(middle) + 1]
    return window, a + middle % 1.0 * (b - a)


def of_window(rig: FreeRig, ticks: int) -> Window:
    """Simulate a window and return its measures."""
    motion = rig.motion
    motion.advance(ticks)
    y = motion.outputs_at(motion.states, motion.mode_sets_of_states)[:, 0]
    _, events, places = motion.met()
    edges = np.array([0.0, *((events[:, 0] + places) * rig.step), ticks * rig.step])
    held = np.array([bool(rig.stuck(key)) for key in (*events[:, 3].tolist(), motion.key)])
    lasting = np.diff(edges) > _INSTANT * edges[-1]
    sticks = held[lasting]
    begins = edges[:-1][lasting][1:][sticks[1:] & ~sticks[:-1]]  # of stick
    period = _NO
    if len(begins) > 1:
        period = float(begins[-1] - begins[0]) / (len(begins) - 1)
    surfaces = np.array([patch.surface for patch in rig.system.patches]).T
    speeds = np.abs(motion.states @ surfaces).mean(axis=0)
    swings = 0.5 * np.ptp(motion.states @ rig.system.slip_rows.T, axis=0)
    standing_still = np.full(len(swings), np.inf)
    slip = float(np.max(np.divide(swings, speeds, out=standing_still, where=speeds > 0.0)))
    return _measured(y, np.ones(ticks), edges, held)._replace(period=period, slip=slip)


def _measured(y: Array, weights: Array, edges: Array, held: NDArray[np.bool_]) -> Window:
    """Measures of the output at ticks, of which the first ones have weights, and of stick between events [s]."""
    low = -_top(-y)
    high = _top(y)
    within = y[: len(weights)]
    away = within - weights @ within / weights.sum()
    rms = math.sqrt(float(weights @ away**2 / weights.sum()))
    share = float(np.diff(edges) @ held) / float(edges[-1])
    inner = y[1:-1]
    maxima = inner[(inner > y[:-2]) & (inner >= y[2:])]
    return Window(low, high, rms, share, _NO, maxima)


def _top(y: Array) -> float:
    """The highest of evenly spaced samples; where they are smooth, by a parabola through three of them."""
    i = int(y.argmax())
    if not 2 <= i < len(y) - 2:
        return float(y[i])
    a, b, c, d, e = y[i - 2 : i + 3].tolist()
    bend = b - 2.0 * c + d
    bends = (a - 2.0 * b + c, bend, c - 2.0 * d + e)
    if max(bends) < 0.5 * min(bends) < 0.0:  # not beside a corner
        return float(c - (d - b) ** 2 / (8.0 * bend))
    return float(y[i])


def over_sectors(turns: Sequence[Window], _: bool) -> int:
    """Return the state after some turns over sectors; UNDECIDED asks for another turn."""
    if len(turns) >= TURNS and all(window.share > 0.0 for window in turns[-TURNS:]):
        return STICK_SLIP
    calm = len(turns) > 1 and not any(window.share > 0.0 for window in turns[-2:])
    return SLIDING if calm and turns[-1].slip <= _EQUAL * turns[-2].slip else UNDECIDED


def standing(windows: Sequence[Window], _: bool) -> int:
    """Return the state after some windows of a rig whose surfaces stand still."""
    return STUCK if windows[-1].share >= 1.0 else UNDECIDED


def irregular(windows: Sequence[Window], over: bool, kick: float) -> int:
    """Return the state of a motion that does not repeat when the time is over; UNDECIDED if it drifts.

    `kick`: amplitude of the slip speed at a near start, over the speed of the surface.
    """
    if not over or len(windows) < _FEWEST:
        return UNDECIDED
    steps = np.diff([window.slip for window in windows])
    half = len(steps) // 2
    drift = max(abs(float(steps[:half].sum())), abs(float(steps[half:].sum())))
    if drift > 0.5 * float(np.abs(steps).sum()):
        return UNDECIDED
    sticks = [window.share > 0.0 for window in windows]
    if all(sticks):
        return STICK_SLIP
    swings = all(window.slip > _GROWN * kick for window in windows)
    return VIBRATION if swings and not any(sticks) else UNDECIDED
