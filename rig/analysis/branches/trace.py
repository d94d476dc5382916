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
from itertools import combinations, pairwise
from typing import NamedTuple

import numpy as np

from rig.analysis.branches.distances import distances
from rig.analysis.branches.places import (
    FAILURES,
    FIRST,
    Name,
    Parts,
    Place,
    at_value,
    closed_to_itself,
    missed,
    moved,
    place,
    rescaled,
    stepped,
)
from rig.analysis.cycles.return_map import CLOSE, CLOSED_TO, FLAT, Array, Derivative, NoCycle, NotSmooth, word
from rig.analysis.linear.eigenvalue_curves import edge
from rig.bench.free_rig import Carried, FreeRig
from rig.stability.linearisation import steady

Met = tuple[int, tuple[str, ...]]
LONGEST = 0.12
"""Longest step along a branch, of the size of the motion, of its period and of the parameter."""
SHORTEST = 1e-5
"""The shortest one: beyond it lies a boundary."""
VIRTUAL = 1e-3
"""Smallest amplitude of a cycle that is followed, over the surface speed."""
_BENDS = 0.9  # cosine of two tangents: below it a step is too long
_GROWTH = 1.5  # of the step,
_EASY = 6  # after a Newton iteration of at most so many runs
_EDGE = 1e-11  # of the same size as steps: how closely a boundary is located
_SHARES = (1.0, 0.95, 0.5, 0.1, 0.01)  # of the way to a zero; the first leads beyond it
_ROUNDS = 40  # most steps of the secant method: many are shortened because they meet other events
_BESIDE = 1e-6  # along the branch: the derivative of the return map is still the same
_LEVEL = 1e-6  # slope of a branch in the parameter: below it the branch is upright
_UPRIGHT = 12  # places in parts whose parameters are the same to the digits of their motions: a canard
_LOOSE = 1e-7  # of the parameter: a zero that is not reached,
_PASSES = 4  # and how often the way to it is halved then
_ASIDE = 1e-4  # of the parameter: the first step of the secant method to a Hopf point
_UNDAMPED = 1e-9  # growth in a period at a Hopf point
_SMALL = 0.02  # range of the slip speed over its mean: smaller cycles are those of the Hopf point
_BESIDE_ZERO = 1e-7  # of the size of each state: the differences of a distance
_OF_MOTION = 10.0  # error of a motion over a period, over the tolerance of its steps. measured on 18 rigs: 0.1 to 15
_NOISE = 1e-8  # of a multiplier
_TOUCHES = 1e-7  # of a multiplier from 1: below it the side is not known
_PAIR = 1e-3  # how near to the unit circle the multipliers of a torus point lie
_TRIES = (1.0, 3.0, 10.0, 30.0, 100.0)  # shortest steps from a boundary to states that meet other events
_BEYOND = (1e-3, 1e-2, 3e-4, 0.03)  # first steps beyond a boundary
_SHORT_OF = 1e-3  # of the largest cycle of a linear rig: where the branch is followed from
_GRAZES = 1.5  # times the way to the nearest zero of a distance: others so near vanish with it
_NEAREST = 0.05  # along the branch: a distance that vanishes further away is not the cause of a boundary
_DIGITS = "cycles beyond it change within less than the digits of the parameter"
_BOUNDARIES = {  # by the distance that is zero there
    "slip": "grazing",
    "stick": "grazing",
    "closed": "lift-off",
    "open": "landing",
    "landing": "jump",
    "touch": "landing",
}


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
            grown = _grown(at)
            if grown is not at:  # the upright line from the equilibrium
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
    ds = segment.places[-1].step
    other = None
    while len(segment.places) < most:
        at = segment.places[-1]
        try:
            runs = at.map.runs
            u, end = moved(at, ds)
            runs = at.map.runs - runs
            new = place(at.map, u, end, at.t)
            if float(new.t @ at.t) < _BENDS and ds > 4.0 * SHORTEST:
                raise NoCycle("the branch bends")
            if missed(new) > CLOSED_TO:  # motions beside it have departed and come back within the period
                segment.places[-1] = Parts(at).first()
                continue
            centred = rescaled(Parts(new).renewed())
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
                last = at_value(at, limit)
                segment.places.append(last)
                watch(last)
                segment.end = Special("range", last, limit, 0.0)
            except FAILURES:
                segment.end = Special("range", at, at.p, abs(new.p - at.p))
            return None
        segment.end = _shrinks(at, new)
        if segment.end is not None:
            return None
        segment.specials += _between(segment.places, new, ds, sought)
        if runs <= (2 * _EASY if at.map.cut else _EASY):
            ds = min(ds * _GROWTH, longest * math.sqrt(len(at.map.ticks)))
        last = replace(centred, step=ds)
        segment.places.append(last)
        watch(last)
        upright = [place.p for place in segment.places[-_UPRIGHT:] if place.map.cut]
        if len(upright) == _UPRIGHT and float(np.ptp(upright)) < CLOSE * abs(new.p):
            segment.end = Special("canard", last, new.p, CLOSED_TO * abs(new.p), turns=True, why=_DIGITS)
            return None
    last = segment.places[-1]
    segment.end = Special("most", last, last.p, 0.0, why=f"{most} points")
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
    rig = at.rig
    middle = _equilibrium(at)
    rest = steady(rig.system, rig.key).x
    states = at.run.states
    modes = rig.modes(at.end.first)
    rows = [s * row for s, row in zip(modes.sigma, rig.system.slip_rows)]
    rows += [row for row, normal in zip(modes.normal, rig.system.normals) if normal.opens]
    smallest = math.inf
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
    before = _swing(at)
    passed = not new.map.cut and float((at.u - _equilibrium(at))[:-2] @ (new.u - _equilibrium(new))[:-2]) < 0.0
    if not (passed or _swing(new) < min(_SMALL, before)):
        return None
    p = _hopf(new)
    if p is None:
        return None
    return Special("hopf", at if passed else new, p, _EDGE * abs(new.map.P0))


