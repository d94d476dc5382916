"""Physical measures of a run, and the differences between two runs in them.

    every kind   event times: of the first mode set changes, as a share of the mean time of a cycle (or between two)
    cycle        period, stick share, energy in a cycle; amplitude (half of peak to peak) of every quantity
    vibration    frequency, stick share, friction power; rms about the mean of every quantity
    smooth       frequency, growth rate; rms about the mean of every quantity

Quantities are the displacement, or the first output of the plant, and every output that a sensor of the scene reads.
Pointwise differences are not used: the phases of two stick-slip motions drift apart while all properties of interest
agree.
"""

from __future__ import annotations

import itertools
import math
from collections import Counter
from collections.abc import Sequence
from dataclasses import asdict, dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rig.analysis.motion_measures.problem import ROUNDS, Problem, lift
from rig.analysis.motion_measures.settings import Setting
from rig.analysis.orbit import Orbit
from rig.analysis.output_polynomials import Dense
from rig.errors import NumericsError
from rig.motion.memory import Event

Array = NDArray[np.float64]
FIRST = 12  # mode set changes whose times are compared, for a motion that does not repeat
_STILL = 1e-9  # of the size of a quantity: below this it does not move
_AT_ONCE = 1e-3  # of the mean time of a cycle, or between two events: the order of nearer ones is left to rounding
SLOW = 1e-2  # of the angular frequency: smallest scale of an error of growth


@dataclass(frozen=True)
class Seen:
    """Measures of one run: name -> value; `events`: (time [s], what) of the first mode set changes, `count` of all.

    `mean`: time [s] of a cycle, or between two changes. `lifts`: number of those that open or close a contact; None for
    a method that does not report them. `steps`: integration steps, 0 if a method does not report them. `fault`: why the
    run had to stop, "" if it did not.
    """

    values: dict[str, float]
    events: tuple[tuple[float, str], ...] = ()
    count: int = 0
    mean: float = 0.0
    lifts: int | None = 0
    steps: int = 0
    fault: str = ""

    def to_json(self) -> dict[str, Any]:
        """Return the fields as JSON values."""
        return asdict(self)

    @classmethod
    def from_json(cls, raw: dict[str, Any]) -> Seen:
        """Return the measures of `to_json`."""
        return cls(**{**raw, "events": tuple((float(t), str(what)) for t, what in raw["events"])})

    def slips(self, repeats: bool) -> Seen:
        """Return the measures without opening and closing contacts; `repeats`: `mean` is the time of a cycle, and
        stays.
        """
        kept = tuple(event for event in self.events if not lift(event[1]))
        count = self.count - (self.lifts or 0)
        mean = self.mean if repeats else self.mean * max(self.count - 1, 1) / max(count - 1, 1)
        return replace(self, events=kept, count=count, mean=mean, lifts=None)


def observe(problem: Problem, setting: Setting, framed: bool = True) -> Seen:
    """Run `problem` with `setting` and compute its measures; `framed`: step by step as in a run with this setting."""
    try:
        return _observed(problem, setting, framed)
    except NumericsError as error:
        return Seen({}, fault=error.what)


def _observed(problem: Problem, setting: Setting, framed: bool) -> Seen:
    orbit = problem.orbit(setting, framed)
    events: list[Event] = []
    until = problem.length - (0 if problem.kind == "cycle" else problem.window)
    while orbit.motion.tick < until:
        events += orbit.block(until - orbit.motion.tick)
    step, kicks = problem.step, setting.method == "kick"
    count = problem.slips if kicks else problem.count
    if problem.kind == "cycle":
        values = _cycle(problem, orbit, events, count)
    else:
        values, more = _stretch(problem, orbit)
        events += more
    times = tuple(((e.tick + e.place) * step, e.what) for e in _first(problem, events))
    gaps = max(len(events) - 1, 1) / (count or 1)
    mean = (events[-1].tick - events[0].tick) * step / gaps if len(events) > 1 else problem.seconds
    lifts = None if kicks else sum(lift(e.what) for e in events)
    return Seen(values, times, len(events), mean, lifts, orbit.motion.counts()["trial_steps"])


