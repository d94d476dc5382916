"""Follow cycles along one parameter by pseudo-arclength, past special points and changes of their events.

A branch is smooth as long as its events stay the same, and no run may leave them: where Newton's method meets others,
the step is halved. What is then left of the way ends at a boundary. It is located as the zero of a distance
(rig.analysis.branches.distances), or by halving. Beyond it, states beside the last point that meet other events give
the derivative of the return map there, and its kernel gives the direction in which the cycles with these events go on.
Folds, period doublings and torus points are zeros of functions of the derivative between two points.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Collection, Iterator, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from itertools import combinations, pairwise
from typing import NamedTuple

import numpy as np

from rig.analysis.branches.distances import distances
from rig.analysis.eigenvalue_curves import edge
from rig.analysis.return_map import (
    CLOSE,
    CLOSED_TO,
    FLAT,
    Array,
    Derivative,
    NoCycle,
    NotSmooth,
    ReturnMap,
    multipliers,
    parameter,
    sizes,
    word,
)
from rig.bench.free_rig import Carried, FreeRig
from rig.errors import NumericsError, SceneError
from rig.stability.linearisation import linearised, own_law, steady

Met = tuple[int, tuple[str, ...]]
Name = tuple[str, str, int]
FIRST, LONGEST, SHORTEST = 0.02, 0.12, 1e-5
"""Steps along a branch, of the size of the motion, of its period and of the parameter."""
VIRTUAL = 1e-3
"""Smallest amplitude of a cycle that is followed, over the surface speed."""
_BENDS = 0.9  # cosine of two tangents: below it a step is too long
_GROWTH, _EASY = 1.5, 6  # of the step, after a Newton iteration of at most so many runs
_EDGE = 1e-11  # of the same size: how closely a boundary is located
_SHARES = (1.0, 0.95, 0.5, 0.1, 0.01)  # of the way to a zero; the first leads beyond it
_ROUNDS = 40
_BESIDE = 1e-6  # along the branch: the derivative of the return map is still the same
_SPLITS = 1e3  # a part that magnifies differences by more is cut
_PART, _SAMPLES = 20.0, 400  # growth in a part that is cut, and states of a period by which it is estimated
_AWAY, _SOON = 3.0, 1e-9  # ticks: no part begins closer to an event; seconds: times that are the same
_RESCALE = 2.0
_LEVEL = 1e-6  # slope of a branch in the parameter: below it the branch is upright
_UPRIGHT = 12  # places in parts whose parameters are the same to the digits of their motions: a canard
_GROWS = 1e-8  # a multiplier beyond the unit circle by this, and by ten times its error, is unstable
_LOOSE, _PASSES = 1e-7, 4  # of the parameter: a zero that is not reached; and how often the way to it is halved then
_CLOSINGS = 3  # Newton steps that close a motion which is small in the scales of the map
_SMALL = 0.02  # range of the slip speed over its mean: smaller cycles are those of the Hopf point
_ULPS = 16  # rounding of a state after a period, in units of its last digit
_NOISE = 1e-9  # of a multiplier
_PAIR = 1e-3  # how near to the unit circle the multipliers of a torus point lie
_TRIES = (1.0, 3.0, 10.0, 30.0, 100.0)
_BEYOND = (1e-3, 1e-2, 3e-4, 0.03)
_SHORT_OF = 1e-3  # of the largest cycle of a linear rig: where the branch is followed from
_GRAZES = 1.5  # times the way to the nearest zero of a distance: others so near vanish with it
_DIGITS = "cycles beyond it change within less than the digits of the parameter"
FAILURES = (NoCycle, NumericsError, SceneError)


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
        return multipliers(self.d.parts, self.map.period is not None)

    @property
    def unstable(self) -> int:
        """How many multipliers lie outside of the unit circle."""
        values, error = self.multipliers
        return sum(abs(m) > 1.0 + max(_GROWS, 10.0 * error if error == error else 0.0) for m in values)

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


class Measure(NamedTuple):
    """A number of a place that vanishes at a special point. `derived`: from the derivative of the return map, so that a
    branch passes the zero; else motions beyond it meet other events.
    """

    of: Callable[[Place], float]
    derived: bool = False


def _turn(at: Place) -> float:
    """The slope of the branch in the parameter: zero at a fold."""
    return float(at.t[-1])


def _doubling(at: Place) -> float:
    return float(np.prod([v + 1.0 for v in at.multipliers[0]]).real)


def _torus(at: Place) -> float:
    """Zero where two multipliers have the product 1: a pair on the unit circle, or two real ones (no torus)."""
    return float(np.prod([a * b - 1.0 for a, b in combinations(at.multipliers[0], 2)]).real)


SPECIAL = {
    "fold": Measure(_turn, derived=True),
    "period doubling": Measure(_doubling, derived=True),
    "torus": Measure(_torus, derived=True),
}
"""The special points of a branch with the same events, by what is zero there."""


@dataclass(frozen=True)
class Special:
    """A special point: what it is, place, contact it concerns, accuracy of the parameter, and whether p turns there.

    `name`: the distance that is zero there, if it is known.
    """

    kind: str
    at: Place
    p: float
    accuracy: float
    contact: str = ""
    turns: bool = False
    why: str = ""
    name: Name | None = None


@dataclass
class Segment:
    """Places with the same events, in their order, and the special points among them; `end`: why it stops."""

    places: list[Place] = field(default_factory=list)
    specials: list[Special] = field(default_factory=list)
    end: Special | None = None

    @property
    def names(self) -> tuple[str, ...]:
        """The events of a period, from a fixed one on."""
        return word(self.places[0].end.met[1]) if self.places else ()


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
    return _closed(Place(map, u, end, d, t), held)


def _closed(at: Place, held: bool) -> Place:
    """The place with its motion closed to CLOSE of its own range, which may be far below the scales of the map."""
    map, along = at.map, at.map.along(at.u)
    A = map.matrix(at.u, at.d, along)
    M = np.vstack([A, np.append(np.zeros(len(at.u) - 1), 1.0) if held else at.t])
    for _ in range(_CLOSINGS):
        misses = missed(at)
        if misses <= CLOSE:
            break
        u = map.shifted(
            at.u, -np.linalg.lstsq(M, np.append(map.residual(at.u, at.end, at.u, along), 0.0), rcond=FLAT)[0]
        )
        closer = replace(at, u=u, end=map.end(u))
        if closer.end.met != at.end.met or not missed(closer) < misses:
            break
        at = closer
    return at


def missed(at: Place) -> float:
    """By how much the motion misses its start, beyond the rounding of its states, over the range of each state."""
    moving, states, parts = at.rig.moving, at.run.states, at.run.parts or (at.run,)
    rounding = _ULPS * np.finfo(float).eps * np.abs(states).max(axis=0)
    far = np.max([np.abs(a.x - b.states[0]) for a, b in zip(parts, (*parts[1:], parts[0]))], axis=0)
    far = np.maximum(far - rounding, 0.0)
    return float((far[moving] / sizes(np.ptp(states, axis=0), at.rig)).max())


def stepped(at: Place, ds: float) -> Place:
    """Return the place at the distance ds from another one, with the same events. Raises NoCycle, NotSmooth."""
    return place(at.map, *_moved(at, ds), at.t)


def _moved(at: Place, ds: float) -> tuple[Array, Carried]:
    return solved(at, at.map.shifted(at.u, ds * at.t), at.map, at.u)


def solved(at: Place, guess: Array, map: ReturnMap, reference: Array) -> tuple[Array, Carried]:
    """Solve for the cycle of a map near a guess, on the plane across the tangent of a place, with the same events.

    `reference`: of the phase. Raises NoCycle, NotSmooth.
    """

    def plane(v: Array, _: Carried) -> tuple[float, Array]:
        return float(at.t @ (v - guess)), at.t

    first = np.vstack([at.map.matrix(at.u, at.d, at.map.along(at.u)), at.t])
    return map.newton(guess, plane, reference, at.end.met, first=first)


def _at_value(at: Place, p: float) -> Place:
    """The place at the parameter p, near another one, with the same events."""
    target = p / at.map.P0
    closing = parameter(target, len(at.u))
    share = (target - at.u[-1]) / at.t[-1] if at.t[-1] else 0.0
    guess = at.u + share * at.t
    guess[-1] = target
    M = np.vstack([at.map.matrix(at.u, at.d, at.map.along(at.u)), closing(guess, at.end)[1]])
    u, end = at.map.newton(at.map.shifted(guess, 0.0 * guess), closing, at.u, at.end.met, first=M)
    return place(at.map, u, end, at.t, held=True)


def follow(
    start: Place,
    low: float,
    high: float,
    most: int,
    watch: Callable[[Place], object] = lambda at: None,
    longest: float = LONGEST,
    sought: Collection[str] = SPECIAL,
) -> Iterator[Segment]:
    """Yield the segments of a branch from a place on, each as soon as it is complete, up to its end.

    The last one has an `end`. `most`: places in all. `sought`: the special points that are located.
    """
    at: Place | None = start
    while at is not None:
        if _linear(at):
            if float(at.t[:-2] @ (at.u - _equilibrium(at))[:-2]) < 0.0:  # it shrinks
                watch(at)
                yield Segment([at], end=Special("hopf", at, at.p, CLOSED_TO * abs(at.p)))
                return
            if (grown := _grown(at)) is not at:  # the upright line from the equilibrium
                watch(at)
                at = grown
        segment = Segment([at])
        watch(at)
        at = _along(segment, low, high, most, watch, longest, sought)
        most -= len(segment.places)
        yield segment


def _along(
    segment: Segment,
    low: float,
    high: float,
    most: int,
    watch: Callable[[Place], object],
    longest: float,
    sought: Collection[str],
) -> Place | None:
    """Follow a segment to its end; return the first place of the next one."""
    ds, other = segment.places[-1].step, None
    while len(segment.places) < most:
        at = segment.places[-1]
        try:
            runs = at.map.runs
            u, end = _moved(at, ds)
            runs = at.map.runs - runs
            new = place(at.map, u, end, at.t)
            if float(new.t @ at.t) < _BENDS and ds > 4.0 * SHORTEST:
                raise NoCycle("the branch bends")
            if missed(new) > CLOSED_TO:  # motions beside it have departed and come back within the period
                segment.places[-1] = _Parts(at).first()
                continue
            centred = _rescaled(_Parts(new).renewed())
            if missed(centred) > CLOSED_TO:
                raise NoCycle("the motion does not close from another base")
        except FAILURES as error:
            if isinstance(error, NotSmooth) and error.other is not None:
                other = error.other
            ds *= 0.5
            if ds >= SHORTEST:
                continue
            return _boundary(segment, other, error)
        if not low <= new.p <= high:
            limit = low if new.p < low else high
            try:
                last = _at_value(at, limit)
                segment.places.append(last)
                watch(last)
                segment.end = Special("range", last, limit, 0.0)
            except FAILURES:
                segment.end = Special("range", at, at.p, abs(new.p - at.p))
            return None
        segment.specials += _between(at, new, ds, sought)
        if (end_of_family := _shrinks(at, new)) is not None:
            segment.end = end_of_family
            return None
        if runs <= (2 * _EASY if at.map.cut else _EASY):
            ds = min(ds * _GROWTH, longest * math.sqrt(len(at.map.ticks)))
        segment.places.append(replace(centred, step=ds))
        watch(segment.places[-1])
        upright = [place.p for place in segment.places[-_UPRIGHT:] if place.map.cut]
        if len(upright) == _UPRIGHT and float(np.ptp(upright)) < CLOSE * abs(new.p):
            segment.end = Special("canard", segment.places[-1], new.p, CLOSED_TO * abs(new.p), turns=True, why=_DIGITS)
            return None
    segment.end = Special("most", segment.places[-1], segment.places[-1].p, 0.0, why=f"{most} points")
    return None


def _linear(at: Place) -> bool:
    """Whether the rig is linear on this cycle: then cycles of any size up to the next event have the same parameter."""
    rig = at.rig
    modes = rig.modes(at.end.first)
    nonlinear = modes.nonlinear.any() or rig.system.products or rig.system.remembers
    return at.map.period is None and not at.end.events and not nonlinear


def _equilibrium(at: Place) -> Array:
    """The unknowns at the equilibrium beside a cycle."""
    rig = at.rig
    return at.map.unknowns(steady(rig.system, rig.key).x, at.period, at.p)


def _grown(at: Place) -> Place:
    """The largest of the cycles of a linear rig without an event, less a little."""
    rig, middle, smallest = at.rig, _equilibrium(at), math.inf
    rest = steady(rig.system, rig.key).x
    states = at.run.states
    modes = rig.modes(at.end.first)
    rows = [s * row for s, row in zip(modes.sigma, rig.system.slip_rows)]
    rows += [row for row, normal in zip(modes.normal, rig.system.normals) if normal.opens]
    for row in rows:
        reach = -float(((states - rest) @ row).min())
        if reach > 0.0:
            smallest = min(smallest, float(row @ rest) / reach)
    if not 1.0 < smallest < math.inf:
        return at
    map = at.map.scaled(at.map.size * smallest, at.map.T0, at.map.P0)
    outwards = (at.u[:-2] - middle[:-2]) / smallest
    u = np.append(middle[:-2] / smallest + (1.0 - _SHORT_OF) * smallest * outwards, at.u[-2:])
    return place(map, u, map.end(u), np.append(outwards, [0.0, 0.0]))


def _shrinks(at: Place, new: Place) -> Special | None:
    """The Hopf point at which cycles shrink to an equilibrium; arclength would go on through it, half a period on."""
    if new.map.period is not None or new.end.events:
        return None
    sizes_of = [
        max(float(np.ptp(place.run.states @ row)) / max(abs(float(place.run.states[0] @ row)), 1e-300)
            for row in place.rig.system.slip_rows)
        for place in (at, new)
    ]  # fmt: skip
    if not sizes_of[1] < min(_SMALL, sizes_of[0]):
        return None
    p = _hopf(new)
    return Special("hopf", new, p, _EDGE * abs(new.map.P0)) if p is not None else None


def _hopf(at: Place) -> float | None:
    """The parameter at which the mode of the frequency of a small cycle is undamped, by the secant method."""

    def growth(p: float) -> float:
        rig = at.map.family.rig((p, *at.map.others))
        rates = steady(rig.system, rig.key).eigenvalues()
        return float(rates[np.abs(rates - 2j * math.pi / at.period).argmin()].real)

    from scipy.optimize import newton

    try:
        return float(newton(growth, at.p, x1=at.p * (1.0 + 1e-4) + 1e-12, tol=1e-15 * abs(at.p), maxiter=30))
    except (RuntimeError, *FAILURES):
        return None


# special points between two places with the same events


def _between(at: Place, new: Place, ds: float, sought: Collection[str]) -> list[Special]:
    """Folds, period doublings and torus points between two places, those that are `sought`."""
    kinds = ["fold"] if len(at.u) > 2 else []
    kinds += ["period doubling", "torus"] if at.unstable != new.unstable else []
    changes = [k for k in kinds if k in sought and SPECIAL[k].of(at) * SPECIAL[k].of(new) < 0.0]
    noise = CLOSED_TO * math.prod(float(np.linalg.norm(part, 2)) for part in at.d.parts) * abs(at.p)
    return [
        s
        for s in (_located(kind, at, new, ds) for kind in changes)
        if max(abs(s.p - at.p), abs(s.p - new.p)) > noise
        and (s.kind != "torus" or any(abs(abs(v) - 1.0) < _PAIR and v.imag for v in s.at.multipliers[0]))
    ]


def _located(kind: str, at: Place, new: Place, ds: float) -> Special:
    """The special point between two places."""
    measure = SPECIAL[kind]
    best, p, accuracy = zero(at, -ds, new, measure)
    if kind != "fold" and (steep := abs(measure.of(new) - measure.of(at)) / (abs(new.p - at.p) or math.inf)):
        accuracy = min(max(accuracy, _NOISE / steep), abs(new.p - at.p))
    return Special(kind, best, p, accuracy, turns=kind == "fold")


# boundaries between sequences of events


def _boundary(segment: Segment, other: Carried | None, error: Exception) -> Place | None:
    """Locate the boundary beyond the last place of a segment, and pass it."""
    if other is None:
        at = segment.places[-1]
        segment.end = Special("unresolved", at, at.p, math.nan, why=" ".join(str(error).split()))
        return None
    at, kind, name, p, accuracy = _nearest(segment)
    contact = name[1] if name else ""
    if at is not segment.places[-1]:
        segment.places.append(at)
    if kind == "jump" or at.map.cut:
        why = "" if kind == "jump" else _DIGITS
        segment.end = Special(kind or "unresolved", at, p, accuracy, contact, name=name, why=why)
        return None
    beyond = _switched(at, other)
    if beyond is None:
        segment.end = Special(kind or "unresolved", at, p, accuracy, contact, why=_change(at.end, other))
        return None
    turns = bool(beyond.t[-1] * at.t[-1] < 0.0 and min(abs(beyond.t[-1]), abs(at.t[-1])) > _LEVEL)
    kind = _named(at.rig, at.end, beyond.end, kind)
    segment.end = Special(kind, at, p, accuracy, contact or _contact(at.end, beyond.end), turns, name=name)
    return beyond


def _nearest(segment: Segment) -> tuple[Place, str, Name | None, float, float]:
    """The last place before the boundary, what vanishes there, contact, parameter and its accuracy."""
    at = segment.places[-1]
    ahead, width, back = at, 0.0, at
    ways_to_try = (0.25 * SHORTEST, -0.1 * FIRST) if len(segment.places) > 1 else (0.25 * SHORTEST,)
    for way in ways_to_try:
        try:
            beside = stepped(at, way)
        except FAILURES:
            continue
        ahead, width, back = (beside, way, at) if way > 0.0 else (at, -way, beside)
        break
    first, last = back.distances(), ahead.distances()
    ways: list[tuple[float, Name]] = []
    for name, value in last.items():
        slope = (value - first[name]) / width if name in first and width else 0.0
        if slope * value < 0.0:
            ways.append((-value / slope, name))
    ways.sort()
    if not ways or ways[0][0] > 0.05:
        best = _last(ahead)
        return best, "", None, best.p, 10.0 * CLOSED_TO * abs(best.p)
    near = [name for way, name in ways if way < _GRAZES * ways[0][0] + 10.0 * SHORTEST]
    name = next((n for n in near if n[0] in ("slip", "stick")), near[0])
    kind = {
        "slip": "grazing",
        "stick": "grazing",
        "closed": "lift-off",
        "open": "landing",
        "landing": "jump",
        "touch": "landing",
    }[name[0]]
    best, p, accuracy = zero(ahead, width, back, of_distance(name))
    if accuracy > _LOOSE * abs(at.map.P0):  # beside a steep friction law a distance is not linear: go as far as it goes
        best = ahead
        for _ in range(_PASSES):
            best = _last(best)
        p, accuracy = best.p, abs(best.p - segment.places[-3:][0].p)
    return best, kind, name, p, accuracy


def zero(at: Place, width: float, back: Place, measure: Measure) -> tuple[Place, float, float]:
    """Go from a place along its branch to the zero of a measure, by the secant method; `back` lies `width` behind it.

    A zero between both is enclosed. Steps that meet other events are shortened. Returns the last place, the parameter
    of the zero, and its accuracy.
    """
    known = [(-width, measure.of(back), back.p), (0.0, measure.of(at), at.p)]
    other = -width if known[0][1] * known[1][1] < 0.0 else None  # there the measure has the other sign
    for _ in range(_ROUNDS):
        (s0, g0, _), (s, g, _) = known[-2:]
        way = -g * (s - s0) / (g - g0) if g != g0 else 0.0
        if abs(way) < _EDGE or (measure.derived and abs(s - s0) <= abs(way) < _BESIDE):  # its digits are used up
            break
        if other is not None and not 0.0 < way / (other - s) < 1.0:
            way = 0.5 * (other - s)
        for share in _SHARES[1 - measure.derived :]:
            try:
                u, end = _moved(at, share * way)
                near = abs(way) <= _BESIDE and not measure.derived
                new = _closed(replace(at, u=u, end=end), False) if near else place(at.map, u, end, at.t)
                known.append((s + share * way, measure.of(new), new.p))
                at = new
                break
            except (*FAILURES, KeyError):
                continue
        else:
            break
        other = s if other is not None and g * known[-1][1] < 0.0 else other
    (_, g0, p0), (_, g, last) = known[-2:]
    p = last - g * (last - p0) / (g - g0) if g != g0 else last
    try:
        at = place(at.map, at.u, at.end, at.t)
    except FAILURES:  # the derivative is that of a place beside it
        pass
    return at, p, max(abs(p - last), CLOSED_TO * abs(p))


def of_distance(name: Name) -> Measure:
    """Return the measure of one distance."""
    what, _, number = name
    return Measure(lambda at: {d.name: d.value for d in distances(at.rig, at.run, at.period, what, number)}[name])


def _last(at: Place) -> Place:
    """The last place with the same events, by halving."""
    reached = {0.0: at}

    def holds(s: float) -> bool:
        try:
            reached[s] = stepped(at, s)
        except FAILURES:
            return False
        return True

    outside = SHORTEST
    while outside < LONGEST and holds(outside):
        outside = 2.0 * outside + SHORTEST
    return reached[edge(max(reached), outside, holds, _EDGE)[0]]


def _switched(at: Place, other: Carried) -> Place | None:
    """The first place beyond a boundary, found from states beside the last one before it that meet other events."""
    map, n = at.map, len(at.u) - 2
    f = map.along(at.u)
    directions = [at.t]
    for d in np.vstack([np.eye(n + 2)[:n], np.eye(n + 2)[-1:]]):
        across = d.copy()
        if map.period is None:
            across[-2 - len(f) : -2] -= f * (f @ d[-2 - len(f) : -2])
        if (size := float(np.linalg.norm(across))) > 0.1:
            directions += [across / size, -across / size]
    tried: set[Met] = {at.end.met}
    for wanted in (True, False):  # first what Newton's method has met
        for share in _TRIES:
            for direction in directions:
                beside = map.shifted(at.u, share * SHORTEST * direction)
                try:
                    end = map.end(beside)
                except FAILURES:
                    continue
                if end.met in tried or (wanted and end.met != other.met):
                    continue
                try:
                    d = map.derivative(beside, end, steps=[SHORTEST * k for k in (0.3, 3.0, 0.1, 0.03)])
                except FAILURES:
                    continue
                tried.add(end.met)
                if (beyond := _beyond(at, end, d, f)) is not None:
                    return beyond
    return None


def _beyond(at: Place, end: Carried, d: Derivative, f: Array) -> Place | None:
    """The first place with the events of `end`, whose derivative is d."""
    map = at.map
    A = map.matrix(at.u, d, f)
    t = np.asarray(np.linalg.svd(A)[2][-1])
    t = t if float(t @ at.t) >= 0.0 else -t
    for step in _BEYOND:
        for sign in (1.0, -1.0):
            guess, normal = map.shifted(at.u, sign * step * t), sign * t

            def plane(v: Array, _: Carried, normal: Array = normal, step: float = step) -> tuple[float, Array]:
                return float(normal @ (v - at.u)) - step, normal

            try:
                u, reached = map.newton(guess, plane, at.u, end.met, first=np.vstack([A, normal]))
                return _rescaled(_Parts(place(map, u, reached, normal)).renewed())
            except FAILURES:
                continue
    return None


def _named(rig: FreeRig, before: Carried, after: Carried, kind: str) -> str:
    """What happens at a boundary, from the events on both sides; `kind`: from the distance that vanishes."""

    def more(event: str) -> int:
        a, b = (sum(name.endswith(event) for name in run.met[1]) for run in (before, after))
        return b - a

    if kind == "grazing" and more(" slip ends"):
        return kind
    if opens := more(" opens"):
        return "lift-off" if opens > 0 else "end of lift-off"
    sticks = _sticks(rig, after) - _sticks(rig, before)
    for count, what in ((sticks, "stick"), (more(" slip ends"), "reversal")):
        if count:
            return f"{'begin' if count > 0 else 'end'} of {what}"
    return kind or "other order of events"


def _sticks(rig: FreeRig, run: Carried) -> int:
    """How often a contact begins to stick in a period."""
    keys = [*(event.before for _, event in run.events), run.key]
    return sum(len({*rig.stuck(b)} - {*rig.stuck(a)}) for a, b in pairwise(keys))


def _contact(before: Carried, after: Carried) -> str:
    """The contact whose events differ."""
    a, b = list(before.met[1]), list(after.met[1])
    for name in a:
        if name in b:
            b.remove(name)
    extra = b or [name for name in a if a.count(name) > after.met[1].count(name)]
    return extra[0].split(" ")[0] if extra else ""


def _change(before: Carried, after: Carried) -> str:
    was, new = (", ".join(run.met[1]) or "no event" for run in (before, after))
    return f"a motion beside it has other events in a period: {new}, and not {was}"


# the base point and the scales


class _Parts:
    """The period of the cycle of a place in parts, none of which magnifies a difference by much, from a base that no
    event is near to.
    """

    def __init__(self, at: Place) -> None:
        self.at, self.rig = at, at.rig
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
        at, map = self.at, self.at.map
        large = max(float(np.linalg.norm(part, 2)) for part in at.d.parts) > _SPLITS
        if large or map.cut:
            wanted = self._wanted()
            moved = len(map.ticks) > len(wanted) + 1 or any(self._beside(tick, 0.5) for tick in map.ticks[1:])
            if (large or moved) and (wanted or map.cut):
                return self._from(wanted or [0])
            if map.cut:
                return at
        later = map.better_base(at.u, at.run) if map.period is None else None
        return at if later is None else self._from([round(later / self.rig.step)])

    def _beside(self, tick: float, share: float = 1.0) -> bool:
        """Whether a tick lies beside an event."""
        return any(abs(tick - event) < share * _AWAY for event in self.events)

    def _grown(self) -> list[int]:
        """The ticks at which small differences have grown by a further factor `_PART`, by the rates of growth of
        sliding at the states of the run.
        """
        rig, run, growth, out = self.rig, self.at.run, 0.0, list[int]()
        level, stride = math.log(_PART), max(len(run.states) // _SAMPLES, 1)
        for part in run.intervals(rig.step, self.at.period):
            modes = rig.modes(part.key)
            law = own_law(rig.system, modes)
            for i in range(0, len(part.states), stride):
                A = linearised(rig.system, modes, part.states[i], law)[0][np.ix_(rig.moving, rig.moving)]
                growth += max(float(np.linalg.eigvals(A).real.max()), 0.0) * rig.step * stride
                tick = part.first + i
                if growth > level and 1 < tick < len(run.states) - 2 and not self._beside(tick):
                    out.append(tick)
                    level = growth + math.log(_PART)
        return out

    def _wanted(self) -> list[int]:
        """The ticks at which the parts should begin, in their order from the longest gap on."""
        grown = self._grown()
        if not grown or self.at.map.period is not None:
            return [0, *grown] if grown else []
        round_s = round(self.at.period / self.rig.step)
        gap, last = max((b - a, i) for i, (a, b) in enumerate(pairwise([*grown, grown[0] + round_s])))
        middle = grown[last] + gap // 2
        away = [t % round_s for k in range(gap // 3) for t in (middle + k, middle - k)]
        free = next((t for t in away if not self._beside(t)), 0)
        return [*grown[last + 1 :], *grown[: last + 1], *([free] if free else [])]

    def _from(self, ticks: Sequence[int]) -> Place:
        """The place with parts that begin at these ticks (of the old base), the first of them at the new base."""
        at, step = self.at, self.rig.step
        after = [round((tick - ticks[0]) * step % at.period / step) for tick in ticks]  # the new base
        new, size, moving = self._starts(at.u, ticks[0], after), at.map.size, self.rig.moving
        map = at.map.scaled(size, at.map.T0, at.map.P0)
        map.begins = tuple((tick, run.key) for tick, run in zip(after, new))
        if not ticks[0]:
            map.begins = (at.map.begins[0], *map.begins[1:])
        x = np.concatenate([run.x[moving] / size for run in new])
        forward = np.zeros(len(x))
        if len(at.map.begins) == len(ticks) == 1:  # in parts differences grow too much to tell the direction
            beside = self._starts(at.map.shifted(at.u, 1e-5 * at.t), ticks[0], after)[0]
            forward = ((beside.x - new[0].x)[moving] / size) / 1e-5
        u = np.append(x, at.u[-2:])
        made = place(map, u, map.end(u), np.append(forward, at.t[-2:]))
        if missed(made) > CLOSE:  # the parts of a motion that has departed on its way
            made = stepped(made, 0.0)
        return replace(made, step=at.step)

    def _starts(self, u: Array, base: int, ticks: Sequence[int]) -> list[Carried]:
        """The runs of the motion at u to where parts begin, at ticks after a new base."""
        map, step, out = self.at.map, self.rig.step, []
        for time in ((base + tick) * step for tick in ticks):
            time -= float(u[-2] * map.T0) if time > self.at.period else 0.0
            number = max(i for i, tick in enumerate(map.ticks) if tick * step <= time + _SOON)
            out.append(map.rig(u).carried(map.state(u, number), time - map.ticks[number] * step))
        return out


def _rescaled(at: Place) -> Place:
    """The place in scales of its own size, if it has grown or shrunk."""
    if at.map.period is not None:
        return at
    rig, run, map = at.rig, at.run, at.map
    size = sizes(np.ptp(run.states, axis=0), rig)
    T0, P0 = at.period, abs(at.p) or map.P0
    ratio = np.concatenate([map.size / size, [map.T0 / T0, map.P0 / P0]])
    if np.all((ratio < _RESCALE) & (ratio > 1.0 / _RESCALE)):
        return at
    new, y = map.scaled(size, T0, P0), ratio[:-2]
    d = replace(
        at.d,
        parts=at.d.parts * y[:, None] / y[None, :],
        over_p=at.d.over_p * y / ratio[-1],
        end_rate=at.d.end_rate * y / ratio[-2],
    )
    ratio = np.append(np.tile(y, len(at.d.parts)), ratio[-2:])
    t = at.t * ratio
    return Place(new, at.u * ratio, at.end, d, t / np.linalg.norm(t))
