"""A point of a branch: a cycle with its derivative and tangent, closed to the range of each state.

A cycle moves along its tangent, to a value of the parameter, or to another base: into the middle of the longest slip,
with its period in parts if motions beside it depart by orders of magnitude, and in scales of its own size.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from functools import cached_property
from itertools import pairwise

import numpy as np

from rig.analysis.branches.distances import distances
from rig.analysis.cycles import variational
from rig.analysis.cycles.return_map import (
    CLOSE,
    CLOSEST,
    FLAT,
    Array,
    Derivative,
    NoCycle,
    ReturnMap,
    multipliers,
    parameter,
    sizes,
)
from rig.bench.free_rig import Carried, FreeRig
from rig.errors import NumericsError, SceneError
from rig.stability.linearisation import linearised, own_law

Name = tuple[str, str, int]
FIRST = 0.02
"""First step along a branch, of the size of the motion, of its period and of the parameter."""
FAILURES = (NoCycle, NumericsError, SceneError)
_GROWS = 1e-8  # a multiplier beyond the unit circle by this, and by ten times its error, is unstable
_CLOSINGS = 3  # Newton steps that close a motion which is small in the scales of the map
_ULPS = 16  # rounding of a state after a period, in units of its last digit
_SPLITS = 1e3  # a part that magnifies differences by more is cut
_PART = 20.0  # growth in a part that is cut,
_SAMPLES = 400  # and states of a period by which it is estimated
_AWAY = 3.0  # ticks: no part begins closer to an event
_SOON = 1e-9  # seconds: times that are the same
_OTHER_STEPS = (7e-6, 7e-7, 7e-5)  # of differences, for the accuracy of multipliers: others than those of a place
_UNSURE = 1e-7  # error of a multiplier of the shift above which a law is no smooth one, such as a table
_SURE = 10.0  # times the error of a multiplier of the shift: accuracy of the others. measured on 140 motions: up to 3.4
_MISSES = 1e-12  # of a state: a motion that misses its start by more is closed for its multipliers
_LEAST = 1e-9  # stated accuracy of a multiplier: two integrations agree to it
_FORWARD = 1e-5  # along the branch: the displacement that tells its direction from a new base
_RESCALE = 2.0  # a scale that is wrong by this factor is renewed


@dataclass(frozen=True)
class Place:
    """A point of a branch for the continuation: unknowns, run, derivative, tangent, all in the scales of `map`.

    `step`: the step that is tried from here.
    """

    map: ReturnMap
    u: Array
    end: Carried
    d: Derivative
    t: Array
    step: float = FIRST

    @property
    def p(self) -> float:
        """The parameter."""
        return float(self.u[-1] * self.map.P0)

    @property
    def period(self) -> float:
        """The period [s]."""
        return float(self.u[-2] * self.map.T0)

    @property
    def multipliers(self) -> tuple[tuple[complex, ...], float]:
        """Floquet multipliers, and how far that of the shift is from 1."""
        return self._multipliers(self.d.parts)

    def _multipliers(self, parts: Array) -> tuple[tuple[complex, ...], float]:
        """The multipliers from derivatives of the parts.

        All motions that stick leave the same surface at the same slip speed, zero: the smallest multiplier is zero.
        """
        values, error = multipliers(parts, self.map.period is not None)
        keys = (self.end.first, self.end.key, *(event.before for _, event in self.end.events))
        if values and any(self.rig.stuck(key) for key in keys):
            values = (*values[:-1], 0j)
        return values, error

    def known_multipliers(self) -> tuple[tuple[complex, ...], float]:
        """Floquet multipliers as well as they can be known, and their accuracy, relative to the larger of 1 and each.

        Of a motion without events they come from its variational equation, whose error that of the shift tells, and
        where the motion has to be closed, by how much that moves them for what it still misses. Of others, and of
        forced motions, the accuracy is the distance between two ways to compute them.
        """
        values, _ = self.multipliers
        if not any(values):
            return values, 0.0
        first = self._variational(self.u) if not self.end.events else None
        closed = first
        if first is not None and np.abs(first[0]).max() > _MISSES:
            closed = self._variational(self._closer(*first))
        if first is not None and closed is not None:
            exact, error = self._multipliers(closed[1])
            if not error > _UNSURE:
                moved = _apart(self._multipliers(first[1])[0], exact)
                missed = np.abs(closed[0]).max() / max(np.abs(first[0]).max(), _MISSES)
                by_shift = _SURE * error if error == error else _apart(values, exact)
                return exact, max(by_shift, _SURE * float(moved * missed), _LEAST)
        try:
            again = self.map.derivative(self.u, self.end, over_p=False, steps=_OTHER_STEPS)
        except FAILURES:
            return values, math.nan
        return values, max(_apart(values, self._multipliers(again.parts)[0]), _LEAST)

    def _variational(self, u: Array) -> tuple[Array, Array] | None:
        """By how much each part misses the next [part, i], and its derivative, from the variational equation, over the
        size of each state; None if it has none or every motion is linear, so that differences have no error but
        rounding.
        """
        map = self.map
        begins = [tick * self.rig.step for tick in map.ticks]
        starts = u[:-2].reshape(len(begins), -1)
        misses = []
        parts = []
        for i, (part, begin, end) in enumerate(
            zip(self.end.parts or (self.end,), begins, [*begins[1:], float(u[-2] * map.T0)])
        ):
            if not self.rig.modes(part.first).nonlinear.any():
                return None
            integrated = variational.derivative(self.rig, map.state(u, i), part.first, end - begin)
            if integrated is None:
                return None
            x, P = integrated
            misses.append(x / map.size - starts[(i + 1) % len(starts)])
            parts.append(P * map.size / map.size[:, None])
        return np.array(misses), np.array(parts)

    def _closer(self, misses: Array, parts: Array) -> Array:
        """The unknowns of the cycle at the same parameter, from misses and derivatives of the variational equation.

        Where multipliers are large, a run leaves the cycle by what it misses, and has other multipliers.
        """
        along = self.map.along(self.u)
        M = np.vstack([self.map.matrix(self.u, replace(self.d, parts=parts), along), np.eye(len(self.u))[-1]])
        step, *_ = np.linalg.lstsq(M, np.append(misses.ravel(), [0.0, 0.0]), rcond=FLAT)
        return self.map.shifted(self.u, -step)

    @property
    def magnified(self) -> float:
        """The largest factor by which the parts of the period together magnify a difference."""
        return math.prod(float(np.linalg.norm(part, 2)) for part in self.d.parts)

    @property
    def unstable(self) -> int:
        """How many multipliers lie outside of the unit circle."""
        values, error = self.multipliers
        known_error = 10.0 * error if error == error else 0.0
        return sum(abs(m) > 1.0 + max(_GROWS, known_error) for m in values)

    @cached_property
    def run(self) -> Carried:
        """The run over a period, with the states at its ticks."""
        return self.map.end(self.u, keep=True)

    @property
    def rig(self) -> FreeRig:
        """The rig."""
        return self.map.rig(self.u)

    def distances(self) -> dict[Name, float]:
        """The distances from other events, by name."""
        return {d.name: d.value for d in distances(self.rig, self.run, self.period)}


def _apart(values: Sequence[complex], others: Sequence[complex]) -> float:
    """The largest distance of multipliers from the nearest of others, over the larger of 1 and their size."""

    def nearest(v: complex) -> float:
        return min(abs(v - w) for w in others)

    return max(nearest(v) / max(1.0, abs(v)) for v in values)


def place(
    map: ReturnMap,
    u: Array,
    end: Carried,
    forward: Array | None = None,
    t: Array | None = None,
    held: bool = False,
) -> Place:
    """Return the place of a cycle with its derivative and tangent, closed to the range of each state.

    `forward`: a direction that the tangent follows; `t`: the tangent itself; `held`: the parameter keeps its value.
    """
    d = map.derivative(u, end)
    if t is None:
        A = map.matrix(u, d, map.along(u))
        t = np.asarray(np.linalg.svd(A)[2][-1])
        if forward is not None and float(t @ forward) < 0.0:
            t = -t
    closed = closed_to_itself(Place(map, u, end, d, t), held)
    if float(np.linalg.norm(closed.u - u)) > CLOSEST:  # where the map bends, its derivative is another one
        with suppress(*FAILURES):
            return replace(closed, d=map.derivative(closed.u, closed.end))
    return closed


def closed_to_itself(at: Place, held: bool) -> Place:
    """Return the place with its motion closed to CLOSEST of its own range, which may be far below the map's scales."""
    map = at.map
    along = map.along(at.u)
    A = map.matrix(at.u, at.d, along)
    M = np.vstack([A, np.append(np.zeros(len(at.u) - 1), 1.0) if held else at.t])
    for _ in range(_CLOSINGS):
        misses = missed(at)
        if misses <= CLOSEST:
            break
        residual = np.append(map.residual(at.u, at.end, at.u, along), 0.0)
        step, *_ = np.linalg.lstsq(M, residual, rcond=FLAT)
        u = map.shifted(at.u, -step)
        closer = replace(at, u=u, end=map.end(u))
        if closer.end.met != at.end.met or not missed(closer) < misses:
            break
        at = closer
    return at