def _first(problem: Problem, events: list[Event]) -> list[Event]:
    """The events whose times are compared: the first of all, and the first of those without lift-offs.

    A few more are kept, because the last one may have happened at the same time as its successors.
    """
    all_of, slips_of = (ROUNDS * problem.count, ROUNDS * problem.slips) if problem.count else (FIRST, FIRST)
    all_of, slips_of = all_of + _at_once(problem), slips_of + _at_once(problem)
    slips = itertools.accumulate(not lift(e.what) for e in events)
    return [
        e for i, (e, slip) in enumerate(zip(events, slips)) if i < all_of or (not lift(e.what) and slip <= slips_of)
    ]


def _at_once(problem: Problem) -> int:
    """Number of events that may happen at one time: one of each contact and normal force."""
    return len(problem.system.patches) + len(problem.system.normals)


def _cycle(problem: Problem, orbit: Orbit, events: list[Event], count: int) -> dict[str, float]:
    """Measures of a limit cycle of `count` mode set changes, from its last rounds and one more recorded round."""
    step = problem.step
    if not count or len(events) <= ROUNDS * count:
        return {}
    last = events[-ROUNDS * count - 1 :]
    times = [((e.tick - last[0].tick) + e.place) * step for e in last]
    period = (times[-1] - times[0]) / ROUNDS
    found = {"period": period}
    for p, patch in enumerate(problem.system.patches):
        held = sum(b - a for a, b, e in zip(times, times[1:], last[1:]) if orbit.stuck(e.before, p))
        found[f"stick share {patch.name}"] = held / (times[-1] - times[0])
    one = orbit.round(period)
    found["energy per cycle"] = one.energy["friction"]
    for name in problem.quantities:
        low, high = one.dense.extremes(orbit.outputs.index(name))
        if moves(low, high):
            found[f"amplitude {name}"] = 0.5 * (high - low)
    return found


def moves(low: float, high: float) -> bool:
    """Return whether a quantity with these extremes moves at all."""
    return high - low > _STILL * max(abs(low), abs(high))


def _stretch(problem: Problem, orbit: Orbit) -> tuple[dict[str, float], list[Event]]:
    """Measures of the last part of a motion that does not repeat, and the events in it."""
    length = problem.window * problem.step
    one = orbit.round(length)
    events = [event for _, event in one.events]
    found: dict[str, float] = {}
    names = problem.quantities
    for name in names:
        output = orbit.outputs.index(name)
        if moves(*one.dense.extremes(output)):
            found[f"rms {name}"] = rms(one.dense, output, 0.0, length)
    lead = orbit.outputs.index(names[0])
    turns = crossings(one.dense, lead, mean(one.dense, lead, 0.0, length))
    if len(turns) > 2:
        found["frequency"] = (len(turns) - 1) / (turns[-1] - turns[0])
    if problem.kind == "smooth":
        early, late = (rms(one.dense, lead, a, a + 0.5 * length) for a in (0.0, 0.5 * length))
        if min(early, late) > 0.0:
            found["growth rate"] = math.log(late / early) / (0.5 * length)
    else:
        found["friction power"] = one.energy["friction"] / length
        ends = [0.0, *(t for t, _ in one.events), length]
        keys = [*(e.before for e in events), orbit.motion.key]
        for p, patch in enumerate(problem.system.patches):
            held = sum(b - a for a, b, key in zip(ends, ends[1:], keys) if orbit.stuck(key, p))
            found[f"stick share {patch.name}"] = held / length
    return found, events


