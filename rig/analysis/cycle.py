"""The limit cycle of a rig at constant actuator values: the plant is simulated until its stick-slip motion repeats.

The run starts with every contact stuck to its surface and the structure unloaded. With one degree of freedom this is
outside of the cycle, so that a cycle is also found where stable sliding exists beside it; else it may be missed. The
motion has settled when the last cycles have the same mode set changes at the same times to `REPEAT` of a period, or the
same turning points if there are none. For a cycle that attracts slowly, Newton's method continues from there
(rig.analysis.shooting). Its result counts once the simulation repeats it and its multipliers are stable. Then one more
cycle is read from the dense output, with extremes inside steps and at events. rig.analysis.floquet computes the
multipliers; rig.analysis.settled decides when the motion has come to rest in sliding.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import replace
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from rig.analysis.cycle_report import Cycle
from rig.analysis.floquet import floquet
from rig.analysis.many_points import refuse
from rig.analysis.orbit import Orbit
from rig.analysis.repetition import MOST, REPEAT, all_round, repeating, stick_times, time_of, turn_of
from rig.analysis.settled import NEAR, Rest
from rig.analysis.shooting import ShootingResult, shoot
from rig.analysis.turning_points import Turns
from rig.model.assembly import Assembly
from rig.model.method import chosen
from rig.model.system import System
from rig.motion.memory import Event
from rig.scenes.scene import Scene
from rig.stability.linearisation import Steady, sliding_key, steady

Array = NDArray[np.float64]
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


def _nobody(now: float, drift: float) -> None:
    """Report progress to nobody: the default of `watch`."""


def limit_cycle(
    scene: Scene,
    tolerance: float = TIGHT,
    longest: float | None = None,
    watch: Callable[[float, float], object] = _nobody,
) -> Cycle:
    """Find the limit cycle of `scene` with every actuator held at its initial value, without controllers and sensors.

    `tolerance`: of dopri5. `longest`: simulated time [s] within which the motion must settle. The default is `LONGEST`,
    more for an uneven surface that turns slowly, less if `CHANGES` mode set changes happen before. `watch` gets the
    simulated time [s] and the relative difference between the last rounds. Raises rig.errors.NumericsError where the
    simulation has to stop, UsageError for a film of points.
    """
    refuse(scene, "a limit cycle")
    assembly = scene.assemble()
    system = assembly.system()
    sliding = steady(system, sliding_key(system))
    if not np.any(_surfaces(sliding)):
        why = (
            "nothing slides, because no surface moves" if system.patches else "the rig has no contact that could slide"
        )
        return Cycle(scene.name, chosen(scene.clock.method, system), False, f"no limit cycle: {why}", 0.0)
    return _Search(scene, assembly, sliding, tolerance, longest, watch).run()


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
        rough = {"dopri5": max(REPEAT, 10.0 * tolerance), "rk4": 1e-7}
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
                    return self._none(_uneven(round_s, self.changes - before))
                begun, before = self.now, self.changes
            before_block = self.now
            met = self.orbit.block()
            if beyond := self.orbit.beyond():
                return self._none(f"no limit cycle: {beyond} at {before_block:.4g} s")
            if self._held() or self._touches(met):
                self.touched = self.now
            if met:
                since = self.now
                found = self._after(met)
            elif self._held():
                since, found = self.now, None
            else:
                found = self._between(since)
                if self.now - since > QUIET * self.slowest:
                    since = self.now
            if found is not None:
                return found
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
        if not count:
            return None
        last = self.events[-count - 1 :]
        times = [time_of(event, last[0].tick, self.step) for event in last]
        if not all_round(times[-1] - times[0], self.round_s):
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
        after = self.now
        found = _read(self.orbit, period, drift, after, sticks, self.shot.steps if self.shot else 0)
        slow = _SLOW < found.multiplier < 1.0
        if self.shot is None and slow and drift > _LEFT * (1.0 - found.multiplier) and self._shoot(period):
            return None
        return found

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

    def _touches(self, met: list[Event]) -> bool:
        """Whether a contact has changed, and not only its sector."""
        keys = [*(event.before for event in met), self.orbit.motion.key]
        modes = [self.orbit.system.modes(key)[:2] for key in keys]
        return any(a != b for a, b in pairwise(modes))

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


def _surfaces(sliding: Steady) -> Array:
    """Speed of each surface [m/s]."""
    x = sliding.x.copy()
    x[: 2 * len(sliding.system.coordinates)] = 0.0
    return np.asarray(sliding.system.slip_rows @ x)


def _uneven(round_s: float, changes: int) -> str:
    return (f"no limit cycle: the surface is uneven, and one turn of {round_s:.4g} s has {changes} mode set changes. "
            "The motion follows the turn and does not repeat within it. An even surface may have a cycle "
            "(-p inhomogeneity=none, -p sector=none). Analyse the modulated motion with rig simulate and "
            "rig sound")  # fmt: skip


def _read(orbit: Orbit, period: float, drift: float, now: float, sticks: dict[str, float], newton: int) -> Cycle:
    """Simulate one more cycle and return its properties."""
    one = orbit.round(period)
    time, values = one.dense.sampled(_POINTS)
    met = [event for _, event in one.events]
    held = [orbit.stuck(event.before, 0) for event in met]
    changes = list(zip(held, [*held[1:], *held[:1]]))

    def at(change: tuple[bool, bool], after: bool) -> dict[str, float]:
        """The outputs where the first contact begins or ends to stick."""
        if change not in changes:
            return {}
        return dict(zip(orbit.outputs, one.dense.at(one.events[changes.index(change)][0], after).tolist()))

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
        extremes={name: one.dense.extremes(i) for i, name in enumerate(orbit.outputs)},
        units=orbit.units,
        stick_start=at((False, True), after=True),
        stick_end=at((True, False), after=False),
        energy=one.energy,
        events=tuple((t, event.what) for t, event in one.events),
        floquet=floquet(orbit, one, period),
        newton=newton,
        time=time,
        outputs=dict(zip(orbit.outputs, values)),
        sticking=_sticking(held, [t for t, _ in one.events], period),
    )


def _sticking(held: list[bool], times: list[float], period: float) -> tuple[tuple[float, float], ...]:
    """Intervals of stick; `held`: whether the first contact stuck before each of the events at `times` [s]."""
    if not times:
        return ()
    ends = zip([0.0, *times], [*times, period])
    return tuple((a, b) for (a, b), stuck in zip(ends, [*held, held[0]]) if stuck and b > a)


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
