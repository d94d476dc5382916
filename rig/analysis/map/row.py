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
from collections.abc import Callable, Iterable, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from functools import partial
from itertools import product

import numpy as np
from numpy.typing import NDArray

from rig.analysis.branches.begin import Start, ends
from rig.analysis.cycles.cycle import Search, stuck
from rig.analysis.cycles.return_map import Family
from rig.analysis.linear.eigenvalue_curves import Growth, none, roots
from rig.analysis.linear.regions import along
from rig.analysis.map import steady_state
from rig.analysis.map.dither import boundary
from rig.analysis.map.job import PERIODS, RUNS, Job, Settings, Unit
from rig.analysis.map.steady_state import (
    BLANK,
    NONE,
    NOTHING,
    SLIDING,
    STICK_SLIP,
    STOPPED,
    UNDECIDED,
    VIBRATION,
    Point,
    Window,
    stopped,
)
from rig.analysis.pool import Arrays, Work, kernel_shapes
from rig.bench.free_rig import FreeRig
from rig.errors import NumericsError, RigError, SceneError, Singular, UsageError, WorkerError
from rig.model.assembly import Assembly
from rig.model.system import System
from rig.motion.motion import Saved
from rig.quantities import Section
from rig.scenes.axis import Axis
from rig.scenes.rooms import assembled
from rig.scenes.scene import Scene
from rig.stability.linearisation import Steady, sliding_key, steady

Array = NDArray[np.float64]
TOLERANCE = 1e-9
"""Largest tolerance of dop853 and rosenbrock: at release the slip speed leaves zero slowly, and an error would make it
stick again.
"""
WINDOW = 8.0  # periods of the slowest vibration mode about sliding
RAMP = 16.0  # of these from one point to the next
_PARTS = 4  # steps from one point to the next of a parameter that cannot be ramped
_SAMPLES = 24  # in a period of the fastest vibration mode
_KEPT = 3  # cycles from which the next one is extrapolated
_SEEN = 3.05  # periods of it from look to look
_REPEATS = 1e-6  # of a period: rounds that differ by less are the same
_PATIENCE = 40.0  # periods of the slowest mode in which a motion may approach its cycle by itself
_LATEST = 20  # turns over sectors
_ROUNDS = 4  # of simulating on, each for twice as long
_ROOM = 200_000  # ticks in a window: a turn of a surface that creeps is simulated in parts
_FINE = 40  # values of a row: then they show without values between them where no growth rate reaches zero
_LONG = 160  # characters of the reason why a run had to stop
_STANDS = 1e-9  # of the largest part of a shape: what is smaller is zero but for rounding
ALIVE = (STICK_SLIP, VIBRATION)
OF_WINDOW = ("low", "high", "rms", "share", "period")


@dataclass(frozen=True)
class Place:
    """A saved state of the rig; `period` [s], `cycles`: see Track."""

    value: float
    state: Saved
    period: float
    cycles: tuple[tuple[float, Array], ...]


