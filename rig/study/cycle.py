"""The limit cycle of a rig at constant actuator values: stick-slip, found by running the plant until it repeats.

The run starts stuck to the surface at the unloaded structure, outside of the cycle, so that a cycle is found wherever
one exists beside stable sliding. It has settled when the last cycles have the same mode changes at the same times to
`REPEAT` of a period, or where there are none, the same turning points. A cycle that attracts slowly is looked for by
Newton's method from there on (rig.study.shooting); it counts once the simulation repeats it and its multipliers say
that it attracts. One more cycle is then read from the dense output: extremes inside steps and at events alike. What it
does with a small disturbance: rig.study.floquet. When a motion is at rest in sliding: rig.study.rest.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rig.scenes.scene import Scene
from rig.solve.linear import Steady, sliding_key, steady
from rig.solve.method import chosen
from rig.solve.motion import Event
from rig.solve.system import System
from rig.study.columns import columns
from rig.study.floquet import Floquet, floquet
from rig.study.orbit import Orbit
from rig.study.rest import NEAR, Rest
from rig.study.shooting import Shot, shoot
from rig.study.turns import Turns

Array = NDArray[np.float64]
REPEAT = 1e-9
TIGHT = 1e-10
LONGEST = 120.0  # s
CHANGES = 500_000  # mode changes: over a minute of a squeal at 3.4 kHz
QUIET = 40.0  # periods of the slowest mode without an event, after which it is asked whether the motion dies away
_AGAIN = 1.01  # times the time at which it was asked last whether the motion repeats
_BETTER = 1e-2
_MOST = 24  # mode changes in one cycle
_FIRST = 64  # mode changes after which Newton's method is tried, and again after twice as many
_NEARLY = 1e-2  # of the period: rounds that differ by less may lie near a cycle
_SLOW = 0.9  # a multiplier above which a cycle attracts slowly
_LEFT = 1e-7  # of the period: what may be left of the way to a cycle that attracts slowly


@dataclass(frozen=True)
class Cycle:
    """A limit cycle, or why there is none (`found` false, `why`), or why nothing is known (`decided` false as well).

    period, frequency   [s], [Hz]             amplitude   half of peak to peak, of each output
    stick_time          [s] in one period, and its share, for each contact
    extremes            (lowest, highest) of each plant output in its unit; start and end of stick: outputs there
    energy              [J] in one cycle by term; `error`: what does not close, relative to the largest term
    repeats             largest difference of an event's time from the cycle before, relative to the period; of a
                        cycle without events that of a turning point, relative to the span of each state
    floquet             multipliers: what a round leaves of a small disturbance
    newton              steps of Newton's method that led to it; 0 where simulation alone did
    """

    scene: str
    method: str
    found: bool
    why: str
    after: float
    period: float = math.nan
    repeats: float = math.nan
    stick_time: dict[str, float] = field(default_factory=dict)
    extremes: dict[str, tuple[float, float]] = field(default_factory=dict)
    units: dict[str, str] = field(default_factory=dict)
    stick_start: dict[str, float] = field(default_factory=dict)
    stick_end: dict[str, float] = field(default_factory=dict)
    energy: dict[str, float] = field(default_factory=dict)
    events: tuple[tuple[float, str], ...] = ()
    floquet: Floquet = field(default_factory=Floquet)
    newton: int = 0
    decided: bool = True

    @property
    def multiplier(self) -> float:
        """Size of the largest multiplier: below one, the cycle attracts what is beside it. NaN where there is none."""
        return max((abs(v) for v in self.floquet.multipliers), default=math.nan)

    @property
    def frequency(self) -> float:
        """Cycles in a second [Hz]."""
        return 1.0 / self.period

    @property
    def stick_share(self) -> dict[str, float]:
        """Share of the period that each contact sticks."""
        return {name: time / self.period for name, time in self.stick_time.items()}

    @property
    def amplitude(self) -> dict[str, float]:
        """Half of peak to peak of each output: the amplitude index of a cycle."""
        return {name: 0.5 * (high - low) for name, (low, high) in self.extremes.items()}

    def to_json(self) -> dict[str, Any]:
        """As plain values."""
        if not self.found:
            kept = ("scene", "method", "found", "decided", "why", "after")
            return {name: getattr(self, name) for name in kept}
        derived = {"frequency": self.frequency, "stick_share": self.stick_share, "amplitude": self.amplitude}
        derived |= {"events": [{"t": t, "what": what} for t, what in self.events], "floquet": self.floquet.to_json()}
        return {**vars(self), **derived}

    def text(self) -> str:
        """For a reader."""
        if not self.found:
            return f"{self.scene}: {self.why}"
        unsure = max(10.0 * self.floquet.error, REPEAT)
        attracts, repels = self.multiplier < 1.0 - unsure, self.multiplier > 1.0 + unsure
        kind = "limit cycle" if any(self.stick_time.values()) or attracts or repels else "periodic motion"
        kind = f"unstable {kind}" if repels else kind
        kind += "" if any(self.stick_time.values()) else " in which nothing sticks"
        newton = f", the last of the way by {self.newton} steps of Newton's method" if self.newton else ""
        lines = [f"{self.scene}: {kind}, {self.method}, settled after {self.after:.4g} s{newton}"]
        lines += [f"  period {self.period:.10g} s, {self.frequency:.6g} Hz; repeats to {self.repeats:.1e}"]
        for name, time in self.stick_time.items():
            lines += [f"  {name} sticks for {time:.10g} s, {100.0 * time / self.period:.4g} % of the period"]
        rows: list[tuple[str, ...]] = [("output", "lowest", "highest", "amplitude", "stick starts", "stick ends", "")]
        for name, ends in self.extremes.items():
            values = (*ends, self.amplitude[name], self.stick_start.get(name), self.stick_end.get(name))
            rows.append((name, *("" if value is None else f"{value:.8g}" for value in values), self.units[name]))
        lines += ["", *columns(rows, "<>>>>><")]
        lines += ["", f"  Floquet multipliers: {self.floquet.text()}"]
        terms = ", ".join(f"{name} {v:.6g}" for name, v in self.energy.items() if name != "error" and v)
        lines += ["", f"  energy in a cycle [J]: {terms}; closes to {abs(self.energy['error']):.1e}"]
        return "\n".join(lines)


def _nobody(now: float, drift: float) -> None:
    """Nobody watches."""


def limit_cycle(
    scene: Scene,
    tolerance: float = TIGHT,
    longest: float | None = None,
    watch: Callable[[float, float], object] = _nobody,
) -> Cycle:
    """The limit cycle of `scene` with every actuator held at its value at the start, no controller, no sensor.

    `tolerance`: of dopri5. `longest`: simulated seconds until it must have settled; by default `LONGEST`, or less where
    there are `CHANGES` mode changes before. `watch` is told the simulated time [s] and to what share of its period the
    motion repeats. Raises rig.errors.NumericsError where it has to stop.
    """
    return _Search(scene, tolerance, longest, watch).run()


class _Search:
    """One search for a limit cycle."""

    def __init__(
        self, scene: Scene, tolerance: float, longest: float | None, watch: Callable[[float, float], object]
    ) -> None:
        self.scene, self.watch = scene, watch
        self.longest = longest or LONGEST
        self.most = CHANGES if longest is None else math.inf
        assembly = scene.assemble()
        system = assembly.system()
        self.method = chosen(scene.clock.method, system)
        rough = {"dopri5": max(REPEAT, 10.0 * tolerance), "rk4": 1e-7}
        self.repeat = rough.get(self.method, REPEAT)
        self.sliding = steady(system, sliding_key(system))
        start = stuck(system, self.sliding.x)
        self.rest = Rest(self.sliding, start)
        self.orbit = Orbit(scene, assembly, start, self.method, tolerance)
        self.turns = Turns(self.orbit, self.sliding)
        turning = np.abs(self.sliding.eigenvalues())
        self.slowest = 2.0 * math.pi / float(turning[turning > 1e-6 * turning.max()].min())
        self.step, self.round_s = scene.step_ns * 1e-9, _round(self.sliding)
        self.events: list[Event] = []  # the last, as many as are compared
        self.changes = 0
        self.asked = 0.0
        self.drift = math.inf
        self.due = _FIRST  # mode changes, or turning points, at which Newton's method is tried
        self.shot: Shot | None = None
        self.unstable: Shot | None = None

    @property
    def now(self) -> float:
        return self.orbit.motion.tick * self.step

    def run(self) -> Cycle:
        """Simulate until the answer is known."""
        if not np.any(_surfaces(self.sliding)):
            return self._none("no limit cycle: nothing slides, every surface stands still")
        round_s = self.round_s
        begun, before, since = 0.0, 0, 0.0  # when this turn of the surface began, mode changes then; the last event
        while self.now < self.longest and self.changes < self.most:
            if self.now - begun >= round_s:
                if begun and self.changes - before > _MOST:
                    return self._none(_uneven(round_s, self.changes - before))
                begun, before = self.now, self.changes
            before_block = self.now
            met = self.orbit.block()
            if beyond := self.orbit.beyond():
                return self._none(f"no limit cycle: {beyond} at {before_block:.4g} s")
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
        """What is known after events."""
        self.turns.clear()
        self.events = [*self.events, *met][-3 * _MOST :]
        self.changes += len(met)
        if self.now < _AGAIN * self.asked:
            return None
        self.asked = self.now
        count, self.drift = repeating(self.events, self.step, self.repeat)
        self.watch(self.now, self.drift)
        if not count:
            return None
        last = self.events[-count - 1 :]
        times = [_time(event, last[0].tick, self.step) for event in last]
        if self.drift <= self.repeat:
            return self._read(times[-1] - times[0], self.drift, _stick_times(self.orbit, last[1:], times))
        alike = math.isinf(self.round_s)  # else the rounds of a motion differ with the place
        if alike and self.changes >= self.due and self.drift <= _NEARLY:
            self._shoot(times[-1] - times[0])
            self.due = max(2 * self.due, self.changes)
        return None

    def _between(self, since: float) -> Cycle | None:
        """What is known of a motion that slips without an event since `since` [s]."""
        x = self.orbit.motion.x
        if self.rest.reached(x):
            return self._none(self.rest.text())
        self.turns.add()
        if closed := self.turns.closes(self.repeat):
            return self._read(*closed, dict.fromkeys((p.name for p in self.orbit.system.patches), 0.0))
        if self.now - since > QUIET * self.slowest and self.rest.stable and self.turns.dying(since):
            return self._none(self.rest.text())
        return None

    def _read(self, period: float, drift: float, sticks: dict[str, float]) -> Cycle | None:
        """The cycle; None where it attracts so slowly that what is left of the way to it counts: go on from there."""
        after = self.now
        found = _read(self.orbit, period, drift, after, sticks, self.shot.steps if self.shot else 0)
        slow = _SLOW < found.multiplier < 1.0
        if self.shot is None and slow and drift > _LEFT * (1.0 - found.multiplier) and self._shoot(period):
            return None
        return found

    def _shoot(self, period: float) -> bool:
        """Go on from a cycle found by Newton's method, if there is one that attracts."""
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
        """Why nothing is known, and what to do."""
        held = self._held() and not self.changes
        what = "the start still sticks" if held else "the motion does not repeat"
        why = f"undecided: {what} within {self.now:.4g} s and {self.changes} mode changes"
        if math.isfinite(self.drift):
            why += f"; its last rounds differ by {self.drift:.1e} of their period"
        if self.unstable is not None:
            period = self.unstable.period
            rate = math.log(self.unstable.multiplier) / period
            why += f"; beside it lies an unstable cycle of {period:.6g} s, which it leaves with {rate:.3g} 1/s"
        why += (
            f". It is slow or irregular: --longest {4.0 * self.now:.3g} looks further, rig map shows what it settles to"
        )
        return replace(self._none(why), decided=False)


