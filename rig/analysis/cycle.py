"""The limit cycle of a rig at constant actuator values: the plant is simulated until its stick-slip motion repeats.

The run starts with every contact stuck to its surface and the structure unloaded. With one degree of freedom this is
outside of the cycle, so that a cycle is also found where stable sliding exists beside it; else it may be missed. The
motion has settled when the last cycles have the same mode set changes at the same times to `REPEAT` of a period, or the
same turning points if there are none. For a cycle that attracts slowly, Newton's method continues from there
(rig.analysis.cycle). Its result counts once the simulation repeats it and its multipliers are stable. Then one more
cycle is read from the dense output, with extremes inside steps and at events. rig.analysis.floquet computes the
multipliers; rig.analysis.cycle decides when the motion has come to rest in sliding.

Test whether a motion has come to rest in steady sliding, with the kinetic energy as a norm.

    |d|^2 = v^T M v + w^2 q^T M q      of the distance d = (q, v) from sliding, w = |lambda| of its least stable mode

The mass matrix makes metres and radians comparable. The scale is the standing start of a cycle: every contact moves
with its surface, the structure is unloaded. So the scale contains the static deflection and the speed of the drive.

Turning points of a motion: zeros of one coordinate's falling velocity, with the state there.

A motion without events, in which nothing sticks, is periodic if the states at its turning points repeat.

Newton's method on the return map (rig.analysis.return_map) finds a cycle for motions that approach it slowly. The
result is a state to continue from. Simulation alone then shows that it repeats, and its multipliers show that it
attracts.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, replace
from itertools import pairwise
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from rig.analysis.cycle_report import Cycle
from rig.analysis.floquet import around, floquet
from rig.analysis.orbit import MOST, REPEAT, Orbit, all_round, refuse, repeating, stick_times, time_of, turn_of
from rig.analysis.return_map import NoCycle, multipliers, parameter
from rig.errors import NumericsError
from rig.model.assembly import Assembly
from rig.model.method import ADAPTIVE, chosen
from rig.model.system import System
from rig.motion.motion import Event
from rig.scenes.left_out import left_out
from rig.scenes.scene import Scene
from rig.stability.linearisation import Steady, sliding_key, steady

Array = NDArray[np.float64]
NEAR = 1e-7
"""Share of the scale. This close to stable sliding the rig is linear: a disturbance of this size decays."""
ROUGH = 1e-6
SETTLED = 32
_MOST = 4  # most turning points in one cycle
_ROUNDS = 3  # compared cycles: two could agree by chance
_STILL = 1e-2  # of the size of each state: smallest motion in a period of a cycle; below it is a state of rest
_HALVINGS = 6
_GROWS = 1e-5  # a multiplier larger than one by this belongs to an unstable cycle
TIGHT = 1e-10
LONGEST = 120.0  # s
CHANGES = 500_000  # mode set changes: over a minute of a squeal at 3.4 kHz
QUIET = 40.0  # periods of the slowest mode without an event, after which the search tests whether the motion decays
_AGAIN = 1.01  # ratio of the times of two successive tests whether the motion repeats
_FIRST = 64  # mode set changes after which Newton's method is tried, and again after twice as many
_NEARLY = 1e-2  # of the period: rounds that differ by less may lie near a cycle
_CALM = 2  # turns of an uneven surface without a contact event, after which the rig slides
_TURNS = 5.0  # turns of it that the search waits for
_SLOW = 0.9  # a multiplier above which a cycle attracts slowly
_POINTS = 5  # of each step of the integrator, in the outputs over a period
_LEFT = 1e-6  # of the period: largest remaining distance to a cycle that attracts slowly


class Rest:
    """Steady sliding as the state in which a motion may end. `start`: the standing start [state]."""

    def __init__(self, sliding: Steady, start: Array) -> None:
        self._sliding, self._nq = sliding, len(sliding.system.coordinates)
        self._free = not sliding.load.any()
        """True if no contact is loaded: the structure vibrates freely and comes to rest where it would slide."""
        there = sliding.exists or self._free
        rates = sliding.eigenvalues() if there else np.zeros(0, dtype=np.complex128)
        self.least = complex(rates[0]) if len(rates) else complex(math.nan, math.nan)
        self._turn = abs(self.least)
        self._scale = self._distance(start)
        self.stable = self.least.real < 0.0
        """Whether every mode of sliding decays."""

    def share(self, x: Array) -> float:
        """Return the distance of state `x` from sliding, over the scale."""
        return self._distance(x) / self._scale if self._scale > 0.0 else math.inf

    def reached(self, x: Array) -> bool:
        """Return whether a motion at `x` without stick can only decay."""
        return self.stable and self.share(x) <= NEAR

    def text(self, more: str = "") -> str:
        """Return why there is no limit cycle, or none is found; `more`: a further observation."""
        hertz = abs(self.least.imag) / (2.0 * math.pi)
        at = f" at {hertz:.6g} Hz" if hertz else ""
        decays = f"least stable mode decays with {-self.least.real:.6g} 1/s{at}"
        if self._free:
            return f"no limit cycle: no contact is loaded, and the {decays}{more}"
        return (
            f"no limit cycle found from a standing start: sliding is stable, its {decays}{more}. Another start may "
            "reach one: rig map, over a range that begins or ends where the rig vibrates"
        )

    def _distance(self, x: Array) -> float:
        d, nq, mass = x - self._sliding.x, self._nq, self._sliding.system.mass
        q, v = d[:nq], d[nq : 2 * nq]
        return math.sqrt(max(float(v @ mass @ v + self._turn**2 * (q @ mass @ q)), 0.0))


class Turn(NamedTuple):
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
        period, off = min((self._off(count) for count in range(1, _MOST + 1)), key=lambda fit: fit[1] > repeat)
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
        off += [
            float(np.divide(distance, span, out=np.full(len(span), math.inf), where=span > 0.0).max())
            for distance in away
        ]
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

    value = np.polynomial.Polynomial(polynomial)
    return 1.0 if value(1.0) >= 0.0 else float(brentq(value, 0.0, 1.0, xtol=1e-15))


@dataclass(frozen=True)
class ShootingResult:
    """The result of Newton's method: a state on the cycle, its period [s], the size of its largest multiplier."""

    x: Array
    period: float
    multiplier: float
    steps: int

    @property
    def stable(self) -> bool:
        """Whether the cycle does not repel nearby motions."""
        return self.multiplier <= 1.0 + _GROWS


