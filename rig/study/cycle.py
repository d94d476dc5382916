"""The limit cycle of a rig at constant actuator values: stick-slip, found by running the plant until it repeats.

The run starts stuck to the surface at the unloaded structure, outside of the cycle, so that a cycle is found wherever
one exists beside stable sliding. It has settled when the last two cycles have the same mode changes at the same times
to `REPEAT` of a period. One more cycle is then read from the dense output: extremes inside steps and at events alike.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rig.scenes.scene import Scene
from rig.solve import ledger
from rig.solve.assembly import Assembly
from rig.solve.linear import sliding_key, steady
from rig.solve.motion import Event, Motion, chosen
from rig.solve.system import CLOSED, STICK, System
from rig.study.dense import Dense

Array = NDArray[np.float64]
REPEAT = 1e-9
TIGHT = 1e-10
LONGEST = 120.0  # s
QUIET = 40.0  # periods of the slowest mode without an event: it slides
_BLOCK = 16  # ticks in one call
_BETTER = 1e-2
_MOST = 24  # mode changes in one cycle


@dataclass(frozen=True)
class Cycle:
    """A limit cycle, or why there is none (`found` false, `why`).

    period, frequency   [s], [Hz]             amplitude   half of peak to peak, of displacement and velocity
    stick_time          [s] in one period, and its share, for each contact
    extremes            (lowest, highest) of each plant output in its unit; start and end of stick: outputs there
    energy              [J] in one cycle by term; `error`: what does not close, relative to the largest term
    repeats             largest difference of an event's time from the cycle before, relative to the period
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
        """Half of peak to peak of displacement and velocity."""
        return {n: 0.5 * (h - l) for n, (l, h) in self.extremes.items() if n in ("displacement", "velocity")}

    def to_json(self) -> dict[str, Any]:
        """As plain values."""
        if not self.found:
            return {"scene": self.scene, "method": self.method, "found": False, "why": self.why, "after": self.after}
        derived = {"frequency": self.frequency, "stick_share": self.stick_share, "amplitude": self.amplitude}
        return {**vars(self), **derived, "events": [{"t": t, "what": what} for t, what in self.events]}

    def text(self) -> str:
        """For a reader."""
        if not self.found:
            return f"{self.scene}: {self.why}"
        kind = "limit cycle" if any(self.stick_time.values()) else "periodic motion in which nothing sticks"
        lines = [f"{self.scene}: {kind}, {self.method}, settled after {self.after:.4g} s"]
        lines += [f"  period {self.period:.10g} s, {self.frequency:.6g} Hz; repeats to {self.repeats:.1e}"]
        for name, time in self.stick_time.items():
            lines += [f"  {name} sticks for {time:.10g} s, {100.0 * time / self.period:.4g} % of the period"]
        lines += ["", f"  {'output':<18}{'lowest':>16}{'highest':>16}{'stick starts':>16}{'stick ends':>16}"]
        for name, (low, high) in self.extremes.items():
            at = [f"{d[name]:>16.8g}" if d else f"{'':>16}" for d in (self.stick_start, self.stick_end)]
            lines += [f"  {name:<18}{low:>16.8g}{high:>16.8g}{at[0]}{at[1]}  {self.units[name]}"]
        terms = ", ".join(f"{name} {v:.6g}" for name, v in self.energy.items() if name != "error" and v)
        lines += ["", f"  energy in a cycle [J]: {terms}; closes to {abs(self.energy['error']):.1e}"]
        return "\n".join(lines)


def limit_cycle(scene: Scene, tolerance: float = TIGHT, longest: float = LONGEST) -> Cycle:
    """The limit cycle of `scene` with every actuator held at its value at the start, no controller, no sensor.

    `tolerance`: of dopri5. `longest`: simulated seconds until it must have settled. Raises rig.errors.NumericsError
    where the motion has to stop.
    """
    assembly = scene.assemble()
    system = assembly.system()
    method = chosen(scene.clock.method, system)
    repeat = max(REPEAT, 10.0 * tolerance) if method == "dopri5" else 1e-7 if method == "rk4" else REPEAT
    sliding = steady(system, sliding_key(system))
    if not sliding.exists:
        return Cycle(scene.name, method, False, "no limit cycle: nothing slides steadily at these values", 0.0)
    runner = _Runner(scene, assembly, stuck(system, sliding.x), method, tolerance)
    turning = np.abs(sliding.eigenvalues())
    quiet = QUIET * 2.0 * math.pi / float(turning[turning > 1e-6 * turning.max()].min())
    step = scene.step_ns * 1e-9
    events: list[Event] = []
    while (now := runner.motion.tick * step) < longest:
        events += runner.block(_BLOCK)
        count, drift = repeating(events, step, repeat)
        if count and drift <= repeat:
            return runner.read(scene, events[-2 * count :], count, drift, now)
        last = (events[-1].tick * step) if events else 0.0
        if now - last > quiet:
            return Cycle(scene.name, method, False, "sliding: no limit cycle", now)
    return Cycle(scene.name, method, False, f"does not repeat within {longest:g} s", longest)


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


