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

from rig.analysis.return_map import Carried, Flow
from rig.solve.records import CLOSED, OPEN

Array = NDArray[np.float64]
_ROUNDS = 12
_SAME = 1e-7  # of the length of a tick: an extremum is located, and its value to rounding


class Interval(NamedTuple):
    """A time between two events [s] with its mode set, and the states at its ticks, which begin at `first`."""

    begin: float
    end: float
    key: int
    first: int
    states: Array


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


def intervals(flow: Flow, run: Carried, period: float) -> list[Interval]:
    """Split a run over a period, with its states, at its events."""
    times = [0.0, *(t for t, _ in run.events), period]
    keys = [*(event.before for _, event in run.events), run.key]
    out = []
    for begin, end, key in zip(times, times[1:], keys):
        first = int(np.ceil(begin / flow.step - 1e-9))
        last = int(np.floor(end / flow.step + 1e-9))
        out.append(Interval(begin, end, key, first, run.states[first : last + 1]))
    return out


def distances(flow: Flow, run: Carried, period: float, what: str = "", only: int = -1) -> list[Distance]:
    """Return all distances of a cycle from other events, each over the largest value of its kind in the period.

    `what`, `only`: no more than those of one kind (and of kinds that are computed with it), in one interval.
    """
    out: list[Distance] = []
    parts = intervals(flow, run, period)
    for number, part in enumerate(parts):
        if only not in (-1, number):
            continue
        if what in ("", "slip"):
            out += _of_slip(flow, part, number)
        if what in ("", "closed", "open"):
            out += _of_normals(flow, part, number)
        if number and what in ("", "touch"):
            out += _of_touches(flow, part, parts[number - 1], number)
        if number and what in ("", "stick", "landing"):
            out += _of_sticks(flow, part, parts[number - 1], number)
    return out


def _of_slip(flow: Flow, part: Interval, number: int) -> Iterator[Distance]:
    modes, system = flow.modes(part.key), flow.system
    for p, patch in enumerate(system.patches):
        sigma = float(modes.sigma[p])
        if sigma and flow.closed(part.key, p):
            row = sigma * system.slip_rows[p]
            if (least := _minimum(flow, part, row)) is not None:
                scale = float(np.abs(part.states @ row).max())
                yield Distance("slip", patch.name, number, least / scale)


def _of_normals(flow: Flow, part: Interval, number: int) -> Iterator[Distance]:
    modes, system = flow.modes(part.key), flow.system
    for k, (normal, mode) in enumerate(zip(system.normals, system.modes(part.key)[1])):
        if not normal.opens or modes.normal_t[k].any() or normal.inertia.any():
            continue
        what, row = {CLOSED: ("closed", modes.normal[k]), OPEN: ("open", -normal.row)}[mode]
        if (least := _minimum(flow, part, row)) is not None:
            yield Distance(what, normal.name, number, least / float(np.abs(part.states @ row).max()))


def _of_touches(flow: Flow, part: Interval, before: Interval, number: int) -> Iterator[Distance]:
    """Of contacts that close at the begin of `part` and slip then."""
    modes = flow.modes(part.key)
    for p, patch in enumerate(flow.system.patches):
        closes = flow.closed(part.key, p) and not flow.closed(before.key, p)
        if closes and modes.sigma[p] and len(part.states):
            x = flow.within(part.states[0], part.key, part.begin - part.first * flow.step)
            speeds = part.states @ flow.system.slip_rows[p]
            value = float(modes.sigma[p] * flow.system.slip_rows[p] @ x)
            yield Distance("touch", patch.name, number, value / float(np.abs(speeds).max()))


def _of_sticks(flow: Flow, part: Interval, before: Interval, number: int) -> Iterator[Distance]:
    """Of contacts that begin or end to stick at the begin of `part`."""
    for p, patch in enumerate(flow.system.patches):
        row = flow.system.slip_rows[p]
        was, sticks = flow.stuck(before.key, p), flow.stuck(part.key, p)
        if was and not sticks and flow.closed(part.key, p) and len(part.states):
            x = flow.within(part.states[0], part.key, part.begin - part.first * flow.step)
            h = 0.1 * flow.step
            ahead, behind = (row @ flow.rate(flow.within(x, part.key, s * h), part.key) for s in (1.0, -1.0))
            tau = before.end - before.begin
            speed = abs(float(flow.system.patches[p].surface @ x)) or 1.0
            yield Distance("stick", patch.name, number, -0.25 * abs(float(ahead - behind)) / h * tau**2 / speed)
        if sticks and not was and flow.closed(before.key, p) and len(before.states):
            tick = before.first + len(before.states) - 1
            x = flow.within(before.states[-1], before.key, before.end - tick * flow.step)
            rates = np.abs(
                [row @ flow.rate(state, before.key) for state in before.states[:: max(len(before.states) // 8, 1)]]
            )
            rate = float(row @ flow.rate(x, before.key)) / (float(rates.max()) or 1.0)
            yield Distance("landing", patch.name, number, rate**2)


def _minimum(flow: Flow, part: Interval, row: Array) -> float | None:
    """The smallest inner minimum of a row of the state in an interval; None without one."""
    values = part.states @ row
    inner = np.flatnonzero((values[1:-1] <= values[:-2]) & (values[1:-1] < values[2:])) + 1
    if not len(inner):
        return None
    k = int(inner[values[inner].argmin()])
    x, t = part.states[k], 0.0
    a, b, c = values[k - 1 : k + 2].tolist()
    bend = (a - 2.0 * b + c) / flow.step**2
    slope = float(row @ flow.rate(x, part.key))
    for _ in range(_ROUNDS):
        step = -slope / bend
        t += step
        if not abs(t) < 2.0 * flow.step:
            return float(b)
        x = flow.within(part.states[k], part.key, t)
        new = float(row @ flow.rate(x, part.key))
        if abs(step) <= _SAME * flow.step or new == slope:
            break
        bend, slope = (new - slope) / step, new
    return float(row @ x)