class Track:
    """The rig of `scene` with the parameter of `axis` variable. No controllers, no sensors, actuators held.

    `period` [s]: of the cycle that the motion is, else 0. `cycles`: values and states of the last cycles, in the middle
    of stick, with which it was predicted. Raises SceneError if the scene refuses the first value of the axis.
    """

    def __init__(self, scene: Scene, axis: Axis, settings: Settings) -> None:
        self.scene = scene
        self.axis = axis
        self.settings = settings
        self._sliding: dict[float, Steady] = {}
        first = axis.at(scene, axis.values[0]).parameters
        moved = self._assembled(first, {axis.key: "ramped"}).inputs.get(axis.key)
        self._command = moved.state if moved is not None else ""
        self._slope = moved.slope if moved is not None else ""
        self._moved = {axis.key: "ramped"} if self._slope else {}
        self._system = self._assembled(first, self._moved).system()
        self.value, typical = self._typical()
        fastest, self.slowest = typical.time_scales()
        steps = math.ceil(scene.frame_ns * 1e-9 * _SAMPLES / fastest)  # in a frame
        events = math.ceil(scene.clock.events_per_frame * steps / max(steps, 10))  # as many in ten ticks as in a frame
        clock = scene.clock.model_copy(update={"events_per_frame": events})
        self.rig = FreeRig(
            replace(scene, clock=clock, limits={}),  # a motion may settle beyond limits
            self._assembly(self.value),
            self.system(self.value).start,
            step_ns=scene.frame_ns // steps,
            tolerance=min(scene.clock.tolerance, TOLERANCE),
            read=[settings.output],
        )
        self.rig.longest = round(RAMP * self.slowest / self.rig.step)
        self.period = 0.0
        self.cycles: tuple[tuple[float, Array], ...] = ()
        self._stood: tuple[float, FreeRig] | None = None
        self._led: dict[tuple[float, float], tuple[Point, Point, Place]] = {}

    def _typical(self) -> tuple[float, Steady]:
        """Value and steady sliding nearest to the middle of the axis; the middle itself if no value has steady
        sliding.
        """
        values = self.axis.values
        middle = len(values) // 2
        for i in sorted(range(len(values)), key=lambda i: abs(i - middle)):
            with suppress(Singular):
                at = self.sliding(values[i])
                if at.counts:
                    return values[i], at
        return values[middle], self.sliding(values[middle])

    def compile(self) -> None:
        """Compile the kernels that a rig of this shape needs."""
        steady_state.of_window(self.rig, 1)

    def _assembled(self, parameters: Section, moved: Mapping[str, str]) -> Assembly:
        return assembled(parameters, self.scene.frame_ns, moved, random=False, limits=self.scene.limits)

    def _assembly(self, value: float) -> Assembly:
        return self._assembled(self.axis.at(self.scene, value).parameters, self._moved)

    def system(self, value: float) -> System:
        """Return the rig with the parameter at `value`, in its initial state."""
        if not self._slope:
            return self._assembly(value).system()
        start = self._system.start.copy()
        start[self._system.names.index(self._command)] = value
        return replace(self._system, start=start)

    def sliding(self, value: float) -> Steady:
        """Return steady sliding at `value`, with the matrix of small motions about it. Raises rig.errors.Singular."""
        if value not in self._sliding:
            system = self.system(value)
            beside = next(reversed(self._sliding.values()), None)
            if beside is not None and not (beside.exists and self._slope):
                beside = None
            self._sliding[value] = steady(system, sliding_key(system), beside=beside)
        return self._sliding[value]

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
                numbers = [range(len(sector.edges)) for sector in at.system.sectors]
                keys = [at.system.key(patches, normals, limiters, path, thrown) for path in product(*numbers)]
                slidings = [steady(at.system, key) for key in keys]
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
        if abs(swing[p]) <= _STANDS * np.abs(shape).max():  # a mode that moves no contact: give it the same speed
            nq = len(at.system.coordinates)
            swing = shape[nq : 2 * nq]
            p = int(np.abs(swing).argmax())
        speed = float(np.abs(at.speed).max())
        return np.asarray(at.x + (shape * (self.settings.kick * speed / swing[p])).real, dtype=np.float64)

    def far(self, at: Steady) -> Array:
        """Return the standing start: the structure unloaded, every contact moving with its surface."""
        return stuck(at.system, at.x)

    def put(self, value: float, x: Array) -> None:
        """Restart at `value` from state `x`, without memory of the run before."""
        self._go(value)
        self.rig.motion.restart(x)
        self.period = 0.0
        self.cycles = ()

    def _go(self, value: float) -> None:
        if not self._slope and value != self.value:
            assembly = self._assembly(value)
            self.value = value  # the run belongs to this value from here on, even if it has to stop at once
            self.rig = self.rig.replaced(assembly)
        self.value = value

    def here(self) -> Place:
        """Save the present state."""
        return Place(self.value, self.rig.motion.save(), self.period, self.cycles)

    def back(self, place: Place) -> None:
        """Return to a saved state."""
        self._go(place.value)
        self.rig.motion.go_back(place.state)
        self.period = place.period
        self.cycles = place.cycles

    def start(self) -> Start | None:
        """Return the cycle that the motion is as the start of a branch; None if it is none."""
        if not self.period:
            return None
        state = dict(zip(self.rig.system.names, self.rig.motion.x.tolist()))
        return Start(self.value, state, self.period)

    def move(self, value: float) -> None:
        """Move the running rig to `value`. Raises rig.errors.NumericsError if the simulation has to stop."""
        ticks = max(1, round(RAMP * self.slowest / self.rig.step))
        self.period = 0.0
        if self._slope:
            motion = self.rig.motion
            command = self._system.names.index(self._command)
            slope = self._system.names.index(self._slope)
            motion.write(slope, (value - float(motion.x[command])) / (ticks * self.rig.step))
            motion.advance(ticks)
            motion.write(slope, 0.0)
            motion.write(command, value)  # removes rounding: a speed of zero must be exactly zero
        else:
            start = self.value
            for part in range(1, _PARTS + 1):
                self._go(start + (value - start) * (part / _PARTS))
                self.rig.motion.advance(max(1, ticks // _PARTS))
        self.value = value

    def predicted(self, value: float, last: Point) -> Point | None:
        """The point at `value` where the motion soon repeats from a cycle extrapolated from the last ones; else None.

        `last`: the present point. A cycle from which one was predicted that is the present one is known.
        """
        start = self.value
        place = self.here()
        if (start, value) in self._led:
            predicted_there, known, known_place = self._led[start, value]
            if predicted_there.alike(last):
                self.back(known_place)
                return known
        if not self.period or len(self.cycles) < _KEPT:
            return None
        x = self._extrapolated(value)
        try:
            self._go(value)
            self.rig.motion.restart(x)
            point = self._searched(_PATIENCE * self.slowest, _SEEN * self.period)
        except (NumericsError, Singular, UsageError):
            return None
        if not self.period:
            return None
        self._led[value, start] = point, last, place
        return point

    def _extrapolated(self, value: float) -> Array:
        """The state at `value` of the polynomial through the last cycles (Lagrange)."""
        values = [at for at, _ in self.cycles]
        weights = []
        for a in values:
            weights.append(math.prod((value - b) / (a - b) for b in values if b != a))
        x = np.array(weights) @ np.array([state for _, state in self.cycles])
        if self._slope:
            x[self._system.names.index(self._command)] = value
            x[self._system.names.index(self._slope)] = 0.0
        return np.asarray(x)

    def settle(self) -> Point:
        """Simulate until the motion has settled, or until the longest time is over.

        If no longest time is stated, a motion that still drifts is simulated for twice as long.
        """
        turn = self._turn()
        longest = self.settings.longest or max(PERIODS * self.slowest, _LATEST * turn * self.rig.step)
        spent = 0.0
        try:
            for _ in range(1 if self.settings.longest else _ROUNDS):
                point = self._settled(longest, turn)
                spent += point.spent
                if point.state != UNDECIDED:
                    break
                longest *= 2.0
        except NumericsError as error:
            return stopped(error, spent)
        return point._replace(spent=spent)

    def _settled(self, longest: float, turn: int) -> Point:
        """Where the motion settles within `longest` s. `turn` [ticks]: of a surface with sectors."""
        window = max(1, round(WINDOW * self.slowest / self.rig.step))
        if turn:
            return self._watched(max(turn, window), longest, steady_state.over_sectors)
        rig = self._standing()
        if not np.any(rig.system.slip_rows @ rig.settled):
            return self._watched(window, longest, steady_state.standing)
        point = self._searched(0.5 * longest)
        if point.state == UNDECIDED:
            irregular = self._watched(window, 0.5 * longest, partial(steady_state.irregular, kick=self.settings.kick))
            point = irregular._replace(spent=point.spent + irregular.spent)
        return point

    def _searched(self, longest: float, every: float = 0.0) -> Point:
        """Where the motion settles within `longest` s: in a cycle or in sliding. `every` [s]: see Search."""
        rig = self._standing()
        at = self.sliding(self.value)
        settled = Search(rig, at, every, _REPEATS, _PATIENCE * self.slowest).run(longest, math.inf)
        self.period = settled.period
        if self.period:
            window, middle = steady_state.of_cycle(rig, settled.x, self.period)
            if middle is None:
                self.cycles = ()
            else:
                others = [(value, state) for value, state in self.cycles if value != self.value]
                self.cycles = (*others, (self.value, middle))[-_KEPT:]
            return Point(STICK_SLIP if window.share else VIBRATION, window, settled.time)
        self.cycles = ()
        if not settled.rests:
            return Point(UNDECIDED, BLANK, settled.time)
        output = rig.motion.outputs_at(at.x[None], rig.motion.mode_sets_of_states[-1:])
        return Point(SLIDING, steady_state.at_rest(float(output[0, 0])), settled.time)

    def _watched(self, ticks: int, longest: float, judge: Callable[[Sequence[Window], bool], int]) -> Point:
        """The state of a motion from its windows. `judge`: of the windows, and whether the time is over."""
        windows: list[Window] = []
        most = math.ceil(longest / (ticks * self.rig.step))
        state = UNDECIDED
        while state == UNDECIDED and len(windows) < most:
            windows.append(steady_state.of_window(self.rig, ticks))
            state = judge(windows, len(windows) == most)
        return Point(state, windows[-1], len(windows) * ticks * self.rig.step)

    def _standing(self) -> FreeRig:
        """The rig at the present value, whose start is the standing start."""
        if self._stood is None or self._stood[0] != self.value:
            self._stood = self.value, self.rig.driven_by(self.far(self.sliding(self.value)))
        return self._stood[1]

    def _turn(self) -> int:
        """Ticks in which the slowest path over sectors is passed once; 0 without sectors."""
        if not self._system.sectors:
            return 0
        at = self.sliding(self.value)
        rates = [abs(float(sector.row @ (at.modes.A @ at.x))) / sector.period for sector in self._system.sectors]
        slowest = min(rates)
        if not slowest > 0.0:
            return 1
        return min(_ROOM, math.ceil(1.0 / (slowest * self.rig.step)))


class Row:
    """The runs over the values of a unit. `tables` holds their results."""

    def __init__(self, track: Track, unit: Unit) -> None:
        self.track = track
        self.settings = track.settings
        self._runs = unit.runs
        self._curve = unit.curve
        self.x = track.axis.values[unit.first : unit.last]
        self._next = track.axis.values[unit.first : unit.last + unit.curve]  # with the first value of the next part
        self._singular: dict[int, Singular] = {}
        self._sliding = [self._steady(i, value) for i, value in enumerate(self._next)]
        self._near: dict[int, tuple[Point, Place | None]] = {}
        self.branch: Family | None = None  # on which lost vibrations are followed
        shape = (len(RUNS), len(self.x))
        self.tables: Arrays = {
            "state": np.full(shape, NONE, dtype=np.int8),
            **{name: np.full(shape, np.nan) for name in (*OF_WINDOW, "spent")},
            "why": np.full(shape, "", dtype=f"<U{_LONG}"),
            "section": np.full((*shape, self.settings.section), np.nan),
            "end": np.full((2, 2), np.nan),
        }

    def run(self) -> Arrays:
        """Every run of the unit, and its growth rates."""
        asked = self._runs
        if self._curve:
            least = [self.track.least(value, at) for value, at in zip(self._next, self._sliding)]
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
                self._write("near", i, self._at_near(i))
            if "far" in asked:
                self._write("far", i, self._standing(i))
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

    def _tried(self, begin: Callable[[], object]) -> Point:
        """The steady state of a run; one that has to stop records why, and the map continues."""
        try:
            begin()
            return self.track.settle()
        except (NumericsError, Singular, UsageError) as error:
            return stopped(error)

    def _standing(self, i: int) -> Point:
        at = self._sliding[i]
        if at is None:
            return stopped(self._singular[i])
        return self._tried(lambda: self.track.put(self.x[i], self.track.far(at)))

    def _at_near(self, i: int) -> Point:
        """The near start of a point; the rig stays in the state in which it has settled."""
        if i in self._near:
            point, place = self._near[i]
            if place is not None:
                self.track.back(place)
            return point
        at = self._sliding[i]
        if at is None:
            return stopped(self._singular[i])
        if not at.exists:
            return NOTHING
        point = self._tried(lambda: self.track.put(self.x[i], self.track.near(at)))
        self._near[i] = point, None if point.state == STOPPED else self.track.here()
        return point

    def _carry(self, name: str, numbers: Iterable[int], start: Callable[[int], Point]) -> Point:
        """One carried run over the points, which begins with `start` of the first one; return where it ends."""
        point = NOTHING
        for i in numbers:
            sliding = self._sliding[i]
            if point is NOTHING:
                point = start(i)
            elif point.state in (SLIDING, STOPPED) and sliding is not None and sliding.exists:
                point = self._at_near(i)
            elif point.state == STOPPED or sliding is None:  # nothing is left to be carried on
                point = self._standing(i)
            else:
                point = self._step(name, self.x[i], point)
            self._write(name, i, point)
        return point._replace(spent=0.0)

    def _step(self, name: str, to: float, last: Point) -> Point:
        """Move to the next point. The branch of a vibration that is lost on the way is followed to its end.

        Where that cannot be followed, the vibration is carried there again in ever smaller steps: it may be lost
        because the step was too large, and not because it ends.
        """
        place = self.track.here()
        first = self._moved(place, last, to)
        if last.state not in ALIVE or first.state in ALIVE or first.state == STOPPED:
            return first
        lost = self.track.here()
        end = self._followed(place, to)
        if end is not None:
            self.tables["end"][RUNS.index(name)] = end
            self.track.back(lost)
            return first
        dead = to
        gap = 0.5 * (to - place.value)
        least = abs(to - place.value) * 0.5**self.settings.refine
        while abs(gap) > 0.75 * least:
            value = place.value + gap
            if abs(to - value) < 0.5 * least:
                value = to
            point = self._moved(place, last, value)
            if point.state not in ALIVE:
                dead = value
                gap *= 0.5
            elif value == to:
                return point
            else:
                place = self.track.here()
                last = point
        self.tables["end"][RUNS.index(name)] = place.value, dead
        self.track.back(lost)
        return first

    def _moved(self, place: Place, last: Point, to: float) -> Point:
        """The next point after a place: led along its cycle, else carried there."""
        self.track.back(place)
        if (point := self.track.predicted(to, last)) is not None:
            return point
        self.track.back(place)
        return self._tried(lambda: self.track.move(to))

    def _followed(self, place: Place, to: float) -> tuple[float, float] | None:
        """The value at which the branch of a vibration ends before `to`, to both sides of its accuracy.

        None where the vibration is no cycle that can be followed, or goes on beyond.
        """
        self.track.back(place)
        start = self.track.start()
        try:
            self.branch = self.branch or Family(self.track.scene, [self.track.axis])
            end = None if start is None else ends(self.branch, start, to)
        except RigError:
            return None
        return None if end is None else (end.p - end.accuracy, end.p + end.accuracy)

    def _write(self, name: str, i: int, point: Point) -> None:
        at = RUNS.index(name), i
        self.tables["state"][at] = point.state
        self.tables["spent"][at] = point.spent
        self.tables["why"][at] = point.why
        if self.settings.section:
            maxima = point.window.maxima[-self.settings.section :]
            self.tables["section"][*at, : len(maxima)] = maxima
        for column in OF_WINDOW:
            self.tables[column][at] = getattr(point.window, column)

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
    prepare = partial(_prepare, job)
    given_up = partial(failed, job)
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