def _swing(at: Place) -> float:
    """The largest range of a slip speed in a period, over the slip speed at its begin."""
    states = at.run.states
    swings = []
    for row in at.rig.system.slip_rows:
        speed = abs(float(states[0] @ row))
        swings.append(float(np.ptp(states @ row)) / max(speed, 1e-300))
    return max(swings)


def _hopf(at: Place) -> float | None:
    """The parameter at which the mode of the frequency of a small cycle is undamped, by the secant method."""

    def growth(p: float) -> float:
        rig = at.map.family.rig((p, *at.map.others))
        rates = steady(rig.system, rig.key).eigenvalues()
        return float(rates[np.abs(rates - 2j * math.pi / at.period).argmin()].real)

    try:
        p, last = at.p, at.p * (1.0 + _ASIDE) + _ASIDE**3
        g, g_last = growth(p), growth(last)
        for _ in range(_ROUNDS):
            if g == g_last or abs(p - last) <= np.finfo(float).eps * abs(p):
                break
            p, last, g_last = p - g * (p - last) / (g - g_last), p, g
            g = growth(p)
    except FAILURES:
        return None
    return p if abs(g) * at.period < _UNDAMPED else None


# special points between two places with the same events


def _between(places: Sequence[Place], new: Place, ds: float, sought: Collection[str]) -> list[Special]:
    """Folds, period doublings and torus points between the last place and a new one, those that are `sought`."""
    at = places[-1]
    kinds = ["period doubling", "torus"] if at.unstable != new.unstable else []
    changes = [k for k in kinds if k in sought and SPECIAL[k].of(at) * SPECIAL[k].of(new) < 0.0]
    if "fold" in sought and len(at.u) > 2 and _folds(places, new):
        changes.insert(0, "fold")
    noise = CLOSED_TO * at.magnified * abs(at.p)
    specials = []
    for kind in changes:
        special = _located(kind, at, new, ds)
        clear = max(abs(special.p - at.p), abs(special.p - new.p)) > noise
        if clear and (kind != "torus" or _on_circle(special.at)):
            specials.append(special)
    return specials


def _folds(places: Sequence[Place], new: Place) -> bool:
    """Whether p turns where a multiplier crosses 1, between a new place and the last one at which its side is known.

    Beside a Hopf point it only touches 1, and of a rig that is nearly linear neither its side nor that of p is known.
    """
    side = _beyond_one(new)
    if not side:
        return False
    known = ((place, of_place) for place in reversed(places) if (of_place := _beyond_one(place)))
    before, side_before = next(known, (new, side))
    return side * side_before < 0 and _turn(before) * _turn(new) < 0.0


