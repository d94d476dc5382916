"""Turning points of a motion: zeros of one coordinate's falling velocity, with the state there.

A motion without events, in which nothing sticks, is periodic if the states at its turning points repeat.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from rig.analysis.orbit import Orbit
from rig.stability.linearisation import Steady

Array = NDArray[np.float64]
ROUGH = 1e-6
SETTLED = 32
_MOST = 4  # most turning points in one cycle
_ROUNDS = 3  # compared cycles: two could agree by chance


@dataclass(frozen=True)
class Turn:
    """A turning point: time [s], state, and range of each state since the one before."""

    time: float
    x: Array
    span: Array


class Turns:
    """The turning points of an orbit since the last event, of the coordinate with the largest motion of its own."""

    def __init__(self, orbit: Orbit, sliding: Steady) -> None:
        self._orbit, self._sliding = orbit, sliding
        rates, shapes = sliding.eigenvectors()
        nq = len(sliding.system.coordinates)
        self._growth = float(rates[0].real)
        self._first = len(orbit.outputs)
        self._velocity = self._first + nq + int(np.abs(shapes[nq : 2 * nq, 0]).argmax())
        self._moving = sliding.moving
        self.found: list[Turn] = []
        self._history: list[float] = []
        self._asked = 0
        self._low = self._high = orbit.motion.x.copy()

    def clear(self) -> None:
        """Start again after an event."""
        self.found.clear()
        self._history.clear()
        self._asked = 0

    def add(self) -> None:
        """Search the last block of the orbit for turning points."""
        motion = self._orbit.motion
        step, segments = motion.integration.step_ns * 1e-9, motion.segments
        offset = (motion.tick - len(motion.states)) * step
        self._low = np.minimum(self._low, motion.states.min(axis=0))
        self._high = np.maximum(self._high, motion.states.max(axis=0))
        n = int(segments.count[0])
        velocity = segments.coef[:n, self._velocity]
        ends = velocity.sum(axis=1)
        for j in np.flatnonzero((velocity[:, 0] > 0.0) & (ends <= 0.0)):
            u = _zero(velocity[j])
            x = np.polynomial.polynomial.polyval(u, segments.coef[j, self._first :].T)
            time = offset + float(segments.start[j] + u * segments.length[j])
            self.found.append(Turn(time, np.asarray(x), self._high - self._low))
            self._low = self._high = np.asarray(x)

    def closes(self, repeat: float) -> tuple[float, float] | None:
        """Return the period [s] of a motion that repeats, and its deviation over its range; None if it does not repeat.

        It repeats to `repeat`, or as well as it can: to `ROUGH` at least and no better for `SETTLED` turns, as with a
        friction law whose kink limits the integration.
        """
        if len(self.found) == self._asked:
            return None
        self._asked = len(self.found)
        period, off = min((self._off(count) for count in range(1, _MOST + 1)), key=lambda one: one[1] > repeat)
        self._history.append(off)
        late, before = self._history[-SETTLED:], self._history[-2 * SETTLED : -SETTLED]
        settled = len(before) == SETTLED and max(late) <= ROUGH and min(late) >= 0.5 * min(before)
        return (period, max(late) if settled else off) if off <= repeat or settled else None

    def _off(self, count: int) -> tuple[float, float]:
        """Period [s] of `count` turns, and the largest difference between the last rounds, relative to the range."""
        last = self.found[-(_ROUNDS - 1) * count - 1 :]
        if len(last) <= (_ROUNDS - 1) * count:
            return math.nan, math.inf
        span = np.max([turn.span for turn in last], axis=0)[self._moving]
        period = last[-1].time - last[-1 - count].time
        off = [abs((b.time - a.time) / period - 1.0) for a, b in zip(last, last[count:])]
        away = [np.abs(b.x - a.x)[self._moving] for a, b in zip(last, last[count:])]
        off += [float(np.divide(one, span, out=np.full(len(span), math.inf), where=span > 0.0).max()) for one in away]
        return period, max(off)

    def dying(self, since: float) -> bool:
        """Return whether the rest of the motion since `since` [s] decays as a small motion about sliding does."""
        turns = [turn for turn in self.found if turn.time >= since]
        if self._growth >= 0.0:
            return False
        if len(turns) < 2:
            return True  # it has no turning points at all
        size = np.max([turn.span for turn in turns], axis=0)[self._moving]
        far = [float((np.abs(t.x - self._sliding.x)[self._moving] / np.maximum(size, 1e-300)).max()) for t in turns]
        rate = math.log(max(far[0], 1e-300) / max(far[-1], 1e-300)) / (turns[-1].time - turns[0].time)
        return rate >= -0.5 * self._growth


def _zero(polynomial: Array) -> float:
    """First zero in 0..1 of a polynomial that falls from above zero."""
    from scipy.optimize import brentq

    def value(u: float) -> float:
        return float(np.polynomial.polynomial.polyval(u, polynomial))

    return 1.0 if value(1.0) >= 0.0 else float(brentq(value, 0.0, 1.0, xtol=1e-15))