def shoot(orbit: Orbit, period: float) -> ShootingResult | None:
    """Find the cycle near the present motion, which returns after about `period` [s]; None if there is none.

    The orbit advances by one period and is otherwise unchanged.
    """
    try:
        returns, u, driven = around(orbit, orbit.round(period), period)
        if driven:  # the period is not free
            return None
        met = returns.end(u).met
        u, end = returns.newton(u, parameter(0.0, len(u)), u, met, over_p=False, halvings=_HALVINGS)
        matrix = returns.derivative(u, end, over_p=False).P
        moves = float(np.linalg.norm(returns.rate(u, end.x, end.key))) > _STILL
    except (NoCycle, NumericsError):
        return None
    size = max((abs(v) for v in multipliers(matrix, driven=False)[0]), default=0.0)
    return ShootingResult(returns.state(u), float(u[-2] * returns.T0), size, returns.steps) if moves else None


def limit_cycle(
    scene: Scene,
    tolerance: float = TIGHT,
    longest: float | None = None,
    watch: Callable[[float, float], object] = lambda now, drift: None,
) -> Cycle:
    """Find the limit cycle of `scene` with every actuator held at its initial value, without controllers and sensors.

    `tolerance`: of dopri5 and rosenbrock. `longest`: simulated time [s] within which the motion must settle. The
    default is `LONGEST`, more for an uneven surface that turns slowly, less if `CHANGES` mode set changes happen
    before. `watch` gets the simulated time [s] and the relative difference between the last rounds. Raises
    rig.errors.NumericsError where the simulation has to stop, UsageError for a film of points.
    """
    refuse(scene, "a limit cycle")
    assembly = scene.assemble()
    system = assembly.system()
    sliding = steady(system, sliding_key(system))
    surfaces = sliding.x.copy()
    surfaces[: 2 * len(system.coordinates)] = 0.0
    if not np.any(system.slip_rows @ surfaces):
        still = "nothing slides, because no surface moves"
        why = still if system.patches else "the rig has no contact that could slide"
        found = Cycle(scene.name, chosen(scene.clock.method, system), False, f"no limit cycle: {why}", 0.0)
    else:
        found = _Search(scene, assembly, sliding, tolerance, longest, watch).run()
    return replace(found, left_out=left_out(scene))