def _beyond_one(at: Place) -> int:
    """1 if an even number of the real multipliers of a place is above 1, else -1; 0 where that is not known."""
    from_one = sorted((1.0 - m for m in at.multipliers[0]), key=abs)
    kept = len(at.map.conserved(at.u, at.end))  # these are 1 everywhere
    product = float(np.prod(from_one[kept:]).real)
    return int(np.sign(product)) if abs(product) > _TOUCHES else 0


def _on_circle(at: Place) -> bool:
    """Whether a pair of complex multipliers lies on the unit circle."""
    values, _ = at.multipliers
    return any(abs(abs(v) - 1.0) < _PAIR and v.imag for v in values)


def _located(kind: str, at: Place, new: Place, ds: float) -> Special:
    """The special point between two places."""
    measure = SPECIAL[kind]
    best, p, accuracy = zero(at, -ds, new, measure)
    if kind == "fold":
        return Special(kind, best, p, accuracy, turns=True)
    way = abs(new.p - at.p)
    steepness = abs(measure.of(new) - measure.of(at)) / (way or math.inf)
    if steepness:
        accuracy = min(max(accuracy, _NOISE / steepness), way)
    return Special(kind, best, p, accuracy)


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
    if kind == "jump":
        segment.end = Special(kind, at, p, accuracy, contact, name=name)
        return None
    beyond = _switched(at, other)
    if beyond is None:
        why = _DIGITS if CLOSED_TO * at.magnified > 1.0 else _change(at.end, other)
        segment.end = Special(kind or "unresolved", at, p, accuracy, contact, why=why, name=name)
        return None
    turns = _turns(at, beyond)
    sides = [at.end, beyond.end]
    if turns:  # both lie on one side of the parameter
        sides.sort(key=lambda run: len(run.events))
    elif at.t[-1] < 0.0:
        sides.reverse()
    before, after = sides
    kind = _named(at.rig, before, after, kind)
    segment.end = Special(kind, at, p, accuracy, contact or _contact(at.end, beyond.end), turns, name=name)
    return beyond


def _turns(at: Place, beyond: Place) -> bool:
    """Whether the parameter turns at a boundary between two places: by the tangents, or where a branch is upright to
    the digits by Feigin's count, the parity of the real multipliers above 1 on both sides.
    """
    if min(abs(beyond.t[-1]), abs(at.t[-1])) > _LEVEL:
        return bool(beyond.t[-1] * at.t[-1] < 0.0)
    growing = 0
    for side in (at, beyond):
        growing += sum(m.real > 1.0 and not m.imag for m in side.multipliers[0])
    return growing % 2 == 1


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
    behind = back.distances()
    ways: list[tuple[float, Name]] = []
    for name, value in ahead.distances().items():
        slope = (value - behind[name]) / width if name in behind and width else 0.0
        if slope * value < 0.0:
            ways.append((-value / slope, name))
    nearest, _ = min(ways, default=(math.inf, None))
    if nearest > _NEAREST:
        best = _last(ahead)
        return best, "", None, best.p, 10.0 * CLOSED_TO * abs(best.p)
    near = [name for way, name in sorted(ways) if way < _GRAZES * nearest + 10.0 * SHORTEST]
    name = next((n for n in near if n[0] in ("slip", "stick")), near[0])
    measure = of_distance(name)
    best, p, accuracy = zero(ahead, width, back, measure)
    if accuracy > _LOOSE * abs(at.map.P0):  # beside a steep friction law a distance is not linear: go as far as it goes
        best = ahead
        for _ in range(_PASSES):
            best = _last(best)
        p = best.p
        accuracy = abs(best.p - segment.places[-3:][0].p)
    else:
        accuracy = max(accuracy, _uncertain(best, measure, abs(ahead.p - best.p)))
    return best, _BOUNDARIES[name[0]], name, p, accuracy


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
                u, end = moved(at, share * way)
                near = abs(way) <= _BESIDE and not measure.derived
                new = closed_to_itself(replace(at, u=u, end=end), False) if near else place(at.map, u, end, at.t)
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


