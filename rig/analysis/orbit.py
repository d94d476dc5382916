"""The plant of a scene on its own, stepped with its outputs and states recorded: the source of a limit cycle's data.

Detection of a period in the mode set changes of a motion, and the stick time of its contacts within one.

The outputs of a rig between samples: the polynomials that the plant writes for its sensors, collected.

Refusal of analyses that a film of many contact points does not allow.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from rig.compiled.records import Loan
from rig.errors import UsageError
from rig.model import energy_forms
from rig.model.assembly import Assembly
from rig.motion.motion import Event, Frames, Motion
from rig.scenes.scene import Scene
from rig.sensors.chain.bank import Bank
from rig.solve import energy_balance
from rig.solve.control_loop import controller_tables
from rig.solve.forces import no_random_numbers
from rig.solve.frames import Surroundings
from rig.solve.records import CLOSED, STICK
from rig.stability.linearisation import Steady

Array = NDArray[np.float64]
BLOCK = 16  # ticks in one call
REPEAT = 1e-9
MOST = 24
"""Most mode set changes in one cycle."""
_BETTER = 1e-2
_TURN = 0.999  # of a turn of the surface: the shortest period on an uneven surface


def repeating(events: list[Event], step: float, repeat: float = REPEAT) -> tuple[int, float]:
    """Return the number of mode set changes after which the last ones repeat, and their relative difference in time.

    It is the smallest number that repeats to `repeat`, else the best one. A larger number counts only if it is far
    better: each round of a cycle that closes only after several rounds looks alike, and so do two rounds of one that is
    still settling. (0, inf) if none repeats. Three cycles are compared, because two could agree by chance.
    """
    best = (0, math.inf)
    events = _in_order(events[-4 * MOST :], step, repeat)
    for count in range(2, min(MOST, len(events) // 3) + 1):
        last = events[-3 * count :]
        names = [event.what for event in last]
        if names[:count] != names[count : 2 * count] or names[count : 2 * count] != names[2 * count :]:
            continue
        t = np.array([time_of(event, last[0].tick, step) for event in last])
        period = t[-1] - t[-1 - count]
        gaps = t[count:] - t[:-count] - period
        drift = float(np.abs(gaps).max() / period) if period > 0.0 else math.inf
        if drift < _BETTER * best[1]:
            best = (count, drift)
        if best[1] <= repeat:
            break
    return best


def _in_order(events: list[Event], step: float, repeat: float) -> list[Event]:
    """The events, simultaneous ones by name: in equal parts of a rig rounding decides which of them is the first."""
    if len(events) < 2:
        return events
    times = [time_of(event, events[0].tick, step) for event in events]
    close = repeat * times[-1] / len(times)
    moments = itertools.accumulate((b - a > close for a, b in itertools.pairwise(times)), initial=0)
    return [event for _, event in sorted(zip(moments, events), key=lambda pair: (pair[0], pair[1].what))]


def turn_of(sliding: Steady) -> float:
    """Return the time [s] of one turn of an uneven surface; infinite for an even one."""
    rates = [sector.row @ sliding.modes.A @ sliding.x / sector.period for sector in sliding.system.sectors]
    return 1.0 / max((abs(float(rate)) for rate in rates), default=0.0) if any(rates) else math.inf


def all_round(period: float, turn: float) -> bool:
    """Return whether a period covers whole turns of the surface; otherwise the motion repeats only up to the next
    sector.
    """
    return math.isinf(turn) or period >= _TURN * turn


def time_of(event: Event, origin: int, step: float) -> float:
    """Return the time [s] of an event from tick `origin` on, with ticks of `step` [s]."""
    return ((event.tick - origin) + event.place) * step


def stick_times(orbit: Orbit, events: Sequence[Event], times: list[float]) -> dict[str, float]:
    """Return the time [s] that each contact sticks between `times`; `events` end the intervals between them."""
    spans = [(b - a, event.before) for a, b, event in zip(times, times[1:], events)]
    return {
        patch.name: sum(span for span, before in spans if orbit.stuck(before, p))
        for p, patch in enumerate(orbit.system.patches)
    }


class Dense:
    """Outputs over a range of time, smooth inside each segment, with jumps only between segments."""

    def __init__(self) -> None:
        self._start: list[float] = []
        self._length: list[float] = []
        self._coef: list[Array] = []

    def add(self, offset: float, motion: Motion) -> None:
        """Append the segments of the last call of `advance`, which began at `offset` s."""
        segments = motion.segments
        n = int(segments.count[0])
        self._start += (offset + segments.start[:n]).tolist()
        self._length += segments.length[:n].tolist()
        self._coef += [coef.copy() for coef in segments.coef[:n]]

    def at(self, t: float, after: bool) -> Array:
        """Return every output at t [s], just after or just before it."""
        ends = np.array(self._start) + np.array(self._length)
        slack = 1e-9 * min(self._length[0], float(ends[-1]))
        i = int(np.searchsorted(ends, t + slack if after else t - slack))
        i = min(i, len(ends) - 1)
        u = min(max((t - self._start[i]) / self._length[i], 0.0), 1.0)
        return np.asarray(np.polynomial.polynomial.polyval(u, self._coef[i].T), dtype=np.float64)

    def segments(self, output: int) -> tuple[Array, Array, Array]:
        """Return starts [s] and lengths [s] of all segments, and the polynomials [segment, power] of an output
        in them.
        """
        return np.array(self._start), np.array(self._length), np.array([coef[output] for coef in self._coef])

    def sampled(self, points: int) -> tuple[Array, Array]:
        """Return times [n] and values [output, n]: `points` of each segment, its ends among them."""
        u = np.linspace(0.0, 1.0, points)
        t = np.array(self._start)[:, None] + np.array(self._length)[:, None] * u
        values = np.polynomial.polynomial.polyval(u, np.transpose(self._coef, (2, 1, 0)))
        return t.ravel(), np.asarray(values, dtype=np.float64).reshape(len(values), -1)

    def extremes(self, output: int) -> tuple[float, float]:
        """Return the lowest and highest value of an output: at ends of segments, or where its polynomial has slope
        zero.
        """
        _, _, coef = self.segments(output)
        values = np.polynomial.polynomial.polyval(np.linspace(0.0, 1.0, 9), coef.T)
        low, high = float(values.min()), float(values.max())
        near = {int(v.argmin()) // 9 for v in (values, -values)}
        for i in {j for n in near for j in (n - 1, n, n + 1) if 0 <= j < len(coef)}:
            level = np.polynomial.Polynomial(coef[i]).deriv().trim().roots()
            level = level[(np.abs(level.imag) < 1e-9) & (level.real >= 0.0) & (level.real <= 1.0)].real
            at_level = np.polynomial.polynomial.polyval(level, coef[i]).tolist()
            low, high = min([low, *at_level]), max([high, *at_level])
        return low, high


@dataclass(frozen=True)
class OnePeriod:
    """One period: outputs between samples, events with times [s], energy by term [J], states at ticks [tick, n].

    `error` of the energy is the residual, relative to the largest term or to the stored energy.
    """

    dense: Dense
    events: list[tuple[float, Event]]
    energy: dict[str, float]
    states: Array


class Orbit:
    """The plant of `scene` from state `start` on, without sensors and controllers, every actuator held.

    `read`: the outputs that are wanted between samples; by default all outputs and states. `longest`: ticks in one
    call. `framed`: integrator steps end at the frames of the scene, as in a run, so that states and events have the
    bits of a run.
    """

    def __init__(
        self,
        scene: Scene,
        assembly: Assembly,
        start: Array,
        method: str,
        tolerance: float,
        read: Sequence[str] = (),
        framed: bool = False,
    ) -> None:
        self.scene, self.method, self.tolerance = scene, method, tolerance
        self.outputs = list(dict.fromkeys([*read, *assembly.outputs]))
        self.units = {name: output.unit for name, output in assembly.outputs.items()}
        self.system = assembly.system()
        self._rows = [assembly.outputs[name].row for name in self.outputs]
        self._rows += [{name: 1.0} for name in self.system.names]
        self._read = len(read) or len(self._rows)
        self._frame = scene.frame_ns // scene.step_ns if framed else 0
        self.longest = BLOCK + -BLOCK % self._frame if framed else BLOCK
        self.motion = self.moving(start, scene.step_ns, self.longest)

    def moving(self, start: Array, step_ns: int, longest: int) -> Motion:
        """Return a plant that starts from another state with another step."""
        clock = self.scene.clock
        return Motion(
            replace(self.system, start=start),
            step_ns,
            self.method,
            outputs=self._rows,
            read=self._read,
            tolerance=self.tolerance,
            substeps=clock.substeps(step_ns),
            cap=clock.events_per_frame,
            frame=max(self.scene.frame_ns // step_ns, 1),
            limit=clock.limit,
            longest=longest,
            bounds={self.outputs.index(name): limit for name, limit in self.scene.limits.items()},
            frames=in_frames(self.scene, min(self._frame, longest)) if self._frame else None,
        )

    def turn_to(self, x: Array) -> None:
        """Continue from state `x`, at the present time."""
        tick = self.motion.tick
        self.motion.restart(x)
        self.motion.tick = tick

    def block(self, ticks: int = BLOCK) -> list[Event]:
        """Step the plant by up to `ticks`; return the events. With frames, stop after a frame that has events."""
        self.motion.advance(min(ticks, self.longest))
        return self.motion.events()

    def beyond(self) -> str:
        """Return which quantity has left the limit that the scene sets, in words; "" if none has."""
        if self.motion.beyond < 0:
            return ""
        name = self.outputs[self.motion.beyond]
        return f"{name} exceeds its limit of {self.scene.limits[name]:g} {self.units[name]}"

    def round(self, period: float) -> OnePeriod:
        """Step the plant by `period` [s] and record everything."""
        step_ns = self.scene.step_ns
        dense, before = Dense(), _energy(self.motion)
        whole, rest = divmod(round(period * 1e9), step_ns)
        events: list[tuple[float, Event]] = []
        states = [self.motion.x[None].copy()]
        done = 0
        while done < whole:
            begun = self.motion.tick - done
            met = self.block(min(whole - done, self._frame or whole))  # the record holds one frame
            dense.add(done * step_ns * 1e-9, self.motion)
            events += [((e.tick - begun + e.place) * step_ns * 1e-9, e) for e in met]
            states.append(self.motion.states.copy())
            done = self.motion.tick - begun
        exchanged = _energy(self.motion) - before
        if rest:
            end = self.moving(self.motion.x.copy(), rest, 1)
            before = _energy(end)
            end.advance(1)
            dense.add(whole * step_ns * 1e-9, end)
            events += [((whole * step_ns + e.place * rest) * 1e-9, e) for e in end.events()]
            exchanged += _energy(end) - before
        terms, stored = exchanged[:-1], float(exchanged[-1])
        largest = max(float(np.abs(terms).max()), abs(float(before[-1])), 1e-30)
        balance = {"stored": stored, "error": (float(terms @ energy_balance.SIGNS) - stored) / largest}
        energy = energy_forms.by_name(self.system, terms) | balance
        return OnePeriod(dense, events, energy, np.concatenate(states))

    def stuck(self, key: int, p: int) -> bool:
        """Whether contact p sticks in mode set `key`."""
        patches, normals, *_ = self.system.modes(key)
        held = zip(self.system.normals, normals)
        return patches[p] == STICK and any(k.patch == p and mode == CLOSED for k, mode in held)


def in_frames(scene: Scene, steps: int) -> Frames:
    """Return frames of `steps` ticks without samples."""
    bank = Bank({}, (), scene.frame_ns, scene.seed)
    bank.start(np.zeros(0))
    return Frames(steps, Loan(Surroundings(bank.loan.content, controller_tables(), no_random_numbers())))


def _energy(motion: Motion) -> Array:
    """The energy terms of a motion so far, and its stored energy behind them [J]."""
    return np.append(motion.terms(), energy_forms.stored(motion.system, motion.x, motion.key))


def refuse(scene: Scene, study: str) -> None:
    """Raise UsageError if `scene` has a film of points, whose motion is chaotic; `study` names the analysis."""
    if scene.assemble().film is not None:
        raise UsageError(
            f"{scene.name}: {study} is not defined for a film of points: after the first opening motion is chaotic, "
            f"and two runs diverge. Compute statistics of several runs: rig study {scene.name} --repeat 8 "
            "--measure run.rms, with -p noise.force=1e-6 if nothing in the scene is random. "
            f"For sliding with all points closed: rig modes {scene.name} --sweep KEY=A:B:N"
        )