class _Search:
    """One search for a limit cycle."""

    def __init__(
        self,
        scene: Scene,
        assembly: Assembly,
        sliding: Steady,
        tolerance: float,
        longest: float | None,
        watch: Callable[[float, float], object],
    ) -> None:
        self.scene, self.watch = scene, watch
        self.most = CHANGES if longest is None else math.inf
        system = sliding.system
        self.method = chosen(scene.clock.method, system)
        rough = dict.fromkeys(ADAPTIVE, max(REPEAT, 10.0 * tolerance)) | {"rk4": 1e-7}
        self.repeat = rough.get(self.method, REPEAT)
        start = stuck(system, sliding.x)
        self.rest = Rest(sliding, start)
        self.orbit = Orbit(scene, assembly, start, self.method, tolerance)
        self.turns = Turns(self.orbit, sliding)
        _, self.slowest = sliding.time_scales()
        self.step, self.round_s = scene.step_ns * 1e-9, turn_of(sliding)
        self.longest = longest or (LONGEST if math.isinf(self.round_s) else max(LONGEST, _TURNS * self.round_s))
        self.events: list[Event] = []  # the last, as many as are compared
        self.changes = 0
        self.asked = 0.0
        self.drift, self.touched = math.inf, 0.0  # last difference of rounds; when a contact has changed last [s]
        self.due = _FIRST  # mode set changes, or turning points, at which Newton's method is tried
        self.shot: ShootingResult | None = None
        self.unstable: ShootingResult | None = None

    @property
    def now(self) -> float:
        return self.orbit.motion.tick * self.step

    def run(self) -> Cycle:
        """Simulate until the answer is known."""
        round_s = self.round_s
        begun, before, since = 0.0, 0, 0.0  # when this turn of the surface began, mode set changes then; the last event
        while self.now < self.longest and self.changes < self.most:
            if self.now - begun >= round_s:
                if begun and self.changes - before > MOST:
                    return self._none(
                        f"no limit cycle: the surface is uneven, and one turn of {round_s:.4g} s has "
                        f"{self.changes - before} mode set changes. The motion follows the turn and does not repeat "
                        "within it. An even surface may have a cycle (-p inhomogeneity=none, -p sector=none). Analyse "
                        "the modulated motion with rig simulate and rig sound"
                    )
                begun, before = self.now, self.changes
            before_block = self.now
            met = self.orbit.block()
            if beyond := self.orbit.beyond():
                return self._none(f"no limit cycle: {beyond} at {before_block:.4g} s")
            keys = [*(event.before for event in met), self.orbit.motion.key]
            modes = [self.orbit.system.modes(key)[:2] for key in keys]  # of contacts, without their sectors
            if self._held() or any(a != b for a, b in pairwise(modes)):
                self.touched = self.now
            if met:
                since = self.now
                cycle = self._after(met)
            elif self._held():
                since, cycle = self.now, None
            else:
                cycle = self._between(since)
                if self.now - since > QUIET * self.slowest:
                    since = self.now
            if cycle is not None:
                return cycle
        return self._undecided()

    def _after(self, met: list[Event]) -> Cycle | None:
        """The result after new events, if it is known."""
        self.turns.clear()
        self.events = [*self.events, *met][-3 * MOST :]
        self.changes += len(met)
        if self.now < _AGAIN * self.asked:
            return None
        self.asked = self.now
        count, self.drift = repeating(self.events, self.step, self.repeat)
        self.watch(self.now, self.drift)
        last = self.events[-count - 1 :]
        times = [time_of(event, last[0].tick, self.step) for event in last]
        if not count or not all_round(times[-1] - times[0], self.round_s):
            return None
        if self.drift <= self.repeat:
            return self._read(times[-1] - times[0], self.drift, stick_times(self.orbit, last[1:], times))
        if self.changes >= self.due and self.drift <= _NEARLY:
            self._shoot(times[-1] - times[0])
            self.due = max(2 * self.due, self.changes)
        return None

    def _between(self, since: float) -> Cycle | None:
        """The result for a motion that has slipped without an event since `since` [s], if it is known."""
        if math.isfinite(self.round_s):  # each sector excites the rig: sliding must persist through all of them
            calm = self.rest.stable and self.now - self.touched >= _CALM * self.round_s
            return self._none(self.rest.text(f"; no contact changes in {_CALM} turns of the surface")) if calm else None
        if self.rest.reached(self.orbit.motion.x):
            return self._none(self.rest.text())
        self.turns.add()
        if closed := self.turns.closes(self.repeat):
            return self._read(*closed, dict.fromkeys((p.name for p in self.orbit.system.patches), 0.0))
        if self.now - since > QUIET * self.slowest and self.rest.stable and self.turns.dying(since):
            return self._none(self.rest.text())
        return None

    def _read(self, period: float, drift: float, sticks: dict[str, float]) -> Cycle | None:
        """The cycle; None if it attracts so slowly that the remaining distance to it matters: the search continues."""
        cycle = _read(self.orbit, period, drift, self.now, sticks, self.shot.steps if self.shot else 0)
        slow = self.shot is None and _SLOW < cycle.multiplier < 1.0
        return None if slow and drift > _LEFT * (1.0 - cycle.multiplier) and self._shoot(period) else cycle

    def _shoot(self, period: float) -> bool:
        """Continue from a cycle found by Newton's method, if there is one that attracts."""
        shot = shoot(self.orbit, period)
        self.events.clear()  # the orbit is a period on
        self.turns.clear()
        self.asked = 0.0
        if shot is None or self.rest.share(shot.x) <= NEAR:
            return False
        if not shot.stable:
            self.unstable = shot
            return False
        self.shot = shot
        self.orbit.turn_to(shot.x)
        return True

    def _held(self) -> bool:
        """Whether a contact sticks now."""
        return any(self.orbit.stuck(self.orbit.motion.key, p) for p in range(len(self.orbit.system.patches)))

    def _none(self, why: str) -> Cycle:
        return Cycle(self.scene.name, self.method, False, why, self.now)

    def _undecided(self) -> Cycle:
        """The result "undecided": why, and what to do."""
        held = self._held() and not self.changes
        what = "the start still sticks" if held else "the motion does not repeat"
        why = f"undecided: {what} within {self.now:.4g} s and {self.changes} mode set changes"
        if math.isfinite(self.drift):
            why += f"; its last periods differ by {self.drift:.1e} of a period"
        if self.unstable is not None:
            period = self.unstable.period
            rate = math.log(self.unstable.multiplier) / period
            why += f"; there is an unstable cycle of {period:.6g} s, which it leaves with {rate:.3g} 1/s"
        why += f". The motion is slow or irregular. Use --longest {4.0 * self.now:.3g}, or rig map"
        return replace(self._none(why), decided=False)


