"""One row of a map, or a part of it: the steady state at each value of x, for every kind of run.

    near   from sliding, with a small perturbation            far    from a standing start
    up     carried from point to point, upwards, from a standing start at the lowest value
    down   carried from point to point, downwards, from the end of `up` (else from a standing start)

The rig of a row is started anywhere along the x axis, moved along it, and simulated until it has settled. A commanded
quantity on the axis (the speed of a drive, a load) is a state of the rig: it is ramped, no matrix changes, and all runs
of the row share the propagators of their mode sets. Any other parameter changes in a few steps.

A carried run that has come to slide would stay exactly on its equilibrium and leave it far too late. Therefore it gets
the perturbation at every point: it equals the near start of each point until that start vibrates again.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Mapping
from contextlib import suppress
from dataclasses import dataclass, replace
from functools import cached_property, partial
from itertools import product

import numpy as np
from numpy.typing import NDArray

from rig.analysis import kernel_shapes
from rig.analysis.axis import Axis
from rig.analysis.branches.begin import Start, ends
from rig.analysis.cycle import stuck
from rig.analysis.eigenvalue_curves import Growth, none, roots
from rig.analysis.map.dither import boundary
from rig.analysis.map.job import PERIODS, RUNS, Job, Settings, Unit
from rig.analysis.map.steady_state import (
    BLANK,
    CYCLES,
    NONE,
    NOTHING,
    SLIDING,
    STICK_SLIP,
    STOPPED,
    UNDECIDED,
    VIBRATION,
    Judge,
    Point,
    Sticking,
    Window,
    closed,
    extremes,
    sticking,
    stopped,
)
from rig.analysis.pool import Arrays, Work
from rig.analysis.regions import along
from rig.analysis.return_map import Family
from rig.bench.free_rig import FreeRig
from rig.errors import NumericsError, RigError, SceneError, Singular, WorkerError
from rig.model.assembly import Assembly
from rig.model.system import System
from rig.motion.motion import Motion, Saved
from rig.quantities import Section
from rig.scenes.rooms import assembled
from rig.scenes.scene import Scene
from rig.stability.linearisation import Steady, sliding_key, steady

Array = NDArray[np.float64]
WINDOW_PERIODS = 8.0  # periods of the slowest vibration mode about sliding
RAMP = 16.0  # of these from one point to the next
TOLERANCE = 1e-9
"""Largest tolerance of dop853 and rosenbrock: at release the slip speed leaves zero slowly, and an error would make it
stick again.
"""
_SHOWS = 1e-3  # logarithmic decrement: a smaller decay is not seen in two periods
_SEEN, _MORE, _TRIED = 3.95, 3.2, 16.0  # cycles in a first and a further window where their period is known, and in all
_FOR_SECTION = 6.5  # cycles in a window whose local maxima are shown
_FINE = 40  # values of a row: then they show without values between them where no growth rate reaches zero
_KEPT = 3  # cycles from which the next one is extrapolated
_NEAR = 2.0  # of the largest difference between these
_SHORT_RAMP = 3.0  # as RAMP, for cycles that are known
_PARTS = 4  # steps from one point to the next of a parameter that cannot be ramped
_SAMPLES = 24  # in a period of the fastest vibration mode
_FEW, _MANY = 3, 30  # sticks in a window: with fewer it becomes longer, with more it is shorter for the next point
_LATEST = 20  # turns over sectors
_ROUNDS = 4  # of simulating on, each for twice as long
_ROOM = 200_000  # ticks in a window: a turn of a surface that creeps is simulated in parts
ALIVE = (STICK_SLIP, VIBRATION)
OF_WINDOW = ("low", "high", "rms", "share", "period")
_LONG = 160  # characters of the reason why a run had to stop


@dataclass(frozen=True)
class Place:
    """A saved state of the rig; `period` as of a Track."""

    value: float
    state: Saved
    period: float = 0.0


class Track:
    """The rig of `scene` with the parameter of `axis` variable. No controllers, no sensors, actuators held.

    Raises SceneError if the scene refuses the first value of the axis.
    """

    def __init__(self, scene: Scene, axis: Axis, settings: Settings) -> None:
        self.scene, self.axis, self.settings = scene, axis, settings
        self.value = axis.values[0]
        self._beside: Steady | None = None  # steady sliding at the last value
        first = axis.at(scene, self.value).parameters
        moved = self._assembled(first, {axis.key: "ramped"}).inputs.get(axis.key)
        self._command = moved.state if moved is not None else ""
        self._slope = moved.slope if moved is not None else ""
        self._moved = {axis.key: "ramped"} if self._slope else {}
        assembly = self._assembled(first, self._moved)
        self._row = assembly.outputs[settings.output].row
        self._system: System = assembly.system()
        names = self._system.names
        self._plain = np.array([self._row.get(name, 0.0) for name in names]) if set(self._row) <= {*names} else None
        self._at = (
            {self._slope: names.index(self._slope), self._command: names.index(self._command)} if self._slope else {}
        )
        self.value, typical = self._typical()
        (fastest, self.slowest), frame = typical.time_scales(), scene.frame_ns
        step_ns = frame // math.ceil(frame * 1e-9 * _SAMPLES / fastest)
        tolerance = min(scene.clock.tolerance, TOLERANCE)
        if not self._slope:
            assembly = self._assembled(axis.at(scene, self.value).parameters, {})
        start = self.system(self.value).start
        self.rig = FreeRig(scene, assembly, start, step_ns=step_ns, tolerance=tolerance, read=[settings.output])
        self._system, self.step = self.rig.system, self.rig.step
        self._short = max(8, round(WINDOW_PERIODS * self.slowest / self.step))
        self.window_ticks = self._short
        self._sticking: Sticking  # in the last window
        self._cycles: list[tuple[float, Array]] = []
        self._met: dict[float, tuple[Place, Array]] = {}  # cycles at the values, by any run
        self.period = 0.0
        """Of the cycles at the present value, if they are known to be the same [s]."""

    def _typical(self) -> tuple[float, Steady]:
        """Value and steady sliding nearest to the middle of the axis; the middle itself if no value has steady
        sliding.
        """
        values, middle = self.axis.values, len(self.axis.values) // 2
        for i in sorted(range(len(values)), key=lambda i: abs(i - middle)):
            with suppress(Singular):
                if (at := self.sliding(values[i])).counts:
                    return values[i], at
        return values[middle], self.sliding(values[middle])

    @cached_property
    def _motion(self) -> Motion:
        return self.rig.in_motion(longest=self._short)

    def start(self) -> Start | None:
        """Return the present motion as the start of a branch; None over sectors, where none is a cycle."""
        known = zip(self._system.names, self._motion.x.tolist())
        return None if self._system.sectors else Start(self.value, dict(known), self.period)

    def compile(self) -> None:
        """Compile the kernels that a rig of this shape needs."""
        self._motion.advance(1)
        self._motion.outputs_at(self._motion.states, self._motion.mode_sets_of_states)

    def _assembled(self, parameters: Section, moved: Mapping[str, str]) -> Assembly:
        return assembled(parameters, self.scene.frame_ns, moved, random=False, limits=self.scene.limits)

    def system(self, value: float) -> System:
        """Return the rig with the parameter at `value`, in its initial state."""
        if not self._slope:
            at = self.axis.at(self.scene, value).parameters
            return self._assembled(at, {}).system()
        start = self._system.start.copy()
        start[self._at[self._command]] = value
        return replace(self._system, start=start)

    def sliding(self, value: float) -> Steady:
        """Return steady sliding at `value`, with the matrix of small motions about it. Raises rig.errors.Singular."""
        system = self.system(value)
        at = steady(system, sliding_key(system), beside=self._beside)
        self._beside = at if at.exists and self._slope else None
        return at

    def least(self, value: float, at: Steady | None = None) -> tuple[complex, float]:
        """Return the least stable eigenvalue of steady sliding at `value` [1/s], and the growth below which it counts
        as zero.

        Of the least stable sector; nan without steady sliding. `at`: steady sliding there, if it is known.
        """
        try:
            at = at or self.sliding(value)
            slidings = [at]
            if at.system.sectors:
                patches, normals, limiters, _, thrown = at.system.modes(at.modes.key)
                paths = product(*(range(len(sector.edges)) for sector in at.system.sectors))
                slidings = [
                    steady(at.system, at.system.key(patches, normals, limiters, path, thrown)) for path in paths
                ]
        except Singular:
            return complex(math.nan, math.nan), 0.0
        rates = [sliding.eigenvalues() for sliding in slidings if sliding.exists]
        if not rates:
            return complex(math.nan, math.nan), 0.0
        worst = max(rates, key=lambda eigenvalues: float(eigenvalues[0].real))
        return complex(worst[0]), float(none(worst)[0])

    def near(self, at: Steady) -> Array:
        """Return sliding, displaced along its least stable mode until the slip speed has the stated amplitude."""
        shape = at.eigenvectors()[1][:, 0]
        swing = at.system.slip_rows @ shape
        p = int(np.abs(swing).argmax())
        if abs(swing[p]) <= 1e-9 * np.abs(shape).max():  # a mode that moves no contact: give it the same speed
            nq = len(at.system.coordinates)
            swing, p = shape[nq : 2 * nq], int(np.abs(shape[nq : 2 * nq]).argmax())
        speed = float(np.abs(at.speed).max())
        return np.asarray(at.x + (shape * (self.settings.kick * speed / swing[p])).real, dtype=np.float64)

    def far(self, at: Steady) -> Array:
        """Return the standing start: the structure unloaded, every contact moving with its surface."""
        return stuck(at.system, at.x)

    def put(self, value: float, x: Array) -> None:
        """Restart at `value` from state `x`, without memory of the run before."""
        self._go(value)
        self._motion.restart(x)
        self.window_ticks, self.period, self._cycles = self._short, 0.0, []

    def _go(self, value: float) -> None:
        if self._slope or value == self.value:
            self.value = value
            return
        ready = self._motion.ready(self.system(value))
        self.value = value  # the run belongs to this value from here on, even if it has to stop at once
        self._motion.replace(ready)

    def here(self) -> Place:
        """Save the present state."""
        return Place(self.value, self._motion.save(), self.period)

    def back(self, place: Place) -> None:
        """Return to a saved state."""
        self._go(place.value)
        self._motion.go_back(place.state)
        self.period = place.period

    def move(self, value: float) -> None:
        """Move the running rig to `value`. Raises rig.errors.NumericsError if the simulation has to stop."""
        ticks = max(1, round((_SHORT_RAMP if self.period else RAMP) * self.slowest / self.step))
        if self._slope:
            motion = self._motion
            rate = (value - float(motion.x[self._at[self._command]])) / (ticks * self.step)
            motion.write(self._at[self._slope], rate)
            motion.advance(ticks)
            motion.write(self._at[self._slope], 0.0)
            motion.write(self._at[self._command], value)  # removes rounding: a speed of zero must be exactly zero
        else:
            start = self.value
            for part in range(1, _PARTS + 1):
                self._go(start + (value - start) * (part / _PARTS))
                self._motion.advance(max(1, ticks // _PARTS))
        self.value = value

    def settle(self, near: bool = False) -> Point:
        """Simulate until the motion has settled, or until the longest time is over.

        If no longest time is stated, a motion that still drifts is simulated for twice as long, with windows twice as
        long.
        """
        turn = self._turn()
        point = self._repeated()
        begun = self.window_ticks
        longest = self.settings.longest or max(PERIODS * self.slowest, _LATEST * turn * self.step)
        rounds = 1 if self.settings.longest else _ROUNDS
        for _ in range(rounds):
            if point.state != UNDECIDED:
                break
            judge = Judge(self.settings.kick, near, turn > 0)
            latest = self.judged(judge, longest, turn)
            point = latest._replace(spent=point.spent + latest.spent)
            if point.state == UNDECIDED:
                longest, self.window_ticks = 2.0 * longest, 2 * self.window_ticks
        self._note(point._replace(state=UNDECIDED) if turn else point)
        if point.state in (UNDECIDED, STOPPED):  # no window has fitted: the next point starts with the usual length
            self.window_ticks = begun
        return point

    def _repeated(self) -> Point:
        """Whether the motion repeats like that at the value before: a few of its cycles tell."""
        spent, begun, ended = 0.0, np.zeros(0), np.zeros(0)
        while self.period and spent < _TRIED * self.period:
            cycles = _FOR_SECTION if self.settings.section else _MORE if spent else _SEEN
            span = math.ceil(cycles * self.period / self.step)
            last = self._simulated(span)
            begun, ended = np.append(begun, spent + last.begun), np.append(ended, spent + last.ended)
            spent += span * self.step
            if closed(begun[-max(CYCLES + 1, len(last.begun)) :], ended):  # and all that the window measures
                return Point(STICK_SLIP, self._window(last)._replace(closed=True), spent)
            if not last.share:
                break
        return Point(UNDECIDED, BLANK, spent)

    def _note(self, point: Point) -> None:
        """Note the cycle of a point, from which the next ones are predicted."""
        self.period = 0.0
        if point.state != STICK_SLIP or not point.window.closed:
            return
        self.period = point.window.period
        begun, ended = self._sticking.begun, self._sticking.ended
        whole = begun[begun < ended.max(initial=0.0)]  # sticks that end in the window
        if len(whole):
            middle = 0.5 * float(whole[-1] + ended[np.searchsorted(ended, whole[-1])])
            place = middle / self.step - 1.0
            before = int(place)
            a, b = self._motion.states[before], self._motion.states[before + 1]
            x = a + (place - before) * (b - a)
            self._met[self.value] = self.here(), x
            self._cycles = [*self._cycles, (self.value, x)][-_KEPT:]

    def predicted(self, value: float) -> Point | None:
        """The state at `value` where the motion goes on from a cycle extrapolated from those at the last values.

        If a run from the other side has met a cycle there, no further away than those, the motion goes on from it.
        None if it does not repeat, or if too little is known: then it has to be carried there.
        """
        if not (self._slope and self.period and len(self._cycles) == _KEPT):
            return None
        known, last = [v for v, _ in self._cycles], self._cycles[-1][1]
        place, met = self._met.get(value, (None, last))
        size = np.abs(last) + np.finfo(float).tiny
        if place is not None and np.max(np.abs(met - last) / size) < _NEAR * max(
            float(np.max(np.abs(state - last) / size)) for _, state in self._cycles
        ):
            self.back(place)
            return self._concluded()
        x = np.zeros(self._system.n)
        for v, state in self._cycles:
            x += state * math.prod((value - other) / (v - other) for other in known if other != v)
        x[self._at[self._command]], x[self._at[self._slope]] = value, 0.0
        self.value = value
        self._motion.restart(x)
        return self._concluded()

    def _concluded(self) -> Point | None:
        """The state of a motion that repeats from here; None if it does not."""
        point = self._repeated()
        if point.state == UNDECIDED:
            return None
        self._note(point)
        return point

    def judged(self, judge: Judge, longest: float, turn: int) -> Point:
        """Simulate window after window, for at most `longest` s, each at least a whole `turn` [ticks]."""
        window, spent = BLANK, 0.0
        try:
            while spent < longest:
                span = max(self.window_ticks, turn)
                window = self._window(self._simulated(span))
                spent += span * self.step
                state = judge.take(window)
                if state != UNDECIDED:
                    if window.sticks > _MANY or not window.share:
                        self.window_ticks = max(self._short, self.window_ticks // 2)
                    return Point(state, window, spent)
                if 0.0 < window.share and window.sticks < _FEW and 4 * span * self.step < longest:
                    self.window_ticks = 2 * span
                    judge.windows.clear()
        except NumericsError as error:
            return stopped(error, spent)
        return Point(judge.at_last(), window, spent)

    def _turn(self) -> int:
        """Ticks in which the slowest path over sectors is passed once; 0 without sectors."""
        if not self._system.sectors:
            return 0
        at = self.sliding(self.value)
        rates = [abs(float(sector.row @ (at.modes.A @ at.x))) / sector.period for sector in self._system.sectors]
        return min(_ROOM, math.ceil(1.0 / (min(rates) * self.step))) if min(rates) > 0.0 else self._short

    def _simulated(self, ticks: int) -> Sticking:
        """Simulate one window and return when a contact sticks in it."""
        motion = self._motion
        motion.advance(ticks)
        count = motion.event_count
        event = motion.log.event[:count]
        times = (event[:, 0] + motion.log.place[:count]) * self.step
        held = np.array([bool(self.rig.stuck(key)) for key in event[:, 3].tolist()], dtype=bool)
        self._sticking = sticking(times, held, bool(self.rig.stuck(motion.key)), ticks * self.step)
        return self._sticking

    def _window(self, s: Sticking) -> Window:
        """The statistics of the last window, in which contacts stick like that."""
        motion = self._motion
        states, system, values = motion.states, motion.system, self.values()
        nq = len(system.coordinates)
        slips = states @ system.slip_rows.T
        swing, travel, moving = 0.0, 0.0, False
        for p, patch in enumerate(system.patches):
            surface = abs(float((states @ patch.surface).mean()))
            moving = moving or surface > 0.0
            swing = max(swing, 0.5 * float(np.ptp(slips[:, p])) / surface if surface > 0.0 else math.inf)
            bottom, top = extremes(states[:, :nq] @ system.slip_rows[p, nq : 2 * nq])
            travel = math.hypot(travel, 0.5 * (top - bottom))
        cycles = values[math.ceil(s.first / self.step) : math.ceil(s.last / self.step)]
        rms, low_high = float(cycles.std()), extremes(values)
        return Window(*low_high, rms, travel, swing, s.share, s.begins, s.period, moving, closed(s.begun, s.ended))

    def decays(self, at: Steady, rate: complex) -> Point | None:
        """Steady sliding, if a motion that begins near it decays as its least stable eigenvalue `rate` [1/s] says.

        None if two of its periods do not show that. A nonlinear part of the decay is of higher order in the amplitude:
        where it takes less than half of the decay, it takes even less of it later.
        """
        turn = 2.0 * math.pi / abs(rate.imag) if rate.imag else math.inf
        if self._system.sectors or not -rate.real * turn > _SHOWS or turn > WINDOW_PERIODS * self.slowest:
            return None
        ticks, motion = math.ceil(turn / self.step), self._motion
        motion.advance(2 * ticks)
        if motion.event_count:
            return None
        slips = motion.states @ motion.system.slip_rows.T
        swings = [[np.subtract(*extremes(part)) for part in half.T] for half in (slips[:ticks], slips[ticks:])]
        first, last = (max(map(abs, half)) for half in swings)
        if not 0.0 < last <= first * math.exp(0.5 * rate.real * ticks * self.step):
            return None
        value = float(motion.outputs_at(at.x[None], motion.mode_sets_of_states[-1:])[0, 0])
        still = BLANK._replace(low=value, high=value, rms=0.0, travel=0.0, slip=0.0, share=0.0, moving=True)
        return Point(SLIDING, still, 2 * ticks * self.step)

    def values(self) -> Array:
        """The output at every tick of the last window."""
        motion = self._motion
        if self._plain is not None:
            return np.asarray(motion.states @ self._plain, dtype=np.float64)
        return motion.outputs_at(motion.states, motion.mode_sets_of_states)[:, 0]


class Row:
    """The runs over the values of a unit. `tables` holds their results."""

    def __init__(self, track: Track, unit: Unit) -> None:
        self.track, self.settings = track, track.settings
        self._runs, self._curve = unit.runs, unit.curve
        self.x = track.axis.values[unit.first : unit.last]
        self._next = track.axis.values[unit.first : unit.last + unit.curve]  # with the first value of the next part
        self._singular: dict[int, Singular] = {}
        self._sliding = [self._steady(i, value) for i, value in enumerate(self._next)]
        self._near: dict[int, tuple[Point, Place | None, Array]] = {}
        self._rates: dict[int, tuple[complex, float]] = {}
        self.branch: Family | None = None  # on which lost vibrations are followed
        count, runs = len(self.x), len(RUNS)
        self.tables: Arrays = {
            "state": np.full((runs, count), NONE, dtype=np.int8),
            **{name: np.full((runs, count), np.nan) for name in (*OF_WINDOW, "spent")},
            "why": np.full((runs, count), "", dtype=f"<U{_LONG}"),
            "section": np.full((runs, count, self.settings.section), np.nan),
            "end": np.full((2, 2), np.nan),
        }

    def run(self) -> Arrays:
        """Every run of the unit, and its growth rates."""
        asked = self._runs
        if self._curve:
            least = [self._least(i) for i in range(len(self._next))]
            seen = least[: len(self.x)]
            rates = [0.0 if abs(rate.real) <= none else rate.real for rate, none in seen]
            self.tables["growth"] = np.array(rates, dtype=np.float64)
            self.tables["frequency"] = np.array([abs(rate.imag) / (2.0 * math.pi) for rate, _ in seen])
            self.tables["onset"] = np.array(self._onsets(least), dtype=np.float64)
        numbers = range(len(self.x))
        end = self._carry("up", numbers, self._standing) if "up" in asked else None
        if "down" in asked:
            self._carry("down", numbers[::-1], lambda i: end or self._standing(i))
        for i in numbers:
            if "near" in asked:
                self._write("near", i, *self._at_near(i))
            if "far" in asked:
                self._write("far", i, *self._standing(i))
        return self.tables

    def stopped(self, why: str) -> Arrays:
        """Return the tables of a unit that could not be simulated, with the reason; growth rates are nan."""
        for run in self._runs:
            self.tables["state"][RUNS.index(run)] = STOPPED
            self.tables["why"][RUNS.index(run)] = why
        if self._curve:
            nothing = np.full(len(self.x), np.nan)
            self.tables |= {"growth": nothing, "frequency": nothing.copy(), "onset": np.zeros(0)}
        return self.tables

    def _steady(self, i: int, value: float) -> Steady | None:
        """Steady sliding at a point; None if the equations of the rig are singular, or if it jams and is not
        simulated.
        """
        try:
            at = self.track.sliding(value)
            if at.inertia <= 0.0 and self.track.scene.clock.unstable == "refuse":
                mode = at.system.describe(at.modes.key)
                raise Singular("jams: friction takes up all of the inertia", mode, jams=True)
        except Singular as error:
            self._singular[i] = error
            return None
        return at

    def _least(self, i: int) -> tuple[complex, float]:
        """Track.least at a point."""
        if i not in self._rates:
            self._rates[i] = self.track.least(self._next[i], self._sliding[i])
        return self._rates[i]

    def _tried(self, begin: Callable[[], object], near: int | None = None) -> tuple[Point, Array]:
        """The steady state of a run and its maxima; a run that has to stop records why, and the map continues.

        `near`: number of the point near whose sliding the run begins.
        """
        try:
            begin()
            at = None if near is None else self._sliding[near]
            quick = self.track.decays(at, self._least(near)[0]) if near is not None and at is not None else None
            point = quick or self.track.settle(near is not None)
        except (NumericsError, Singular) as error:
            point = stopped(error)
        return point, self._none() if point.state == STOPPED else self._maxima(point)

    def _standing(self, i: int) -> tuple[Point, Array]:
        at = self._sliding[i]
        if at is None:
            return stopped(self._singular[i]), self._none()
        return self._tried(lambda: self.track.put(self.x[i], self.track.far(at)))

    def _at_near(self, i: int) -> tuple[Point, Array]:
        """The near start of a point; the rig stays in the state in which it has settled."""
        if i in self._near:
            point, place, maxima = self._near[i]
            if place is not None:
                self.track.back(place)
            return point, maxima
        at = self._sliding[i]
        if at is None:
            return stopped(self._singular[i]), self._none()
        if not at.exists:
            return NOTHING, self._none()
        point, maxima = self._tried(lambda: self.track.put(self.x[i], self.track.near(at)), near=i)
        self._near[i] = point, None if point.state == STOPPED else self.track.here(), maxima
        return point, maxima

    def _carry(
        self, name: str, numbers: Iterable[int], start: Callable[[int], tuple[Point, Array]]
    ) -> tuple[Point, Array]:
        """One carried run over the points, which begins with `start` of the first one; return where it ends."""
        point, maxima = NOTHING, np.zeros(0)
        before = -1
        for i in numbers:
            if before < 0:
                point, maxima = start(i)
            elif point.state in (SLIDING, STOPPED) and (at := self._sliding[i]) is not None and at.exists:
                point, maxima = self._at_near(i)
            elif point.state == STOPPED or self._sliding[i] is None:  # nothing is left to be carried on
                point, maxima = self._standing(i)
            else:
                point, maxima = self._step(name, self.x[before], self.x[i], point.state in ALIVE)
            self._write(name, i, point, maxima)
            before = i
        return point._replace(spent=0.0), maxima

    def _step(self, name: str, start: float, to: float, alive: bool) -> tuple[Point, Array]:
        """Move to the next point. The branch of a vibration that is lost on the way is followed to its end.

        Where that cannot be followed, the vibration is carried there again in ever smaller steps: it may be lost
        because the step was too large, and not because it ends.
        """
        place = self.track.here()
        with suppress(NumericsError):
            if (point := self.track.predicted(to)) is not None:
                return point, self._maxima(point)
        self.track.back(place)
        first, maxima = self._tried(lambda: self.track.move(to))
        if not alive or first.state in ALIVE or first.state == STOPPED:
            return first, maxima
        lost, dead = self.track.here(), to
        if (end := self._followed(place, to)) is not None:
            self.tables["end"][RUNS.index(name)] = end
            return first, maxima
        gap, least = 0.5 * (to - start), abs(to - start) * 0.5**self.settings.refine
        while abs(gap) > 0.75 * least:
            value = place.value + gap
            if abs(to - value) < 0.5 * least:
                value = to
            self.track.back(place)
            point, latest = self._tried(partial(self.track.move, value))
            if point.state not in ALIVE:
                dead, gap = value, 0.5 * gap
            elif value == to:
                return point, latest
            else:
                place = self.track.here()
        self.tables["end"][RUNS.index(name)] = place.value, dead
        self.track.back(lost)
        return first, maxima

    def _followed(self, place: Place, to: float) -> tuple[float, float] | None:
        """The value at which the branch of a vibration ends before `to`, to both sides of its accuracy.

        None where the vibration is no cycle that can be followed, or goes on beyond.
        """
        lost = self.track.here()
        self.track.back(place)
        start = self.track.start()
        self.track.back(lost)
        try:
            self.branch = self.branch or Family(self.track.scene, [self.track.axis])
            end = None if start is None else ends(self.branch, start, to)
        except RigError:
            return None
        return None if end is None else (end.p - end.accuracy, end.p + end.accuracy)

    def _none(self) -> Array:
        return np.full(self.settings.section, np.nan)

    def _maxima(self, point: Point) -> Array:
        """The last local maxima of the output; its value where it is constant."""
        kept = self.settings.section
        if not kept:
            return np.zeros(0)
        y = self.track.values()
        maxima = y[1:-1][(y[1:-1] > y[:-2]) & (y[1:-1] >= y[2:])][-kept:]
        if point.window.low == point.window.high:
            maxima = np.array([point.window.high])
        return np.concatenate([maxima, np.full(kept - len(maxima), np.nan)])

    def _write(self, name: str, i: int, point: Point, maxima: Array) -> None:
        run, t = RUNS.index(name), self.tables
        t["state"][run, i] = point.state
        t["spent"][run, i] = point.spent
        t["why"][run, i] = point.why
        t["section"][run, i] = maxima
        for column in OF_WINDOW:
            t[column][run, i] = getattr(point.window, column)

    def _onsets(self, least: list[tuple[complex, float]]) -> list[float]:
        """Values at which the growth rate of sliding passes through zero, one in every gap in which its sign changes.

        An onset at the first value of the next part belongs to that part.
        """
        known = dict(zip(self._next, least))

        def growths(value: float) -> Growth | None:
            if value not in known:
                known[value] = self.track.least(value)
            rate, none = known[value]
            fine = len(self._next) > _FINE
            return None if math.isnan(rate.real) else Growth(np.array([rate.real]), np.array([none]), fine)

        return [at for at in roots(self._next, growths) if at != self._next[-1] or at == self.x[-1]]


def units(job: Job) -> Work:
    """Return the units of `job` as a work (rig.analysis.pool)."""
    prepare, given_up = partial(_prepare, job), partial(failed, job)
    return Work(partial(compute, job), job.units, job.scene.name, job.digest, prepare, given_up, job.about)


def _prepare(job: Job) -> None:
    """Compile the kernels of the runs."""
    if not job.settings.eigenvalues:
        track = Track(job.at(0), job.x, job.settings)
        shape = kernel_shapes.shape_of(track.system(track.value), job.scene.clock.method, TOLERANCE)
        if shape not in kernel_shapes.ready():
            track.compile()
            kernel_shapes.note(shape)


def compute(job: Job, unit: Unit) -> Arrays:
    """Compute a unit. Raises SceneError if the equations of the whole row have no solution."""
    if job.settings.eigenvalues:
        return along(job.at(unit.row), job.x)
    if job.dithered:
        return boundary(job, unit.first)
    try:
        return Row(Track(job.at(unit.row), job.x, job.settings), unit).run()
    except (NumericsError, Singular) as error:
        raise SceneError(job.text(unit), [str(error)]) from None


def failed(job: Job, unit: Unit, why: str) -> Arrays:
    """Return a row whose runs had to stop. Raises WorkerError for eigenvalues and for dither."""
    if job.settings.eigenvalues or job.dithered:
        raise WorkerError(f"{job.text(unit)}: {why}")
    return Row(Track(job.at(unit.row), job.x, job.settings), unit).stopped(why)