def errors(problem: Problem, seen: Seen, truth: Seen) -> dict[str, float]:
    """Return the difference of `seen` from `truth`, by measure: relative; shares absolute; times as shares of a cycle.

    Infinite for a missing measure: mode set changes were missed or invented, or the run stopped.
    """
    found: dict[str, float] = {}
    if seen.lifts is None:
        truth = truth.slips(problem.count > 0)
    for name, value in truth.values.items():
        largest = abs(value)
        if name.startswith("stick share"):
            largest = 1.0
        if name == "growth rate":
            largest = max(largest, SLOW * 2.0 * math.pi * truth.values.get("frequency", 0.0))
        away = abs(seen.values.get(name, math.inf) - value)
        found[name] = away / largest if largest > 0.0 else (0.0 if away == 0.0 else math.inf)
    if truth.events:
        enough = abs(seen.count - truth.count) <= 1 + truth.count // 50
        found["event times"] = _apart(seen, truth, _at_once(problem)) / truth.mean if enough else math.inf
    return found


def numbered(events: Sequence[tuple[float, str]]) -> dict[tuple[str, int], float]:
    """Return the times [s] of events by what happens and how often it has happened before.

    Equal parts of a rig have simultaneous events, and rounding decides which of them is the first.
    """
    passed: Counter[str] = Counter()
    found = {}
    for time, what in events:
        found[what, passed[what]] = time
        passed[what] += 1
    return found


def _apart(seen: Seen, truth: Seen, at_once: int) -> float:
    """The largest difference [s] of the times of an event; infinite if one is missing in either run.

    Only simultaneous events may have another order. If there are more events than those kept, the last `at_once` may
    have their counterpart among the others.
    """
    ours, theirs = numbered(seen.events), numbered(truth.events)
    for run, events, others in ((seen, ours, theirs), (truth, theirs, ours)):
        certain = len(events) - (at_once if run.count > len(events) else 0)
        times = [others[key] for key in events if key in others]
        back = max((last - time for last, time in zip(itertools.accumulate(times, max), times)), default=0.0)
        if any(key not in others for key in [*events][:certain]) or back > _AT_ONCE * truth.mean:
            return math.inf
    return max((abs(ours[key] - theirs[key]) for key in ours.keys() & theirs.keys()), default=math.inf)


def rms(dense: Dense, output: int, begin: float, end: float) -> float:
    """Return the root mean square about the mean of an output between two times [s]."""
    weights, values = _nodes(dense, output, begin, end)
    middle = float(weights @ values / weights.sum())
    return math.sqrt(float(weights @ (values - middle) ** 2 / weights.sum()))


def mean(dense: Dense, output: int, begin: float, end: float) -> float:
    """Return the mean of an output between two times [s]."""
    weights, values = _nodes(dense, output, begin, end)
    return float(weights @ values / weights.sum())


def _nodes(dense: Dense, output: int, begin: float, end: float) -> tuple[NDArray[Any], NDArray[Any]]:
    """Weights [s] and values at Gauss nodes of the segments, as far as they lie between two times."""
    start, length, coef = dense.segments(output)
    low, high = (np.clip(edge, begin, end) for edge in (start, start + length))
    places, weights = np.polynomial.legendre.leggauss(8)
    at = (low - start + 0.5 * (places[:, None] + 1.0) * (high - low)) / length  # [node, segment]
    values = np.polynomial.polynomial.polyval(at, coef.T, tensor=False)
    return np.ravel(0.5 * weights[:, None] * (high - low)), np.ravel(values)


def crossings(dense: Dense, output: int, level: float) -> list[float]:
    """Return the times [s] at which an output rises through `level`."""
    from scipy.optimize import brentq

    start, length, coef = dense.segments(output)
    begins, ends = coef[:, 0] - level, coef.sum(axis=1) - level
    found = []
    for i in np.flatnonzero((begins < 0.0) & (ends >= 0.0)):
        polynomial = coef[i].copy()
        polynomial[0] -= level

        def value(u: float, c: Array = polynomial) -> float:
            return float(np.polynomial.polynomial.polyval(u, c))

        place = 1.0 if value(1.0) <= 0.0 else float(brentq(value, 0.0, 1.0, xtol=1e-15))
        found.append(float(start[i] + place * length[i]))
    return found
