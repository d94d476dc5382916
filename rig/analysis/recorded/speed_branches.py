"""The branches of a run-up and run-down: where a speed rises and where it falls, without the holds between."""

from __future__ import annotations

from itertools import pairwise
from typing import NamedTuple

import numpy as np

from rig.record.run import Reals

_TURN = 0.05  # share of the whole range: a smaller reversal does not end a branch
_HELD = 0.01  # share of the range of a branch: the speed counts as held within this distance of its ends
_ROUNDING = 1e-9  # share of the largest speed: a smaller change counts as none


class Branch(NamedTuple):
    """From `begin` to `end` [s] the speed changes from `first` to `last`, in its unit."""

    begin: float
    end: float
    first: float
    last: float

    @property
    def rises(self) -> bool:
        """Whether it is a run-up."""
        return self.last > self.first

    @property
    def rate(self) -> float:
        """Rate of change of the speed [unit/s]; positive."""
        return (1.0 - 2.0 * _HELD) * abs(self.last - self.first) / (self.end - self.begin)


def branches(t: Reals, v: Reals) -> list[Branch]:
    """Return the branches of speed `v` at times `t` [s], in order of time; none if the speed does not change."""
    known = np.isfinite(v)
    t = t[known]
    v = v[known]
    least = _ROUNDING * np.abs(v).max(initial=0.0)
    v = np.where(np.abs(v) <= least, 0.0, v)  # the rounding of a ramp down to zero
    if v.size < 2 or np.ptp(v) <= least:
        return []
    turns = _turns(v, _TURN * float(np.ptp(v)))
    ramps = []
    for a, b in pairwise(turns):
        part = v[a : b + 1]
        near = _HELD * abs(v[b] - v[a])
        leaves = int(np.flatnonzero(np.abs(part - part[0]) <= near)[-1])
        comes = leaves + int(np.flatnonzero(np.abs(part[leaves:] - part[-1]) <= near)[0])
        if comes > leaves:
            ramps.append(Branch(float(t[a + leaves]), float(t[a + comes]), float(v[a]), float(v[b])))
    return ramps


def _turns(v: Reals, least: float) -> list[int]:
    """Indices of the turning points of `v`, more than `least` apart in value; first and last sample included."""
    turns: list[int] = []
    top = bottom = way = 0
    for i, speed in enumerate(v.tolist()):
        top = i if speed > v[top] else top
        bottom = i if speed < v[bottom] else bottom
        if way >= 0 and v[top] - speed > least:
            turns.append(top)
            way = -1
            bottom = i
        elif way <= 0 and speed - v[bottom] > least:
            turns.append(bottom)
            way = 1
            top = i
        if way > 0:
            bottom = i
        elif way < 0:
            top = i
    return [*turns, top if way > 0 else bottom]
