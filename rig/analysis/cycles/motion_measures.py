"""Measures of a plant's motion from its start with actuators held, and the differences between two runs in them.

A setting is a method of integration with its step (rk4, kick) or its tolerance (dopri5, rosenbrock); the step of exact
is the sample step of the scene. A problem is a scene's plant with every actuator held, a start, and a duration.
Actuators have the values that the protocol of the scene holds for the longest. If these differ from the initial values,
the rig starts stuck to its surface, outside of a limit cycle; otherwise it starts as the scene states. The search for a
limit cycle (rig.analysis.cycles.cycle) decides the kind of motion and the duration:

    cycle       it settles in a cycle with mode set changes: until some rounds after the largest multiplier has made its
                distance from the cycle small
    vibration   mode set changes that do not repeat (yet)
    smooth      none in the last third: growth, decay, forced motion; and every film of points

A motion that leaves a limit of the scene is simulated until then. The evaluated window is a whole number of frames.
Measures of such a run:

    every kind   event times: of the first mode set changes, as a share of the mean time of a cycle (or between two)
    cycle        period, stick share, energy in a cycle; amplitude (half of peak to peak) of every quantity
    vibration    frequency, stick share, friction power; rms about the mean of every quantity
    smooth       frequency, growth rate; rms about the mean of every quantity

A cycle in which the motion settles has all of them over the one period that is recorded, for every output.

Quantities are the displacement, or the first output of the plant, and every output that a sensor of the scene reads.
Pointwise differences are not used: the phases of two stick-slip motions drift apart while all properties of interest
agree.
"""

from __future__ import annotations

import hashlib
import itertools
import json
import math
from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import asdict, dataclass, fields, replace
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rig.analysis.cycles.cycle import Search, Settled, stuck
from rig.analysis.cycles.repetition import turn_of
from rig.bench.free_rig import TIGHT, Dense, FreeRig
from rig.bench.run.runner import PlantRunner
from rig.compiled import kernel
from rig.errors import NumericsError, UsageError
from rig.model.assembly import Assembly, portrait
from rig.model.method import ADAPTIVE, METHODS, as_integrated, chosen
from rig.model.system import System
from rig.motion.motion import SEGMENTS, Event
from rig.scenes.protocol import Hold, Load, Ramp, Set, flat
from rig.scenes.scene import Scene
from rig.scenes.sections import with_values
from rig.solve.film_steps import GROUP
from rig.stability.linearisation import Steady, sliding_key, steady
from rig.stability.report import RK4_LIMIT

Array = NDArray[np.float64]
TIGHTEST = 1e-12  # tolerance
THEORY = {"dopri5": 5, "rosenbrock": 5, "rk4": 4, "kick": 2}  # order of the error in the step
_MANY_TO_SOLVE = 64
"""Number of states beyond which rosenbrock is not measured: the time of a step grows as its third power."""
_FINE = 2e-3  # |lambda| h of the finest rk4 step of a series
_RUNG = 2.0  # smallest ratio of two steps of a series
ROUNDS = 4  # simulated cycles after repetition
_REPEATS = 1e-6  # of a period: the last difference of a cycle that is simulated until it repeats
_CERTAIN = 1e-9  # of a multiplier: its error
_LONGEST = 60.0  # s, simulated
_EVENTS = 4000  # most mode set changes in which the motion is to settle
_WORK = 1.2e10  # sample steps of a run times the square of its states
_TURNS = 3.1  # of an uneven surface: the last third of so many is a whole one
_TIMED = 2000  # fewest sample steps in one timed run
_FALL = 7.0  # natural logarithm of the decay over which a motion is simulated
FIRST = 12  # mode set changes whose times are compared, for a motion that does not repeat
_STILL = 1e-9  # of the size of a quantity: below this it does not move
_AT_ONCE = 1e-3  # of the mean time of a cycle, or between two events: the order of nearer ones is left to rounding
_OF_KIND = {
    "cycle": ("period", "stick share", "energy per cycle", "amplitude"),
    "vibration": ("frequency", "stick share", "friction power", "rms"),
    "smooth": ("frequency", "growth rate", "rms"),
}
SLOW = 1e-2  # of the angular frequency: smallest scale of an error of growth


