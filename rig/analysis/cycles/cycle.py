"""The limit cycle of a rig at constant actuator values: simulated until the motion repeats roughly, then closed.

The run starts with every contact stuck to its surface and the structure unloaded. With one degree of freedom this is
outside of the cycle, so that a cycle is also found where stable sliding exists beside it; else it may be missed. It is
looked at after stretches of a length that doubles:

    a part of the last events repeats in time to `ROUGH`: Newton's method on the return map
    (rig.analysis.cycles.return_map) closes the cycle from there. It counts if its multipliers, from the derivative of
    the same map, do not exceed one
    no event: the motion repeats at its turning points, which is closed in the same way, or it decays as the least
    stable mode of sliding does, and the rig comes to rest in sliding
    simulation alone repeats the events to `REPEAT`: a cycle where the return map is not smooth

Then one period is recorded, with extremes inside steps and at events. A motion that is quasi-periodic or chaotic does
none of this, or leaves an unstable cycle: the search says so.

The distance from rest in sliding is an energy norm:

    |d|^2 = v^T M v + w^2 q^T M q      of the distance d = (q, v) from sliding, w = |lambda| of its least stable mode

The mass matrix makes metres and radians comparable. The scale is the standing start of a cycle: every contact moves
with its surface, the structure is unloaded. So the scale contains the static deflection and the speed of the drive.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, replace
from itertools import pairwise
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rig.analysis.cycles.cycle_report import Cycle, Floquet
from rig.analysis.cycles.repetition import MOST, REPEAT, all_round, refuse, repeating, time_of, turn_of
from rig.analysis.cycles.return_map import STEPS, Family, NoCycle, ReturnMap, closed, multipliers, sizes
from rig.bench.free_rig import TIGHT, Carried, FreeRig
from rig.errors import NumericsError
from rig.model.method import chosen
from rig.model.system import System
from rig.motion.motion import Event
from rig.scenes.left_out import left_out
from rig.scenes.scene import Scene
from rig.stability.linearisation import Steady, sliding_key, steady

Array = NDArray[np.float64]
NEAR = 1e-7
"""Share of the scale. This close to stable sliding the rig is linear: a disturbance of this size decays."""
ROUGH = 1e-2
"""Of a period, or of the range of a state: rounds that differ by less may lie near a cycle."""
LONGEST = 120.0  # s
CHANGES = 500_000  # mode set changes: over a minute of a squeal at 3.4 kHz
_FIRST = 7.9  # periods of the slowest mode before the first look at the events
_DECAY = 2.0  # periods of the slowest mode without events, in which a decay shows
_SHORT = 2.1  # periods of the slowest mode in the first stretch: a decay shows in it
_ONCE = 16384  # ticks in one call, and states without events that are looked at
_SEEN = 16  # of these in a period of the least stable mode or of the slowest one, at least
_TURNS = 4  # most turning points in one cycle
_CALM = 2  # turns of an uneven surface without a contact event, after which the rig slides
_ROUNDS = 5.0  # turns of it that the search waits for
_STILL = 1e-2  # of the size of each state: smallest motion in a period of a cycle; below it is a state of rest
_GROWS = 1e-5  # a multiplier larger than one by this belongs to an unstable cycle
_DECAYS = 1e-6  # one smaller than one by less than this: nothing damps the vibration
_LONG = (1e-4, 1e-5, 1e-6)  # steps of the differences where runs are noisy, longest first
_BESIDE = 1e-8  # of the size of a state: over so little, the return map is straight
_POINTS = 5  # of each step of the integrator, in the outputs over a period
_PERIODS = 4  # in one piece of the simulation of a start
_PIECES = 2000  # of such a simulation, at most
_REPEATS = 1e-7  # of a period: a vibration with stick repeats
_NOT_SMOOTH = "the return map is not smooth: displaced runs meet other events"


class Rest:
    """Steady sliding as the state in which a motion may end. `start`: the standing start [state]; `begins`: where the
    motion begins, in words.
    """

    def __init__(self, sliding: Steady, start: Array, begins: str = "a standing start") -> None:
        self._begins = begins
        self._sliding = sliding
        self._nq = len(sliding.system.coordinates)
        self._free = not sliding.load.any()
        """True if no contact is loaded: the structure vibrates freely and comes to rest where it would slide."""
        counts = sliding.exists or self._free
        rates = sliding.eigenvalues() if counts else np.zeros(0, dtype=np.complex128)
        self.least = complex(rates[0]) if len(rates) else complex(math.nan, math.nan)
        self._scale = float(self._distances(start[None])[0])
        self.stable = self.least.real < 0.0
        """Whether every mode of sliding decays."""

    def share(self, x: Array) -> float:
        """Return the distance of state `x` from sliding, over the scale."""
        return float(self._distances(x[None])[0]) / self._scale if self._scale > 0.0 else math.inf

    def reached(self, x: Array) -> bool:
        """Return whether a motion at `x` without stick can only decay."""
        return self.stable and self.share(x) <= NEAR

    def decays(self, states: Array, step: float) -> bool:
        """Return whether a motion without events, at times `step` [s] apart, decays at least half as fast as sliding
        does. It is some periods long.
        """
        return self.stable and self._changes(states, step) >= 0.5

    def grows(self, states: Array, step: float) -> bool:
        """Return whether such a motion grows at least half as fast as unstable sliding does."""
        return self.least.real > 0.0 and self._changes(states, step) >= 0.5

    def _changes(self, states: Array, step: float) -> float:
        """The growth or decay rate of a motion over that of the least stable mode."""
        half = len(states) // 2
        first, last = (float(self._distances(part).max()) for part in (states[:half], states[half:]))
        if not first > 0.0 < last:
            return 0.0
        return math.log(last / first) / (self.least.real * half * step)

    def text(self, more: str = "") -> str:
        """Return why there is no limit cycle, or none is found; `more`: a further observation."""
        hertz = abs(self.least.imag) / (2.0 * math.pi)
        at = f" at {hertz:.6g} Hz" if hertz else ""
        decays = f"least stable mode decays with {-self.least.real:.6g} 1/s{at}"
        if self._free:
            return f"no limit cycle: no contact is loaded, and the {decays}{more}"
        return (
            f"no limit cycle found from {self._begins}: sliding is stable, its {decays}{more}. Another start may "
            "reach one: rig map, over a range that begins or ends where the rig vibrates"
        )

    def _distances(self, states: Array) -> Array:
        d = states - self._sliding.x
        nq = self._nq
        mass = self._sliding.system.mass
        q = d[:, :nq]
        v = d[:, nq : 2 * nq]
        kinetic = np.sum(v @ mass * v, axis=1)
        potential = abs(self.least) ** 2 * np.sum(q @ mass * q, axis=1)
        squares = kinetic + potential
        return np.asarray(np.sqrt(np.maximum(squares, 0.0)))


@dataclass(frozen=True)
class ClosedCycle:
    """A cycle that closes: its return map, the unknowns, the run over a period, the derivative of the map [i, i] and
    the error of that.
    """

    map: ReturnMap
    u: Array
    end: Carried
    P: Array
    error: float

    @property
    def period(self) -> float:
        """The period [s]."""
        return float(self.u[-2] * self.map.T0)

    @property
    def floquet(self) -> Floquet:
        """The multipliers."""
        values, closes = multipliers(self.P, self.map.period is not None)
        return Floquet(values, float(np.maximum(closes, self.error)))

    @property
    def multiplier(self) -> float:
        """The size of the largest multiplier but for the ones of what the motion conserves; 0 without one."""
        by_distance = sorted(self.floquet.multipliers, key=lambda v: abs(v - 1.0))
        conserved = len(self.map.conserved(self.u, self.end))
        return max((abs(v) for v in by_distance[conserved:]), default=0.0)


@dataclass(frozen=True)
class Settled:
    """Where a motion has settled: in a cycle, at rest in sliding (`rests`), or nowhere; `why`: the reason for no cycle.

    `time` [s] and `changes` of the mode set: simulated; `last` [s]: the last of them, `drift` the last difference of
    the rounds. `period` [s], `count` of mode set changes, `x`: of the cycle, which is closed (`cycle`) or which
    simulation alone repeats; without one `x` is the last state. `leaves`: the limit of the scene that the motion
    leaves, in words. `unstable`: a cycle that the motion leaves.
    """

    time: float
    changes: int
    last: float
    drift: float
    x: Array
    period: float = 0.0
    count: int = 0
    cycle: ClosedCycle | None = None
    unstable: ClosedCycle | None = None
    why: str = ""
    leaves: str = ""
    rests: bool = False
    decided: bool = True


class Search:
    """The motion of a rig from its present state on, until it is known where it settles.

    The system of the rig begins at the standing start; `begins`: where the motion does, in words. `every` [s]: the time
    between looks, which otherwise doubles. `repeat`: the relative difference of the rounds of a cycle that simulation
    finds. `patience` [s]: as long a motion may approach its cycle by itself before Newton's method closes it. Raises
    UsageError for a rig that neither vibrates nor decays.
    """

    def __init__(
        self,
        rig: FreeRig,
        sliding: Steady,
        every: float = 0.0,
        repeat: float = 0.0,
        patience: float = 0.0,
        begins: str = "a standing start",
    ) -> None:
        self.rig = rig
        self.sliding = sliding
        self.every = every
        self.patience = patience
        self.rest = Rest(sliding, rig.system.start, begins)
        self.turn = turn_of(sliding)
        self.slowest = sliding.time_scales()[1]
        self.repeat = repeat or (1e-7 if rig.method == "rk4" else max(REPEAT, 10.0 * rig.tolerance))
        self.rough = ROUGH
        self.motion = rig.motion
        self._begun = rig.motion.tick
        self.events: list[Event] = []  # the last, as many as are compared
        self.changes = 0
        self.drift = math.inf
        self.quiet = 0.0  # on an uneven surface: time without a change of a contact and without stick [s]
        self.calm = self.motion.x[None].copy()  # the last states since the last event
        self.spacing = rig.step  # of these states [s]
        turns = max(abs(self.rest.least) / (2.0 * math.pi), 1.0 / self.slowest)  # in a second; nan without sliding
        self.coarsest = max(int(1.0 / (_SEEN * turns * rig.step)), 1) if turns > 0.0 else 1  # ticks between two of them
        self.unstable: ClosedCycle | None = None

    @property
    def now(self) -> float:
        """The simulated time [s]."""
        return (self.motion.tick - self._begun) * self.rig.step

    def run(
        self, longest: float, most: float, watch: Callable[[float, float], object] = lambda now, drift: None
    ) -> Settled:
        """Simulate for at most `longest` [s] and `most` mode set changes. Raises NumericsError."""
        uneven = math.isfinite(self.turn)
        stretch = self.turn if uneven else self.every or _SHORT * self.slowest
        while self.now < longest and self.changes < most:
            begun = self.now
            before = self.changes
            left = self._simulated(min(stretch, longest - self.now), most)
            if left is not None:
                return left
            if uneven:
                settled = self._over_a_turn(begun, self.changes - before)
            else:
                late = self.every > 0.0 or self.now > _FIRST * self.slowest or self.now >= longest
                settled = self._looked_at(late)
                stretch = self.every or self.now  # the next look is after as long again
            watch(self.now, self.drift)
            if settled is not None:
                return settled
        return self._undecided()

    def _simulated(self, time: float, most: float) -> Settled | None:
        """Simulate a stretch; return where the motion has left a limit of the scene."""
        rig = self.rig
        motion = self.motion
        ticks = max(round(time / rig.step), 1)
        apart = min(math.ceil(ticks / _ONCE), self.coarsest)
        origin = motion.tick + max(ticks - apart * _ONCE, 0)
        calm: list[Array] = []
        while ticks > 0 and self.changes < most:
            count = math.ceil(ticks / math.ceil(ticks / _ONCE))
            first = motion.tick
            motion.advance(count)
            ticks -= count
            events = motion.events()
            if events and events[-1].tick >= origin:
                origin = events[-1].tick + 1
                calm = []
            begin = max(origin - first, (origin - first) % apart)
            calm.append(motion.states[begin::apart].copy())
            self.events = [*self.events, *events][-4 * MOST :]
            self.changes += len(events)
            left = self._left_limit(first) if rig.scene.limits else None
            if left is not None:
                return left
            if rig.system.sectors:  # changes of contacts, not of their sectors
                keys = [*(event.before for event in events), motion.key]
                modes = [rig.system.modes(key)[:2] for key in keys]
                touched = rig.stuck(motion.key) or any(a != b for a, b in pairwise(modes))
                self.quiet = 0.0 if touched else self.quiet + count * rig.step
        self.calm = np.concatenate(calm)
        self.spacing = apart * rig.step
        return None

    def _left_limit(self, first: int) -> Settled | None:
        """Where the states from tick `first` on leave a limit of the scene; None if they stay within all."""
        rig = self.rig
        motion = self.motion
        limits = list(rig.scene.limits.items())
        values = np.abs(motion.outputs_at(motion.states, motion.mode_sets_of_states))
        beyond = np.argwhere(values > [limit for _, limit in limits])
        if not len(beyond):
            return None
        tick, which = beyond[0].tolist()
        name, limit = limits[which]
        self.events = [event for event in self.events if event.tick <= first + tick]
        at = (first + tick - self._begun) * rig.step
        leaves = f"{name} exceeds its limit of {limit:g} {rig.units[name]} at {at:.4g} s"
        return self._settled(why=f"no limit cycle: {leaves}", time=at, leaves=leaves)

    def _looked_at(self, late: bool) -> Settled | None:
        """Where the motion has settled; None if it is not known yet. Events may repeat when it is `late`."""
        if len(self.calm) * self.spacing >= _DECAY * self.slowest and not self.rig.stuck(self.motion.key):
            if self.rest.reached(self.motion.x) or self.rest.decays(self.calm, self.spacing):
                return self._settled(why=self.rest.text(), rests=True)
            period = 0.0 if self.rest.grows(self.calm, self.spacing) else self._between_turning_points()
            settled = self._closed(period) if period else None
            if settled is not None:
                return settled
        return self._repeated() if late and self.events else None

    def _repeated(self) -> Settled | None:
        """The cycle whose events repeat, if there is one."""
        roughly, _ = self._round(self.rough) if self.now > self.patience else (0.0, 0)
        settled = self._closed(roughly) if roughly else None
        if settled is not None:
            return settled
        period, count = self._round(self.repeat)
        return self._settled(period=period, count=count) if period else None

    def _round(self, repeat: float) -> tuple[float, int]:
        """The period [s] of a motion whose events repeat to `repeat`, and their number in it; else 0."""
        step = self.rig.step
        count, self.drift = repeating(self.events, step, repeat)
        last = self.events[-count - 1 :]
        origin = last[0].tick
        period = time_of(last[-1], origin, step) - time_of(last[0], origin, step)
        over = -time_of(last[-1], self.motion.tick, step) > 2.0 * period  # the events are those of an earlier motion
        repeats = count and self.drift <= repeat and not over and all_round(period, self.turn)
        return (period, count) if repeats else (0.0, 0)

    def _between_turning_points(self) -> float:
        """The period [s] of a motion without events, from the states at its last turning points; 0 if none repeats.

        Turning points are those of the coordinate with the largest motion in the least stable mode.
        """
        moving = self.rig.moving
        nq = len(self.rig.system.coordinates)
        states = self.calm[:, moving]
        span = np.ptp(states, axis=0)
        shape = self.sliding.eigenvectors()[1][nq : 2 * nq, 0]
        velocity = self.calm[:, nq + int(np.abs(shape).argmax())]
        before = np.flatnonzero((velocity[:-1] > 0.0) & (velocity[1:] <= 0.0))
        share = velocity[before] / (velocity[before] - velocity[before + 1])
        times = (before + share) * self.spacing
        turns = states[before] + share[:, None] * (states[before + 1] - states[before])
        for count in range(1, min(_TURNS, (len(turns) - 1) // 2) + 1):
            rounds = turns[-2 * count - 1 :]
            if np.all(np.abs(rounds[count:] - rounds[:-count]) <= ROUGH * span):
                return float(times[-1] - times[-1 - count])
        return 0.0

    def _closed(self, period: float) -> Settled | None:
        """Where the present motion, which returns after about `period` [s], settles: in the cycle near it; None: it is
        not known.
        """
        motion = self.motion
        saved = motion.save()
        tick = motion.tick
        driving = np.delete(np.arange(self.rig.system.n), self.rig.moving)
        driven = bool(np.ptp(motion.states[:, driving], axis=0).any())
        rates = [rate for *_, rate in self.rig.system.generators]
        if driven and rates:
            longest = 2.0 * math.pi / min(rates)
            period = max(round(period / longest), 1) * longest
        cycle = None
        try:
            cycle = closed_cycle(self.rig, motion.x.copy(), period, driven)
        except (NoCycle, NumericsError):
            pass
        finally:
            motion.go_back(saved)
            motion.tick = tick
        if cycle is None or self.rest.share(cycle.map.state(cycle.u)) <= NEAR:
            return None
        if cycle.multiplier > 1.0 + _GROWS:
            self.unstable = cycle
            self.rough = 0.1 * min(self.drift, self.rough)
            return None
        if cycle.multiplier >= 1.0 - _DECAYS:
            return self._settled(why="no limit cycle: nothing damps the vibration, which keeps any amplitude")
        count = len(cycle.end.events)
        x = cycle.map.state(cycle.u)
        return self._settled(period=cycle.period, count=count, x=x, cycle=cycle)

    def _over_a_turn(self, begun: float, changes: int) -> Settled | None:
        """The same on an uneven surface: each sector excites the rig, and sliding must persist through all of them."""
        if begun and changes > MOST:
            why = (
                f"no limit cycle: the surface is uneven, and one turn of {self.turn:.4g} s has {changes} mode set "
                "changes. The motion follows the turn and does not repeat within it. An even surface may have a cycle "
                "(-p inhomogeneity=none, -p sector=none). Analyse the modulated motion with rig simulate and "
                "rig analyse sound"
            )
            return self._settled(why=why)
        if self.rest.stable and self.quiet >= _CALM * self.turn:
            why = self.rest.text(f"; no contact changes in {_CALM} turns of the surface")
            return self._settled(why=why, rests=True)
        return self._repeated() if self.events else None

    def _undecided(self) -> Settled:
        """The result "undecided", and why."""
        held = bool(self.rig.stuck(self.motion.key)) and not self.changes
        what = "the start still sticks" if held else "the motion does not repeat"
        why = f"undecided: {what} within {self.now:.4g} s and {self.changes} mode set changes"
        if math.isfinite(self.drift):
            why += f"; its last periods differ by {self.drift:.1e} of a period"
        if self.unstable is not None:
            period = self.unstable.period
            rate = math.log(self.unstable.multiplier) / period
            why += f"; there is an unstable cycle of {period:.6g} s, which it leaves with {rate:.3g} 1/s"
        return self._settled(why=why, decided=False)

    def _settled(self, **how: Any) -> Settled:
        last = (self.events[-1].tick - self._begun) * self.rig.step if self.events else 0.0
        state = self.motion.x.copy()
        settled = Settled(self.now, self.changes, last, self.drift, state, unstable=self.unstable)
        return replace(settled, **how)


def closed_cycle(rig: FreeRig, x: Array, period: float, driven: bool) -> ClosedCycle:
    """Return the cycle that passes near state x of a rig and returns after about `period` [s].

    `driven`: its driving states have this period. Raises NoCycle, NotSmooth.
    """
    family = Family.of(rig.driven_by(x) if driven else rig)
    map, u, end = closed(family, (), x, period, (lambda _: period) if driven else None)
    if float(np.linalg.norm(map.rate(u, end.x, end.key))) <= _STILL:
        raise NoCycle("it is a state of rest")
    return ClosedCycle(map, u, end, *_derivative(map, u, end))


def _derivative(map: ReturnMap, u: Array, end: Carried) -> tuple[Array, float]:
    """The derivative of the map over a period [i, i], and its error because runs are noisy.

    The noise is the distance of the end of a run from the middle of the ends of two runs beside it. It is large where a
    law has kinks; the steps of the differences are long there.
    """
    by = np.append(_BESIDE, np.zeros(len(u) - 1))
    beside = [map.end(map.shifted(u, way)) for way in (by, -by)]
    noise = 0.0
    if all(run.met == end.met for run in beside):
        middle = 0.5 * sum(map.ends(u, run) for run in beside)
        noise = float(np.abs(middle - map.ends(u, end)).max())
    steps = _LONG if noise > TIGHT else STEPS
    return map.derivative(u, end, over_p=False, steps=steps).P, noise / steps[0]


def limit_cycle(
    scene: Scene,
    tolerance: float = TIGHT,
    longest: float | None = None,
    watch: Callable[[float, float], object] = lambda now, drift: None,
) -> Cycle:
    """Find the limit cycle of `scene` with every actuator held at its initial value, without controllers and sensors.

    `tolerance`: of dopri5 and rosenbrock in the period that is recorded. `longest`: simulated time [s] within which the
    motion must come near it. The default is `LONGEST`, more for an uneven surface that turns slowly, less if `CHANGES`
    mode set changes happen before. `watch` gets the simulated time [s] and the relative difference between the last
    rounds. Raises rig.errors.NumericsError where the simulation has to stop, UsageError for a film of points.
    """
    refuse(scene, "a limit cycle")
    assembly = scene.assemble()
    system = assembly.system()
    sliding = steady(system, sliding_key(system))
    surfaces = sliding.x.copy()
    surfaces[: 2 * len(system.coordinates)] = 0.0
    method = chosen(scene.clock.method, system)
    if not np.any(system.slip_rows @ surfaces):
        still = "nothing slides, because no surface moves"
        why = still if system.patches else "the rig has no contact that could slide"
        return Cycle(scene.name, method, False, f"no limit cycle: {why}", 0.0, left_out=left_out(scene))
    rig = FreeRig(scene, assembly, stuck(system, sliding.x), tolerance=TIGHT, read=tuple(scene.limits))
    search = Search(rig, sliding)
    most = CHANGES if longest is None else math.inf
    default = LONGEST if math.isinf(search.turn) else max(LONGEST, _ROUNDS * search.turn)
    settled = search.run(longest or default, most, watch)
    if settled.why:
        more = f"The motion is slow or irregular. Use --longest {4.0 * settled.time:.3g}, or rig map"
        why = settled.why if settled.decided else f"{settled.why}. {more}"
        cycle = Cycle(scene.name, method, False, why, settled.time, decided=settled.decided)
    else:
        cycle = _recorded(rig, settled, method, tolerance)
    return replace(cycle, left_out=left_out(scene))


def _recorded(rig: FreeRig, settled: Settled, method: str, tolerance: float) -> Cycle:
    """Record one period of the cycle in which a motion has settled, and return its properties."""
    cycle = settled.cycle
    period = settled.period
    x = settled.x
    floquet, newton = (Floquet(why=_NOT_SMOOTH), 0) if cycle is None else (cycle.floquet, cycle.map.steps)
    recorder = FreeRig(rig.scene, rig.assembly, x, method=method, tolerance=tolerance, dense=True)
    turn = recorder.recorded(period)
    outputs = recorder.outputs
    time, values = turn.dense.sampled(_POINTS, len(outputs))
    times = [0.0, *(t for t, _ in turn.events), period]
    keys = [*(event.before for _, event in turn.events), recorder.motion.key]
    held = [(a, b, rig.stuck(key)) for a, b, key in zip(times, times[1:], keys) if b > a]

    def at(sticks: bool) -> dict[str, float]:
        """The outputs where the first contact begins to stick, or just before it ends."""
        for (*_, before), (t, _, after) in pairwise(held):
            if (0 in before) != sticks and (0 in after) == sticks:
                return dict(zip(outputs, turn.dense.at(t, after=sticks).tolist()))
        return {}

    def stick_time(patch: int) -> float:
        """How long a contact sticks [s]."""
        return sum(b - a for a, b, stuck in held if patch in stuck)

    end = turn.dense.at(period, after=False)
    closes = np.abs(end[len(outputs) :] - x)[rig.moving]
    return Cycle(
        scene=rig.scene.name,
        rig=rig.scene,
        method=method,
        found=True,
        why="",
        after=settled.time,
        period=period,
        repeats=float((closes / sizes(np.ptp(turn.states, axis=0), rig)).max()),
        stick_time={patch.name: stick_time(p) for p, patch in enumerate(rig.system.patches)},
        extremes={name: turn.dense.extremes(i) for i, name in enumerate(outputs)},
        units=rig.units,
        stick_start=at(sticks=True),
        stick_end=at(sticks=False),
        energy=turn.energy,
        events=tuple((t, event.what) for t, event in turn.events),
        floquet=floquet,
        newton=newton,
        time=time,
        outputs=dict(zip(outputs, values)),
        sticking=tuple((a, b) for a, b, stuck in held if 0 in stuck),
        state=dict(zip(rig.system.names, x.tolist())),
    )


def slides(scene: Scene) -> tuple[bool | None, str]:
    """Return whether the plant comes to slide from the start of its scene, by simulation; None, and why: undecided."""
    rig = Family(scene).rig(())
    sliding = steady(rig.system, rig.key)
    rest = Rest(sliding, stuck(rig.system, sliding.x))
    if not rest.stable:
        return False, ""
    x = rig.settled.copy()
    x[rig.moving] = rig.system.start[rig.moving]
    period = 2.0 * math.pi / abs(rest.least)
    ends = comes_to_slide(rig, rest, x, period)
    longest = _PIECES * _PERIODS * period
    return ends, "" if ends is not None else f"neither sliding nor a vibration that repeats after {longest:.4g} s"


def comes_to_slide(
    rig: FreeRig, rest: Rest, x: Array, period: float, known: Callable[[Array], bool | None] = lambda x: None
) -> bool | None:
    """Return whether the motion from x comes to slide, by simulation; None: it neither slides nor repeats for long.

    `period` [s]: a typical one. `known`: what is known of a state after a few periods with events.
    """
    for _ in range(_PIECES):
        run = rig.carried(x, _PERIODS * period)
        if run.events:
            ends = known(run.x)
            if ends is not None:
                return ends
        elif rest.reached(run.x):
            return True
        count, drift = repeating([event for _, event in run.events], rig.step, _REPEATS)
        if count and drift <= _REPEATS:
            return False
        x = run.x
    return None


def stuck(system: System, x: Array) -> Array:
    """Return the state with the signals of `x`, the structure unloaded and every contact moving with its surface."""
    nq = len(system.coordinates)
    out = x.copy()
    out[: 2 * nq] = 0.0
    directions = np.array([p.direction for p in system.patches]).reshape(-1, nq)
    push = np.linalg.solve(system.mass, directions.T)
    speeds = system.slip_rows @ out
    out[nq : 2 * nq] = push @ np.linalg.lstsq(directions @ push, speeds, rcond=None)[0]
    return out