def _surfaces(sliding: Steady) -> Array:
    """Speed of each surface [m/s]."""
    x = sliding.x.copy()
    x[: 2 * len(sliding.system.coordinates)] = 0.0
    return np.asarray(sliding.system.slip_rows @ x)


def _round(sliding: Steady) -> float:
    """Time [s] in which the surface comes round, where it is not alike everywhere; else infinite."""
    rates = [sector.row @ sliding.modes.A @ sliding.x / sector.period for sector in sliding.system.sectors]
    return 1.0 / max((abs(float(rate)) for rate in rates), default=0.0) if any(rates) else math.inf


def _uneven(round_s: float, changes: int) -> str:
    return (f"no limit cycle: the surface is not alike all round, and in a turn of {round_s:.4g} s there are {changes} "
            "mode changes: the motion swings with the turn and does not come back to where it was. What is in the way "
            "can be taken out (-p inhomogeneity=none, -p sector=none); the swing itself is told by rig simulate and "
            "rig sound")  # fmt: skip


def _read(orbit: Orbit, period: float, drift: float, now: float, sticks: dict[str, float], newton: int) -> Cycle:
    """Run one more cycle and tell what it is like."""
    one = orbit.round(period)
    met = [event for _, event in one.events]
    held = [orbit.stuck(event.before, 0) for event in met]
    changes = list(zip(held, [*held[1:], *held[:1]]))

    def at(change: tuple[bool, bool], after: bool) -> dict[str, float]:
        """Outputs where the first contact begins or ends to stick."""
        if change not in changes:
            return {}
        return dict(zip(orbit.outputs, one.dense.at(one.events[changes.index(change)][0], after).tolist()))

    return Cycle(
        scene=orbit.scene.name,
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
    )