def _uncertain(at: Place, measure: Measure, unknown: float) -> float:
    """How far the parameter of the zero of a distance may be off: by what the cycle leaves of its equations, and by the
    error of its motion, times the inverse of their derivative; `unknown` where motions beside it meet other events.
    """
    map = at.map
    along = map.along(at.u)
    value = measure.of(at)
    gradient = np.zeros(len(at.u))
    for i in range(len(at.u)):
        for by in (_BESIDE_ZERO, -_BESIDE_ZERO):
            u = at.u.copy()
            u[i] += by
            u = map.shifted(u, 0.0 * u)
            try:
                beside = replace(at, u=u, end=map.end(u))
                if beside.end.met == at.end.met:
                    gradient[i] = (measure.of(beside) - value) / by
                    break
            except (*FAILURES, KeyError):
                continue
        else:
            return unknown
    M = np.vstack([map.matrix(at.u, at.d, along), gradient])
    of_last = np.append(np.zeros(len(at.u) - 1), 1.0)
    shares, *_ = np.linalg.lstsq(M.T, of_last, rcond=FLAT)
    left = np.abs(map.residual(at.u, at.end, at.u, along))
    lengths = (
        np.diff([*map.ticks, at.period / at.rig.step]) * at.rig.step / at.period
    )  # of parts: their errors are less
    of_motion = _OF_MOTION * at.rig.tolerance * np.repeat(lengths, len(along))
    errors = np.append(left + np.append(of_motion, 0.0), of_motion.max())
    return abs(map.P0) * float(np.linalg.norm(shares * errors))


def of_distance(name: Name) -> Measure:
    """Return the measure of one distance."""
    what, _, number = name

    def of(at: Place) -> float:
        return {d.name: d.value for d in distances(at.rig, at.run, at.period, what, number)}[name]

    return Measure(of)


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
    last, _ = edge(max(reached), outside, holds, _EDGE)
    return reached[last]


def _switched(at: Place, other: Carried) -> Place | None:
    """The first place beyond a boundary, found from states beside the last one before it that meet other events."""
    map = at.map
    n = len(at.u) - 2
    f = map.along(at.u)
    directions = [at.t]
    for d in np.vstack([np.eye(n + 2)[:n], np.eye(n + 2)[-1:]]):
        across = d.copy()
        if map.period is None:
            across[-2 - len(f) : -2] -= f * (f @ d[-2 - len(f) : -2])
        size = float(np.linalg.norm(across))
        if size > 0.1:
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
                beyond = _beyond(at, end, d, f)
                if beyond is not None:
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
            guess = map.shifted(at.u, sign * step * t)
            normal = sign * t

            def plane(v: Array, _: Carried, normal: Array = normal, step: float = step) -> tuple[float, Array]:
                return float(normal @ (v - at.u)) - step, normal

            try:
                u, reached = map.newton(guess, plane, at.u, end.met, first=np.vstack([A, normal]))
                return rescaled(Parts(place(map, u, reached, normal)).renewed())
            except FAILURES:
                continue
    return None


def _named(rig: FreeRig, before: Carried, after: Carried, kind: str) -> str:
    """What happens at a boundary as the parameter rises, from the events before and after it; `kind`: from the distance
    that vanishes.
    """

    def count(run: Carried, event: str) -> int:
        return sum(name.endswith(event) for name in run.met[1])

    def increase(event: str) -> int:
        return count(after, event) - count(before, event)

    if kind == "grazing" and increase(" slip ends"):
        return kind
    if opens := increase(" opens"):
        return "lift-off" if opens > 0 else "end of lift-off"
    sticks = _sticks(rig, after) - _sticks(rig, before)
    for change, what in ((sticks, "stick"), (increase(" slip ends"), "reversal")):
        if change:
            return f"{'begin' if change > 0 else 'end'} of {what}"
    return kind or "other order of events"


def _sticks(rig: FreeRig, run: Carried) -> int:
    """How often a contact begins to stick in a period."""
    keys = [*(event.before for _, event in run.events), run.key]
    return sum(len({*rig.stuck(b)} - {*rig.stuck(a)}) for a, b in pairwise(keys))


def _contact(before: Carried, after: Carried) -> str:
    """The contact whose events differ."""
    _, events = before.met
    _, events_after = after.met
    more = list(events_after)
    for name in events:
        if name in more:
            more.remove(name)
    extra = more or [name for name in events if events.count(name) > events_after.count(name)]
    return extra[0].split(" ")[0] if extra else ""


def _change(before: Carried, after: Carried) -> str:
    was, new = (", ".join(run.met[1]) or "no event" for run in (before, after))
    return f"a motion beside it has other events in a period: {new}, and not {was}"