@dataclass(frozen=True, order=True)
class Setting:
    """A method with its setting: `tolerance` (dopri5, rosenbrock), `step_ns` [ns] (rk4, kick); 0 if it has none."""

    method: str
    tolerance: float = 0.0
    step_ns: int = 0

    def applied(self, scene: Scene) -> Scene:
        """Return the scene with this setting."""
        changes: dict[str, Any] = {"method": self.method}
        changes |= {"tolerance": self.tolerance} if self.tolerance else {}
        changes |= {"rk4_step": self.step_ns} if self.step_ns else {}
        return replace(scene, clock=scene.clock.model_copy(update=changes))

    @property
    def adapts(self) -> bool:
        """Whether the error determines its steps, except for the last one of each frame, which is cut."""
        return self.method in ADAPTIVE

    def __str__(self) -> str:
        if self.tolerance:
            return f"{self.method} at {self.tolerance:.0e}"
        return f"{self.method} at {self.step_ns * 1e-3:.4g} us" if self.step_ns else self.method


def of(scene: Scene, system: System) -> Setting:
    """Return the setting of a scene."""
    method = chosen(scene.clock.method, system)
    if method in ADAPTIVE:
        return Setting(method, scene.clock.tolerance)
    return Setting(method, step_ns=int(scene.clock.rk4_step) if method in ("rk4", "kick") else 0)


def eligible(system: System) -> dict[str, str]:
    """Return for every method of the rig why it cannot be used for this system, "" if it can."""
    reasons = dict.fromkeys(METHODS, "")
    for method in ("exact", *ADAPTIVE, "rk4", "kick"):
        try:
            as_integrated(system, method, 0.0)
        except ValueError as error:
            reasons[method] = str(error)
    reasons["smooth"] = "never sticks: for comparison only, rig tool torture shows its errors"
    reasons["dop853"] = "for tolerances of 1e-9 and below: maps, branches and shooting take it there"
    if system.n > _MANY_TO_SOLVE:
        reasons["rosenbrock"] = f"each of its steps solves equations for {system.n} states"
    if system.linear and not reasons["exact"]:
        for method in ADAPTIVE:
            reasons[method] = f"every mode set is linear: {method} would use the exact propagator"
    return reasons