def missed(at: Place) -> float:
    """By how much the motion misses its start, beyond the rounding of its states, over the range of each state."""
    states = at.run.states
    parts = at.run.parts or (at.run,)
    next_parts = (*parts[1:], parts[0])
    rounding = _ULPS * np.finfo(float).eps * np.abs(states).max(axis=0)
    far = np.max([np.abs(a.x - b.states[0]) for a, b in zip(parts, next_parts)], axis=0)
    far = np.maximum(far - rounding, 0.0)
    return float((far[at.rig.moving] / sizes(np.ptp(states, axis=0), at.rig)).max())


def stepped(at: Place, ds: float) -> Place:
    """Return the place at the distance ds from another one, with the same events. Raises NoCycle, NotSmooth."""
    return place(at.map, *moved(at, ds), at.t)


def moved(at: Place, ds: float) -> tuple[Array, Carried]:
    """Return unknowns and run at the distance ds from a place. Raises NoCycle, NotSmooth."""
    return solved(at, at.map.shifted(at.u, ds * at.t), at.map, at.u)


def solved(at: Place, guess: Array, map: ReturnMap, reference: Array) -> tuple[Array, Carried]:
    """Solve for the cycle of a map near a guess, on the plane across the tangent of a place, with the same events.

    `reference`: of the phase. Raises NoCycle, NotSmooth.
    """

    def plane(v: Array, _: Carried) -> tuple[float, Array]:
        return float(at.t @ (v - guess)), at.t

    first = np.vstack([at.map.matrix(at.u, at.d, at.map.along(at.u)), at.t])
    return map.newton(guess, plane, reference, at.end.met, first=first)


