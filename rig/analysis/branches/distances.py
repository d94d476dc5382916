"""How far a cycle is from other events: of each contact the distance from grazing, lift-off, landing and jump.

    slip     smallest slip speed while the contact is loaded, at an inner minimum: zero at grazing
    stick    -w'' tau^2 / 2, w'': second derivative of the slip speed after a stick of the length tau: the depth to
             which the slip would have gone on. It continues the first one smoothly to first order
    closed   smallest normal force while the contact is closed, at an inner minimum: zero at lift-off
    open     smallest distance, as a force, while the contact is open: zero at landing
    touch    slip speed where the contact closes and slips: below zero it would slip the other way, or stick
    landing  square of w' where a stick begins: zero where the slip speed only touches zero. If the stick is longer than
             zero there, the motion beyond misses the stick: a jump

Each is linear along a branch where it vanishes.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from rig.bench.free_rig import Carried, FreeRig, Interval
from rig.solve.records import CLOSED, OPEN

Array = NDArray[np.float64]
_ROUNDS = 12  # most steps of the secant method
_SAME = 1e-7  # of the length of a tick: an extremum is located, and its value to rounding
_BESIDE = 0.1  # of a tick: half the width of the difference that tells the second derivative
_STATES = 8  # states of an interval that tell the largest rate of its slip speed


class Distance(NamedTuple):
    """One distance: what (see above), contact, number of the interval in the period, and the value over its scale."""

    what: str
    contact: str
    interval: int
    value: float

    @property
    def name(self) -> tuple[str, str, int]:
        """What identifies it on a branch with the same events."""
        return self.what, self.contact, self.interval


def distances(rig: FreeRig, run: Carried, period: float, what: str = "", only: int = -1) -> list[Distance]:
    """Return all distances of a cycle from other events, each over the largest value of its kind in the period.

    `what`, `only`: no more than those of one kind (and of kinds that are computed with it), in one interval.
    """
    out: list[Distance] = []
    parts = run.intervals(rig.step, period)
    for number, part in enumerate(parts):
        if only not in (-1, number):
            continue
        if what in ("", "slip"):
            out += _of_slip(rig, part, number)
        if what in ("", "closed", "open"):
            out += _of_normals(rig, part, number)
        if number and what in ("", "touch"):
            out += _of_touches(rig, part, parts[number - 1], number)
        if number and what in ("", "stick", "landing"):
            out += _of_sticks(rig, part, parts[number - 1], number)
    return out


def _of_slip(rig: FreeRig, part: Interval, number: int) -> Iterator[Distance]:
    modes = rig.modes(part.key)
    for p, patch in enumerate(rig.system.patches):
        sigma = float(modes.sigma[p])
        if sigma and rig.closed(part.key, p):
            row = sigma * rig.system.slip_rows[p]
            least = _minimum(rig, part, row)
            if least is not None:
                scale = float(np.abs(part.states @ row).max())
                yield Distance("slip", patch.name, number, least / scale)


def _of_normals(rig: FreeRig, part: Interval, number: int) -> Iterator[Distance]:
    modes = rig.modes(part.key)
    normals = rig.system.normals
    for k, (normal, mode) in enumerate(zip(normals, rig.system.modes(part.key)[1])):
        if not normal.opens or modes.normal_t[k].any() or normal.inertia.any():
            continue
        what, row = {CLOSED: ("closed", modes.normal[k]), OPEN: ("open", -normal.row)}[mode]
        least = _minimum(rig, part, row)
        if least is not None:
            scale = float(np.abs(part.states @ row).max())
            yield Distance(what, normal.name, number, least / scale)


def _of_touches(rig: FreeRig, part: Interval, before: Interval, number: int) -> Iterator[Distance]:
    """Of contacts that close at the begin of `part` and slip then."""
    modes = rig.modes(part.key)
    for p, patch in enumerate(rig.system.patches):
        closes = rig.closed(part.key, p) and not rig.closed(before.key, p)
        if closes and modes.sigma[p] and len(part.states):
            row = rig.system.slip_rows[p]
            x = rig.within(part.states[0], part.key, part.begin - part.first * rig.step)
            scale = float(np.abs(part.states @ row).max())
            value = float(modes.sigma[p] * row @ x)
            yield Distance("touch", patch.name, number, value / scale)


def _of_sticks(rig: FreeRig, part: Interval, before: Interval, number: int) -> Iterator[Distance]:
    """Of contacts that begin or end to stick at the begin of `part`."""
    for p, patch in enumerate(rig.system.patches):
        stuck = p in rig.stuck(before.key)
        sticks = p in rig.stuck(part.key)
        if stuck and not sticks and rig.closed(part.key, p) and len(part.states):
            yield Distance("stick", patch.name, number, _overshoot(rig, part, before, p))
        if sticks and not stuck and rig.closed(before.key, p) and len(before.states):
            rate = _landing_rate(rig, before, p)
            yield Distance("landing", patch.name, number, rate**2)


def _overshoot(rig: FreeRig, part: Interval, before: Interval, p: int) -> float:
    """The depth to which the slip would have gone on without the stick `before` `part`, over the surface speed."""
    row = rig.system.slip_rows[p]
    x = rig.within(part.states[0], part.key, part.begin - part.first * rig.step)
    h = _BESIDE * rig.step
    ahead = row @ rig.rate(rig.within(x, part.key, h), part.key)
    behind = row @ rig.rate(rig.within(x, part.key, -h), part.key)
    tau = before.end - before.begin
    speed = abs(float(rig.system.patches[p].surface @ x)) or 1.0
    return -0.25 * abs(float(ahead - behind)) / h * tau**2 / speed


def _landing_rate(rig: FreeRig, before: Interval, p: int) -> float:
    """The rate of the slip speed at the end of `before`, over its largest rate."""
    row = rig.system.slip_rows[p]
    tick = before.first + len(before.states) - 1
    x = rig.within(before.states[-1], before.key, before.end - tick * rig.step)
    some_states = before.states[:: max(len(before.states) // _STATES, 1)]
    rates = np.abs([row @ rig.rate(state, before.key) for state in some_states])
    return float(row @ rig.rate(x, before.key)) / (float(rates.max()) or 1.0)


def _minimum(rig: FreeRig, part: Interval, row: Array) -> float | None:
    """The smallest inner minimum of a row of the state in an interval; None without one."""
    values = part.states @ row
    inner = np.flatnonzero((values[1:-1] <= values[:-2]) & (values[1:-1] < values[2:])) + 1
    if not len(inner):
        return None
    k = int(inner[values[inner].argmin()])
    x = part.states[k]
    t = 0.0
    a, b, c = values[k - 1 : k + 2].tolist()
    bend = (a - 2.0 * b + c) / rig.step**2
    slope = float(row @ rig.rate(x, part.key))
    for _ in range(_ROUNDS):
        step = -slope / bend
        t += step
        if not abs(t) < 2.0 * rig.step:
            return float(b)
        x = rig.within(part.states[k], part.key, t)
        new = float(row @ rig.rate(x, part.key))
        if abs(step) <= _SAME * rig.step or new == slope:
            break
        bend = (new - slope) / step
        slope = new
    return float(row @ x)