def ladder(method: str, scene: Scene, rate: float) -> list[Setting]:
    """Return the settings of a method to be measured, coarse to fine. `rate` [1/s]: of the fastest mode."""
    if method in ADAPTIVE:
        return [Setting(method, 10.0**-p) for p in range(2, 12)]
    if method in ("rk4", "kick"):
        together = GROUP if scene.assemble().film is not None else 1  # steps in a segment
        shortest = scene.frame_ns / (SEGMENTS // 2 * together)  # finer ones would exceed the room of a frame
        return [Setting(method, step_ns=h) for h in _steps(scene.step_ns, rate, _FINE) if h >= shortest]
    return [Setting(method)]


def _steps(step_ns: int, rate: float, finest: float) -> Iterator[int]:
    """Divisors of the sample step [ns], coarse to fine, each at most half of the one before, with which rk4 is
    stable.
    """
    last = math.inf
    for count in range(1, step_ns + 1):
        h, rest = divmod(step_ns, count)
        turn = rate * h * 1e-9
        if rest or turn > RK4_LIMIT or h * _RUNG > last:
            continue
        yield h
        if turn < finest or h == 1:
            return
        last = h


@dataclass(frozen=True)
class Problem:
    """A scene's plant over a range of time. `length` and `window` in ticks: the whole run, and its evaluated end.

    `count`: mode set changes in one cycle, 0 without a cycle. `values`: of the held actuators. `leaves`: the limit of
    the scene that the motion leaves, where it ends. `period` [s], `x`: of the cycle in which the motion settles, with
    mode set changes or without; 0 without one, and `why`.
    """

    scene: Scene
    assembly: Assembly
    system: System
    values: dict[str, float]
    kind: str
    length: int
    window: int
    count: int
    leaves: str = ""
    period: float = 0.0
    x: Array | None = None
    why: str = ""

    def __reduce__(self) -> tuple[Any, ...]:
        rest = {entry.name: getattr(self, entry.name) for entry in fields(self)[3:]}
        return _remade, (self.scene, self.system.start, rest)

    @property
    def step(self) -> float:
        """Sample step [s]."""
        return self.scene.step_ns * 1e-9

    @property
    def seconds(self) -> float:
        """Length of the run [s]."""
        return self.length * self.step

    @property
    def quantities(self) -> list[str]:
        """Names of the compared outputs."""
        outputs = self.assembly.outputs
        first, _ = portrait(outputs) or (next(iter(outputs)), "")
        read = [section.reads for section in self.scene.sensors.values() if section.reads in outputs]
        return list(dict.fromkeys([first, *read]))

    @property
    def digest(self) -> str:
        """Hash (16 hex digits) of scene, sources and problem, without the scene's own integrator setting."""
        return digest(self.scene)

    @property
    def timed(self) -> int:
        """Number of timed ticks: those of the window, and more if it is too short to time."""
        return self.window if self.leaves else max(self.window, _TIMED)

    def orbit(self, setting: Setting, framed: bool = True) -> FreeRig:
        """Return the plant at its start with `setting`; `framed`: step by step as in a run with this setting."""
        scene = setting.applied(self.scene)
        return FreeRig(
            scene,
            self.assembly,
            self.system.start,
            method=setting.method,
            tolerance=scene.clock.tolerance,
            read=self.quantities,
            dense=True,
            framed=framed,
        )

    def later(self, setting: Setting) -> Array:
        """Return the state where the window begins."""
        orbit = self.orbit(setting)
        begin = self.length - self.window
        while orbit.motion.tick < begin:
            orbit.block(begin - orbit.motion.tick)
        return orbit.motion.x.copy()

    def runner(self, setting: Setting) -> PlantRunner:
        """Return the plant runner with sensors, as in a run, with the actuator values set."""
        runner = PlantRunner(_tolerant(setting.applied(self.scene)))
        for name, value in self.values.items():
            runner.apply(name, value)
        return runner


def _remade(scene: Scene, start: Array, rest: dict[str, Any]) -> Problem:
    """A problem that another process has pickled, made from its scene and its start."""
    assembly = scene.assemble()
    return Problem(scene, assembly, replace(assembly.system(), start=start), **rest)


def _tolerant(scene: Scene) -> Scene:
    """The scene with the permission to run if it is unstable."""
    return replace(scene, clock=scene.clock.model_copy(update={"unstable": "run"}))


def digest(scene: Scene) -> str:
    """Return a hash (16 hex digits) of everything that a cost table depends on, except the machine."""
    raw = json.loads(Setting("exact", 1e-7, 100_000).applied(scene).to_json())
    kept = {key: raw[key] for key in raw.keys() - {"name", "title", "about", "origins"}}
    text = json.dumps(kept, sort_keys=True) + kernel.source_key() + _own_sources()
    return hashlib.sha256(text.encode()).hexdigest()[:16]


@cache
def _own_sources() -> str:
    """The sources that define the measurement."""
    rooms = Path(__file__).parents[2]
    names = (
        "qualify/cost/measuring",
        "qualify/cost/references",
        "analysis/cycles/motion_measures",
        "analysis/cycles/cycle",
        "analysis/cycles/return_map",
        "bench/free_rig",
    )
    return "".join((rooms / f"{name}.py").read_text() for name in names)


def problem(scene: Scene, values: Mapping[str, float] | None = None, work: float = _WORK) -> Problem:
    """Determine the problem to measure for `scene`. Raises rig.errors.NumericsError if the simulation has to stop.

    `values`: of actuators that the rig has; by default those that the protocol holds for the longest. `work`: the most
    sample steps of a run, times the square of its states.
    """
    assembly = scene.assemble()
    values = held(scene, assembly) if values is None else {k: v for k, v in values.items() if k in assembly.inputs}
    for name, value in values.items():
        actuator = assembly.inputs[name]
        if actuator.write is None and not actuator.state:  # no command reaches it: it is a parameter
            scene = replace(scene, parameters=with_values(scene.parameters, {name: value}))
    assembly = scene.assemble()
    values = {name: value for name, value in values.items() if value != assembly.inputs[name].value}
    runner = PlantRunner(_tolerant(scene))
    for name, value in values.items():
        runner.apply(name, value)
    system = replace(assembly.system(), start=runner.motion.x.copy())
    if values:
        sliding = steady(system, sliding_key(system))
        if sliding.exists:
            system = replace(system, start=stuck(system, sliding.x))
    return _planned(Problem(scene, assembly, system, values, "smooth", 0, 0, 0), work)


def held(scene: Scene, assembly: Assembly) -> dict[str, float]:
    """Return the actuator values that the protocol holds for the longest, those that differ from the start."""
    start = {name: actuator.value for name, actuator in assembly.inputs.items()}
    now = dict(start)
    times = {tuple(now.values()): 0}
    for step in flat(scene.protocol):
        if isinstance(step, Load):
            now[step.target] = step.force
        elif isinstance(step, Ramp | Set) and step.target in now:
            now[step.target] = step.to
        elif isinstance(step, Hold):
            key = tuple(now.values())
            times[key] = times.pop(key, 0) + int(step.time)
    longest = max(reversed(times), key=lambda key: times[key])
    return {name: value for name, value in zip(now, longest) if value != start[name]}


def _planned(first: Problem, work: float) -> Problem:
    """The problem with the kind of motion and the duration."""
    scene = first.scene
    step = first.step
    sliding = steady(first.system, sliding_key(first.system))
    turn = turn_of(sliding)
    turns = 0.0 if math.isinf(turn) else _TURNS * turn
    longest = min(max((scene.duration_ns or 10**10) * 1e-9, turns), _LONGEST, work * step / first.system.n**2)
    settled = _settled(first, sliding, longest)
    stops = settled.leaves or settled.changes >= _EVENTS
    time = min(settled.time, longest) if stops else longest
    whole = scene.frame_ns // scene.step_ns
    first = replace(first, leaves=settled.leaves, period=settled.period, x=settled.x, why=settled.why)

    def over(time: float, kind: str, window: float = 0.0, count: int = 0) -> Problem:
        """The problem over so much time [s]; `window` [s]: evaluated, by default a third."""
        frames = max(round(time / step) // whole, 3)
        part = math.ceil(window / (whole * step)) if window else frames // 3
        return replace(first, kind=kind, length=frames * whole, window=part * whole, count=count)

    if settled.count:
        largest = 0.0 if settled.cycle is None else settled.cycle.multiplier
        decay = -math.log(np.clip(largest, _CERTAIN, 1.0 - _CERTAIN))  # in a period
        rounds = math.log(max(settled.drift / _REPEATS, 1.0)) / decay + ROUNDS + 0.5
        until = min(settled.time + rounds * settled.period, longest)
        if settled.changes / settled.count + (until - settled.time) / settled.period > ROUNDS:
            return over(until, "cycle", settled.period, settled.count)
    if settled.last > 2.0 / 3.0 * time:
        return over(time, "vibration")
    decay = -float(sliding.eigenvalues()[0].real) if sliding.exists else 0.0
    dies = _FALL / decay if decay > _FALL / _LONGEST else _LONGEST  # s, of a small motion about steady sliding
    return over(min(time, max(settled.last + dies, turns)), "smooth")


def _settled(first: Problem, sliding: Steady, longest: float) -> Settled:
    """Where the motion settles; nowhere for a film of points, and without vibration and decay."""
    start = first.system.start
    if first.assembly.film is None:
        standing = stuck(first.system, sliding.x)
        limits = tuple(first.scene.limits)
        rig = FreeRig(first.scene, first.assembly, standing, tolerance=TIGHT, read=limits)
        rig.motion.restart(start)
        try:
            return Search(rig, sliding, begins="the start of the scene").run(longest, _EVENTS)
        except UsageError as error:
            why = str(error)
    else:
        why = "a film of points moves irregularly"
    return Settled(longest, 0, 0.0, math.inf, start, why=why)


@dataclass(frozen=True)
class Seen:
    """Measures of one run: name -> value; `events`: (time [s], what) of the first mode set changes, `count` of all.

    `mean`: time [s] of a cycle, or between two changes. `steps`: integration steps, 0 if a method does not report them.
    `fault`: why the run had to stop, "" if it did not.
    """

    values: dict[str, float]
    events: tuple[tuple[float, str], ...] = ()
    count: int = 0
    mean: float = 0.0
    steps: int = 0
    fault: str = ""

    def to_json(self) -> dict[str, Any]:
        """Return the fields as JSON values."""
        return asdict(self)

    @classmethod
    def from_json(cls, raw: dict[str, Any]) -> Seen:
        """Return the measures of `to_json`."""
        return cls(**{**raw, "events": tuple((float(t), str(what)) for t, what in raw["events"])})


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
    step = problem.step
    count = problem.count
    values: dict[str, float] = {}
    if problem.kind != "cycle":
        values, more = _over(orbit, problem.window * step, problem.quantities)
        events += more
    elif len(events) > ROUNDS * count:
        last = events[-ROUNDS * count - 1 :]
        times = [((e.tick - last[0].tick) + e.place) * step for e in last]
        period = (times[-1] - times[0]) / ROUNDS
        values = {"period": period} | _over(orbit, period, problem.quantities)[0]
        values |= _stick_shares(orbit, times, [e.before for e in last[1:]])
    values = {name: value for name, value in values.items() if name.startswith(_OF_KIND[problem.kind])}
    kept = (ROUNDS * count if count else FIRST) + _at_once(problem)  # the last may be simultaneous with its successors
    met = tuple(((e.tick + e.place) * step, e.what) for e in events[:kept])
    gaps = max(len(events) - 1, 1) / (count or 1)
    mean = (events[-1].tick - events[0].tick) * step / gaps if len(events) > 1 else problem.seconds
    return Seen(values, met, len(events), mean, orbit.motion.counts()["trial_steps"])


def _at_once(problem: Problem) -> int:
    """Number of events that may happen at one time: one of each contact and normal force."""
    return len(problem.system.patches) + len(problem.system.normals)


def of_cycle(problem: Problem) -> dict[str, float]:
    """Return the measures of the cycle in which the motion settles, over one period with the method of the scene."""
    method = of(problem.scene, problem.system).method
    rig = FreeRig(problem.scene, problem.assembly, problem.x, method=method, tolerance=TIGHT, dense=True)
    values, _ = _over(rig, problem.period, [*problem.assembly.outputs])
    return values | {"period": problem.period, "frequency": 1.0 / problem.period, "growth rate": 0.0}


def moves(low: float, high: float) -> bool:
    """Return whether a quantity with these extremes moves at all."""
    return high - low > _STILL * max(abs(low), abs(high))


def _over(rig: FreeRig, length: float, names: Sequence[str]) -> tuple[dict[str, float], list[Event]]:
    """The measures over the next `length` [s] of a motion, and the events in it. `names`: of quantities."""
    part = rig.recorded(length)
    events = [event for _, event in part.events]
    measures = {"energy per cycle": part.energy["friction"], "friction power": part.energy["friction"] / length}
    for name in names:
        output = rig.outputs.index(name)
        low, high = part.dense.extremes(output)
        if moves(low, high):
            measures[f"amplitude {name}"] = 0.5 * (high - low)
            measures[f"rms {name}"] = moments(part.dense, output, 0.0, length)[1]
    lead = rig.outputs.index(names[0])
    turns = crossings(part.dense, lead, moments(part.dense, lead, 0.0, length)[0])
    if len(turns) > 2:
        measures["frequency"] = (len(turns) - 1) / (turns[-1] - turns[0])
    early, late = (moments(part.dense, lead, a, a + 0.5 * length)[1] for a in (0.0, 0.5 * length))
    if min(early, late) > 0.0:
        measures["growth rate"] = math.log(late / early) / (0.5 * length)
    times = [0.0, *(t for t, _ in part.events), length]
    return measures | _stick_shares(rig, times, [*(e.before for e in events), rig.motion.key]), events


def _stick_shares(rig: FreeRig, times: Sequence[float], keys: Sequence[int]) -> dict[str, float]:
    """The share of each contact in stick, between times [s] of mode set changes, each with the mode set before it."""
    shares = {}
    for p, patch in enumerate(rig.system.patches):
        held = sum(b - a for a, b, key in zip(times, times[1:], keys) if p in rig.stuck(key))
        shares[f"stick share {patch.name}"] = held / (times[-1] - times[0])
    return shares


def errors(problem: Problem, seen: Seen, truth: Seen) -> dict[str, float]:
    """Return the difference of `seen` from `truth`, by measure: relative; shares absolute; times as shares of a cycle.

    Infinite for a missing measure: mode set changes were missed or invented, or the run stopped.
    """
    differences: dict[str, float] = {}
    for name, value in truth.values.items():
        largest = abs(value)
        if name.startswith("stick share"):
            largest = 1.0
        if name == "growth rate":
            largest = max(largest, SLOW * 2.0 * math.pi * truth.values.get("frequency", 0.0))
        away = abs(seen.values.get(name, math.inf) - value)
        if largest > 0.0:
            differences[name] = away / largest
        else:
            differences[name] = 0.0 if away == 0.0 else math.inf
    if truth.events:
        enough = abs(seen.count - truth.count) <= 1 + truth.count // 50
        differences["event times"] = _apart(seen, truth, _at_once(problem)) / truth.mean if enough else math.inf
    return differences


def numbered(events: Sequence[tuple[float, str]]) -> dict[tuple[str, int], float]:
    """Return the times [s] of events by what happens and how often it has happened before.

    Equal parts of a rig have simultaneous events, and rounding decides which of them is the first.
    """
    passed: Counter[str] = Counter()
    times = {}
    for at, what in events:
        times[what, passed[what]] = at
        passed[what] += 1
    return times


def _apart(seen: Seen, truth: Seen, at_once: int) -> float:
    """The largest difference [s] of the times of an event; infinite if one is missing in either run.

    Only simultaneous events may have another order. If there are more events than those kept, the last `at_once` may
    have their counterpart among the others.
    """
    ours = numbered(seen.events)
    theirs = numbered(truth.events)
    for run, events, others in ((seen, ours, theirs), (truth, theirs, ours)):
        certain = len(events) - (at_once if run.count > len(events) else 0)
        times = [others[key] for key in events if key in others]
        back = max((last - time for last, time in zip(itertools.accumulate(times, max), times)), default=0.0)
        if any(key not in others for key in [*events][:certain]) or back > _AT_ONCE * truth.mean:
            return math.inf
    return max((abs(ours[key] - theirs[key]) for key in ours.keys() & theirs.keys()), default=math.inf)


def moments(dense: Dense, output: int, begin: float, end: float) -> tuple[float, float]:
    """Return mean and root mean square about it of an output between two times [s]."""
    weights, values = _nodes(dense, output, begin, end)
    mean = float(weights @ values / weights.sum())
    return mean, math.sqrt(float(weights @ (values - mean) ** 2 / weights.sum()))


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
    begins = coef[:, 0] - level
    ends = coef.sum(axis=1) - level
    times = []
    for i in np.flatnonzero((begins < 0.0) & (ends >= 0.0)):
        polynomial = coef[i].copy()
        polynomial[0] -= level

        def value(u: float, c: Array = polynomial) -> float:
            return float(np.polynomial.polynomial.polyval(u, c))

        place = 1.0 if value(1.0) <= 0.0 else float(brentq(value, 0.0, 1.0, xtol=1e-15))
        times.append(float(start[i] + place * length[i]))
    return times