class _Runner:
    """The plant of a scene with all its outputs written down, without sensors and controllers."""

    def __init__(self, scene: Scene, assembly: Assembly, start: Array, method: str, tolerance: float) -> None:
        self.scene, self.method, self.tolerance = scene, method, tolerance
        self.outputs = list(assembly.outputs)
        self.units = {name: output.unit for name, output in assembly.outputs.items()}
        self.rows = [output.row for output in assembly.outputs.values()]
        self.system = assembly.system()
        self.motion = self._moving(start, scene.step_ns, _BLOCK)

    def _moving(self, start: Array, step_ns: int, longest: int) -> Motion:
        clock = self.scene.clock
        return Motion(
            replace(self.system, start=start),
            step_ns,
            self.method,
            outputs=self.rows,
            read=len(self.rows),
            tolerance=self.tolerance,
            substeps=max(1, math.ceil(step_ns / int(clock.rk4_step))),
            cap=clock.events_per_frame,
            limit=clock.limit,
            longest=longest,
        )

    def block(self, ticks: int) -> list[Event]:
        """Carry the plant on; the events met."""
        self.motion.advance(ticks)
        return self.motion.events()

    def read(self, scene: Scene, last: list[Event], count: int, drift: float, now: float) -> Cycle:
        """Run one more cycle and tell what it is like. `last`: the events of the two cycles before, `count` each."""
        step_ns = scene.step_ns
        times = [_time(event, last[0].tick, step_ns * 1e-9) for event in last]
        period = times[-1] - times[-1 - count]
        dense, ledger_ = Dense(), _Ledger(self.motion)
        whole, rest = divmod(round(period * 1e9), step_ns)
        events: list[tuple[float, Event]] = []
        done = 0
        while done < whole:
            ticks = min(_BLOCK, whole - done)
            met = self.block(ticks)
            dense.add(done * step_ns * 1e-9, self.motion)
            events += [((e.tick - self.motion.tick + ticks + done + e.place) * step_ns * 1e-9, e) for e in met]
            done += ticks
        ledger_.add(self.motion)
        if rest:
            end = self._moving(self.motion.x.copy(), rest, 1)
            ledger_.start(end)
            end.advance(1)
            dense.add(whole * step_ns * 1e-9, end)
            events += [((whole * step_ns + e.place * rest) * 1e-9, e) for e in end.events()]
            ledger_.add(end)
        starts, ends = self._stick(0, [event for _, event in events])
        return Cycle(
            scene=scene.name,
            method=self.method,
            found=True,
            why="",
            after=now,
            period=period,
            repeats=drift,
            stick_time=self._stick_times(last[-count:], times[-count - 1 :]),
            extremes={name: dense.extremes(i) for i, name in enumerate(self.outputs)},
            units=self.units,
            stick_start=self._at(dense, events, starts, after=True),
            stick_end=self._at(dense, events, ends, after=False),
            energy=ledger_.terms(),
            events=tuple((t, event.what) for t, event in events),
        )

    def _stuck(self, key: int, p: int) -> bool:
        patches, normals, *_ = self.system.modes(key)
        closed = any(k.patch == p and mode == CLOSED for k, mode in zip(self.system.normals, normals))
        return patches[p] == STICK and closed

    def _stick_times(self, events: list[Event], times: list[float]) -> dict[str, float]:
        spans = [(b - a, event.before) for a, b, event in zip(times, times[1:], events)]
        return {
            patch.name: sum(span for span, before in spans if self._stuck(before, p))
            for p, patch in enumerate(self.system.patches)
        }

    def _stick(self, p: int, events: list[Event]) -> tuple[int, int]:
        """Numbers of the events at which contact p begins and ends to stick; -1 where there is none."""
        held = [self._stuck(event.before, p) for event in events]
        after = [*held[1:], held[0]] if held else []
        changes = list(zip(held, after))
        start = changes.index((False, True)) if (False, True) in changes else -1
        end = changes.index((True, False)) if (True, False) in changes else -1
        return start, end

    def _at(self, dense: Dense, events: list[tuple[float, Event]], number: int, after: bool) -> dict[str, float]:
        return dict(zip(self.outputs, dense.at(events[number][0], after).tolist())) if number >= 0 else {}


class _Ledger:
    """The energy terms of one cycle."""

    def __init__(self, motion: Motion) -> None:
        self._sum = np.zeros(ledger.TERMS)
        self._stored = 0.0
        self.start(motion)

    def start(self, motion: Motion) -> None:
        """Count from here."""
        self._before = motion.state.energy.copy()
        self._held = ledger.stored(motion.system, motion.x)

    def add(self, motion: Motion) -> None:
        """Count what has come and gone since `start`."""
        self._sum += motion.state.energy - self._before
        self._stored += ledger.stored(motion.system, motion.x) - self._held

    def terms(self) -> dict[str, float]:
        """By name, and `error`: what does not close, relative to the largest term."""
        largest = max(float(np.abs(self._sum).max()), 1e-30)
        error = (float(self._sum @ ledger.SIGNS) - self._stored) / largest
        return {**dict(zip(ledger.NAMES, self._sum.tolist())), "stored": self._stored, "error": error}