def _stick_times(orbit: Orbit, events: list[Event], times: list[float]) -> dict[str, float]:
    """Time [s] that each contact sticks between `times`; `events` end the stretches between them."""
    spans = [(b - a, event.before) for a, b, event in zip(times, times[1:], events)]
    return {
        patch.name: sum(span for span, before in spans if orbit.stuck(before, p))
        for p, patch in enumerate(orbit.system.patches)
    }


def stuck(system: System, x: Array) -> Array:
    """The state with the signals of `x`, the structure unloaded and every contact moving with its surface."""
    nq = len(system.coordinates)
    out = x.copy()
    out[: 2 * nq] = 0.0
    directions = np.array([p.direction for p in system.patches])
    push = np.linalg.solve(system.mass, directions.T)
    speeds = system.slip_rows @ out
    out[nq : 2 * nq] = push @ np.linalg.lstsq(directions @ push, speeds, rcond=None)[0]
    return out


def repeating(events: list[Event], step: float, repeat: float = REPEAT) -> tuple[int, float]:
    """Number of mode changes after which the last ones repeat, and by how much of the period their times differ.

    The least number that repeats to `repeat`, else the one that does best; a larger number only where it does far
    better: of a cycle that closes only after several rounds each round looks alike, and so do two rounds of one that
    is still settling. (0, inf) where none does. Three cycles are compared: two could agree by chance.
    """
    best = (0, math.inf)
    for count in range(2, min(_MOST, len(events) // 3) + 1):
        last = events[-3 * count :]
        names = [event.what for event in last]
        if names[:count] != names[count : 2 * count] or names[count : 2 * count] != names[2 * count :]:
            continue
        t = np.array([_time(event, last[0].tick, step) for event in last])
        period = t[-1] - t[-1 - count]
        gaps = t[count:] - t[:-count] - period
        drift = float(np.abs(gaps).max() / period) if period > 0.0 else math.inf
        if drift < _BETTER * best[1]:
            best = (count, drift)
        if best[1] <= repeat:
            break
    return best


def _time(event: Event, origin: int, step: float) -> float:
    return ((event.tick - origin) + event.place) * step
