"""The rig of one row of a map: started anywhere along the x axis, moved along it, simulated until it has settled.

A commanded quantity on the axis (the speed of a drive, a load) is a state of the rig. It is ramped, no matrix changes,
and all runs of the row share the propagators of their mode sets. Any other parameter changes in a few steps.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from contextlib import suppress
from dataclasses import dataclass, replace
from functools import cached_property
from itertools import product

import numpy as np
from numpy.typing import NDArray

from rig.analysis.axis import Axis
from rig.analysis.cycle import stuck
from rig.analysis.growth_crossings import none
from rig.analysis.map.job import PERIODS, Settings
from rig.analysis.map.steady_state import BLANK, STOPPED, UNDECIDED, Judge, Point, Window, extremes, sticking, stopped
from rig.errors import NumericsError, Singular
from rig.model.assembly import Assembly
from rig.model.method import chosen
from rig.model.system import System
from rig.motion.memory import Saved
from rig.motion.motion import Motion
from rig.quantities import Section
from rig.scenes.rooms import assembled
from rig.scenes.scene import Scene
from rig.solve.records import EVENTS, KEY
from rig.solve.state_codes import CLOSED, STICK
from rig.stability.linearisation import Steady, sliding_key, steady

Array = NDArray[np.float64]
WINDOW = 8.0  # periods of the slowest vibration mode about sliding
RAMP = 16.0  # of these from one point to the next
TOLERANCE = 1e-9
"""Largest tolerance of dopri5: at release the slip speed leaves zero slowly, and an error would make it stick again."""
_PARTS = 4  # steps from one point to the next of a parameter that cannot be ramped
_SAMPLES = 24  # in a period of the fastest vibration mode
_FEW, _MANY = 3, 30  # sticks in a window: with fewer it becomes longer, with more it is shorter for the next point
_LATEST = 20  # turns over sectors
_ROUNDS = 4  # of simulating on, each for twice as long
_ROOM = 200_000  # ticks in a window: a turn of a surface that creeps is simulated in parts


@dataclass(frozen=True)
class Place:
    """A saved state of the rig."""

    value: float
    state: Saved


class Track:
    """The rig of `scene` with the parameter of `axis` variable. No controllers, no sensors, actuators held.

    Raises SceneError if the scene refuses the first value of the axis.
    """

    def __init__(self, scene: Scene, axis: Axis, settings: Settings) -> None:
        self.scene, self.axis, self.settings = scene, axis, settings
        self.value = axis.values[0]
        first = axis.at(scene, self.value).parameters
        one = self._assembled(first, {axis.key: "ramped"}).inputs.get(axis.key)
        self._command = one.state if one is not None else ""
        self._slope = one.slope if one is not None else ""
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
        self._system = self.system(self.value)
        (fastest, self.slowest), frame = typical.time_scales(), scene.frame_ns
        self.step_ns = frame // math.ceil(frame * 1e-9 * _SAMPLES / fastest)
        self.step = self.step_ns * 1e-9
        self._short = max(8, round(WINDOW * self.slowest / self.step))
        self.window_ticks = self._short
        self._held: dict[int, bool] = {}

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
        clock = self.scene.clock
        return Motion(
            self._system,
            self.step_ns,
            chosen(clock.method, self._system),
            outputs=[self._row],
            tolerance=min(clock.tolerance, TOLERANCE),
            substeps=clock.substeps(self.step_ns),
            cap=clock.events_per_frame,
            frame=self.scene.frame_ns // self.step_ns,
            limit=clock.limit,
            with_energy=False,
            longest=self._short,
        )

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
        return steady(system, sliding_key(system))

    def least(self, value: float, at: Steady | None = None) -> tuple[complex, float]:
        """Return the least stable eigenvalue of steady sliding at `value` [1/s], and the growth below which it counts
        as zero.

        Of the least stable sector; nan without steady sliding. `at`: steady sliding there, if it is known.
        """
        try:
            at = at or self.sliding(value)
            found = [at]
            if at.system.sectors:
                patches, normals, limiters, _, thrown = at.system.modes(at.modes.key)
                paths = product(*(range(len(sector.edges)) for sector in at.system.sectors))
                found = [steady(at.system, at.system.key(patches, normals, limiters, path, thrown)) for path in paths]
        except Singular:
            return complex(math.nan, math.nan), 0.0
        rates = [one.eigenvalues() for one in found if one.exists]
        if not rates:
            return complex(math.nan, math.nan), 0.0
        worst = max(rates, key=lambda one: float(one[0].real))
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
        self.window_ticks = self._short

    def _go(self, value: float) -> None:
        if self._slope or value == self.value:
            self.value = value
            return
        ready = self._motion.ready(self.system(value))
        self.value = value  # the run belongs to this value from here on, even if it has to stop at once
        self._motion.replace(ready)

    def here(self) -> Place:
        """Save the present state."""
        return Place(self.value, self._motion.save())

    def back(self, place: Place) -> None:
        """Return to a saved state."""
        self._go(place.value)
        self._motion.go_back(place.state)

    def move(self, value: float) -> None:
        """Move the running rig to `value`. Raises rig.errors.NumericsError if the simulation has to stop."""
        ticks = max(1, round(RAMP * self.slowest / self.step))
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
        begun = self.window_ticks
        longest = self.settings.longest or max(PERIODS * self.slowest, _LATEST * turn * self.step)
        rounds = 1 if self.settings.longest else _ROUNDS
        point = Point(UNDECIDED, BLANK, 0.0)
        for _ in range(rounds):
            judge = Judge(self.settings.kick, near, turn > 0)
            found = self.judged(judge, longest, turn)
            point = found._replace(spent=point.spent + found.spent)
            if point.state != UNDECIDED:
                break
            longest, self.window_ticks = 2.0 * longest, 2 * self.window_ticks
        if point.state in (UNDECIDED, STOPPED):  # no window has fitted: the next point starts with the usual length
            self.window_ticks = begun
        return point

    def judged(self, judge: Judge, longest: float, turn: int) -> Point:
        """Simulate window after window, for at most `longest` s, each at least a whole `turn` [ticks]."""
        window, spent = BLANK, 0.0
        try:
            while spent < longest:
                span = max(self.window_ticks, turn)
                window = self._watch(span)
                spent += span * self.step
                state = judge.take(window)
                if state != UNDECIDED:
                    self._fit(window)
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

    def _fit(self, window: Window) -> None:
        if window.sticks > _MANY or not window.share:
            self.window_ticks = max(self._short, self.window_ticks // 2)

    def _watch(self, ticks: int) -> Window:
        """Simulate one window and return its statistics."""
        motion = self._motion
        motion.advance(ticks)
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
        count = int(motion.state.ic[EVENTS])
        event = motion.log.event[:count]
        times = (event[:, 0] + motion.log.place[:count]) * self.step
        held = np.array([self._sticks(key) for key in event[:, 3].tolist()], dtype=bool)
        s = sticking(times, held, self._sticks(int(motion.state.ic[KEY])), ticks * self.step)
        cycles = values[math.ceil(s.first / self.step) : math.ceil(s.last / self.step)]
        return Window(*extremes(values), float(cycles.std()), travel, swing, s.share, s.begins, s.period, moving)

    def values(self) -> Array:
        """The output at every tick of the last window."""
        motion = self._motion
        if self._plain is not None:
            return np.asarray(motion.states @ self._plain, dtype=np.float64)
        return motion.outputs_at(motion.states, motion.mode_sets_of_states)[:, 0]

    def _sticks(self, key: int) -> bool:
        """Whether a loaded contact sticks in a mode set."""
        if key not in self._held:
            system = self._motion.system
            patches, normals, *_ = system.modes(key)
            loaded = {k.patch for k, mode in zip(system.normals, normals) if mode == CLOSED}
            self._held[key] = any(mode == STICK and p in loaded for p, mode in enumerate(patches))
        return self._held[key]