def _read(orbit: Orbit, period: float, drift: float, now: float, sticks: dict[str, float], newton: int) -> Cycle:
    """Simulate one more cycle and return its properties."""
    turn = orbit.round(period)
    time, values = turn.dense.sampled(_POINTS)
    held = [orbit.stuck(event.before, 0) for _, event in turn.events]
    changes = list(zip(held, [*held[1:], *held[:1]]))
    times = [0.0, *(t for t, _ in turn.events), period] if held else []

    def at(change: tuple[bool, bool], after: bool) -> dict[str, float]:
        """The outputs where the first contact begins or ends to stick."""
        if change not in changes:
            return {}
        return dict(zip(orbit.outputs, turn.dense.at(turn.events[changes.index(change)][0], after).tolist()))

    return Cycle(
        scene=orbit.scene.name,
        rig=orbit.scene,
        method=orbit.method,
        found=True,
        why="",
        after=now,
        period=period,
        repeats=drift,
        stick_time=sticks,
        extremes={name: turn.dense.extremes(i) for i, name in enumerate(orbit.outputs)},
        units=orbit.units,
        stick_start=at((False, True), after=True),
        stick_end=at((True, False), after=False),
        energy=turn.energy,
        events=tuple((t, event.what) for t, event in turn.events),
        floquet=floquet(orbit, turn, period),
        newton=newton,
        time=time,
        outputs=dict(zip(orbit.outputs, values)),
        sticking=tuple((a, b) for a, b, sticks in zip(times, times[1:], [*held, *held[:1]]) if sticks and b > a),
        state=dict(zip(orbit.system.names, turn.states[0].tolist())),
    )


def stuck(system: System, x: Array) -> Array:
    """Return the state with the signals of `x`, the structure unloaded and every contact moving with its surface."""
    nq = len(system.coordinates)
    out = x.copy()
    out[: 2 * nq] = 0.0
    directions = np.array([p.direction for p in system.patches])
    push = np.linalg.solve(system.mass, directions.T)
    speeds = system.slip_rows @ out
    out[nq : 2 * nq] = push @ np.linalg.lstsq(directions @ push, speeds, rcond=None)[0]
    return out