def at_value(at: Place, p: float) -> Place:
    """Return the place at the parameter p, near another one, with the same events. Raises NoCycle, NotSmooth."""
    target = p / at.map.P0
    closing = parameter(target, len(at.u))
    share = (target - at.u[-1]) / at.t[-1] if at.t[-1] else 0.0
    guess = at.u + share * at.t
    guess[-1] = target
    M = np.vstack([at.map.matrix(at.u, at.d, at.map.along(at.u)), closing(guess, at.end)[1]])
    u, end = at.map.newton(at.map.shifted(guess, 0.0 * guess), closing, at.u, at.end.met, first=M)
    return place(at.map, u, end, at.t, held=True)


class Parts:
    """The period of the cycle of a place in parts, none of which magnifies a difference by much, from a base that no
    event is near to.
    """

    def __init__(self, at: Place) -> None:
        self.at = at
        self.rig = at.rig
        self.events = [time / at.rig.step for time, _ in at.run.events]

    def first(self) -> Place:
        """The place with its period in parts. Raises NoCycle if it is in parts, or needs none."""
        wanted = self._wanted()
        if not wanted or self.at.map.cut:
            raise NoCycle("the motion does not close to the digits of its state")
        return self._from(wanted)

    def renewed(self) -> Place:
        """The place with its base in the middle of the longest slip, if it has come near to an event, and its period in
        other parts, if these have.
        """
        at = self.at
        map = at.map
        large = max(float(np.linalg.norm(part, 2)) for part in at.d.parts) > _SPLITS
        if large or map.cut:
            wanted = self._wanted()
            free = map.ticks if map.period is None else map.ticks[1:]  # a forced motion keeps its base
            moved = len(map.ticks) > len(wanted) + 1 or any(self._beside(tick, 0.5) for tick in free)
            if wanted:
                return self._from(wanted) if large or moved else at
        later = map.better_base(at.u, at.run) if map.period is None else None
        if later is not None:
            return self._from([round(later / self.rig.step)])
        return self._from([0]) if map.cut else at

    def _beside(self, tick: float, share: float = 1.0) -> bool:
        """Whether a tick lies beside an event, of this period or of the next one."""
        period = self.at.period / self.rig.step
        away = [abs(tick - event) for event in self.events]
        return any(min(ticks, period - ticks) < share * _AWAY for ticks in away)

    def _grown(self) -> list[int]:
        """The ticks at which small differences have grown by a further factor `_PART`, by the rates of growth of
        sliding at the states of the run.
        """
        rig = self.rig
        run = self.at.run
        ticks: list[int] = []
        growth = 0.0
        level = math.log(_PART)
        stride = max(len(run.states) // _SAMPLES, 1)
        for part in run.intervals(rig.step, self.at.period):
            modes = rig.modes(part.key)
            law = own_law(rig.system, modes)
            for i in range(0, len(part.states), stride):
                A = linearised(rig.system, modes, part.states[i], law)[0][np.ix_(rig.moving, rig.moving)]
                rate = float(np.linalg.eigvals(A).real.max())
                growth += max(rate, 0.0) * rig.step * stride
                tick = part.first + i
                if growth > level and 1 < tick < len(run.states) - 2 and not self._beside(tick):
                    ticks.append(tick)
                    level = growth + math.log(_PART)
        return ticks

    def _wanted(self) -> list[int]:
        """The ticks at which the parts should begin, in their order from the longest gap on."""
        grown = self._grown()
        if not grown:
            return []
        if self.at.map.period is not None:
            return [0, *grown]
        period = round(self.at.period / self.rig.step)
        gap, last = max((b - a, i) for i, (a, b) in enumerate(pairwise([*grown, grown[0] + period])))
        in_order = [*grown[last + 1 :], *grown[: last + 1]]
        middle = grown[last] + gap // 2
        for away in range(gap // 3):
            for tick in ((middle + away) % period, (middle - away) % period):
                if not self._beside(tick):
                    return [*in_order, tick] if tick else in_order
        return in_order

    def _from(self, ticks: Sequence[int]) -> Place:
        """The place with parts that begin at these ticks (of the old base), the first of them at the new base."""
        at = self.at
        step = self.rig.step
        size = at.map.size
        moving = self.rig.moving
        after = [round((tick - ticks[0]) * step % at.period / step) for tick in ticks]  # the new base
        new = self._starts(at.u, ticks[0], after)
        map = at.map.scaled(size, at.map.T0, at.map.P0)
        map.begins = tuple((tick, run.key) for tick, run in zip(after, new))
        if not ticks[0]:
            map.begins = (at.map.begins[0], *map.begins[1:])
        x = np.concatenate([run.x[moving] / size for run in new])
        forward = np.zeros(len(x))
        if len(at.map.begins) == len(ticks) == 1:  # in parts differences grow too much to tell the direction
            beside = self._starts(at.map.shifted(at.u, _FORWARD * at.t), ticks[0], after)[0]
            forward = ((beside.x - new[0].x)[moving] / size) / _FORWARD
        u = np.append(x, at.u[-2:])
        based = place(map, u, map.end(u), np.append(forward, at.t[-2:]))
        if missed(based) > CLOSE:  # the parts of a motion that has departed on its way
            based = stepped(based, 0.0)
        return replace(based, step=at.step)

    def _starts(self, u: Array, base: int, ticks: Sequence[int]) -> list[Carried]:
        """The runs of the motion at u to where parts begin, at ticks after a new base."""
        map = self.at.map
        step = self.rig.step
        runs = []
        for after in ticks:
            time = (base + after) * step
            if time > self.at.period:
                time -= float(u[-2] * map.T0)
            number = max(i for i, tick in enumerate(map.ticks) if tick * step <= time + _SOON)
            runs.append(map.rig(u).carried(map.state(u, number), time - map.ticks[number] * step))
        return runs


def rescaled(at: Place) -> Place:
    """Return the place in scales of its own size, if it has grown or shrunk."""
    if at.map.period is not None:
        return at
    map = at.map
    size = sizes(np.ptp(at.run.states, axis=0), at.rig)
    T0 = at.period
    P0 = abs(at.p) or map.P0
    ratio = np.concatenate([map.size / size, [map.T0 / T0, map.P0 / P0]])
    if np.all((ratio < _RESCALE) & (ratio > 1.0 / _RESCALE)):
        return at
    y = ratio[:-2]
    d = replace(
        at.d,
        parts=at.d.parts * y[:, None] / y[None, :],
        over_p=at.d.over_p * y / ratio[-1],
        end_rate=at.d.end_rate * y / ratio[-2],
    )
    ratio = np.append(np.tile(y, len(at.d.parts)), ratio[-2:])
    t = at.t * ratio
    return Place(map.scaled(size, T0, P0), at.u * ratio, at.end, d, t / np.linalg.norm(t))
