"""One run of a case: the plant with the actions of the case, every step checked."""

from __future__ import annotations

import itertools
import time
from collections.abc import Iterator
from functools import cache
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rig.bench.live.pace import Pacer
from rig.bench.run.exchange import Exchange
from rig.bench.run.journal import Journal
from rig.bench.run.runner import ROWS, PlantRunner
from rig.model.film import at
from rig.model.system import System
from rig.printable import counted
from rig.qualify.torture.case import Act, Case, Watched
from rig.qualify.torture.results import OutOfTime, RunOutcome
from rig.solve.records import OPEN, SLIP_MINUS, STICK

Array = NDArray[np.float64]


CHUNK = 4096
"""Ticks that one call simulates, where the case does not state them."""
KEPT = 20_000
"""Events that are stored individually."""
_TINY = 1e-30  # least scale of a relative number, where everything is zero


class _Left(Exception):
    """The motion has left a limit of its scene, where a run would end."""


class _Leaping:
    """A clock [ns] that is set: it waits for nothing."""

    def __init__(self) -> None:
        self.time = 0

    def now(self) -> int:
        return self.time

    def until(self, deadline: int) -> int:
        self.time = max(self.time, deadline)
        return self.time


class Trial:
    """A case with one method and step. Raises SceneError for an invalid rig, ValueError for a refused method."""

    def __init__(self, case: Case, scene: Watched, until_ns: int, seconds: float) -> None:
        self.case = case
        self.until_ns = until_ns
        self.outcome = RunOutcome()
        self._stop = seconds
        self._begin = time.thread_time()
        self.runner = PlantRunner(scene, piece=ROWS * scene.step_ns // scene.frame_ns)
        self.motion = self.runner.motion
        self._step = self.runner.step_ns
        self._blocks: Iterator[int] = itertools.repeat(CHUNK)
        self._set()
        self._stuck_ticks = 0
        values = self.runner.output_values()
        self.outcome.began = dict(zip(self.runner.outputs, values.tolist()))
        self._exchange: Exchange | None = None
        self._key = self.motion.key
        self._seen = 0
        self._last = 1  # ticks of the last frame

    def _set(self) -> None:
        """Set the columns of the outputs that the invariants check."""
        at = {name: i for i, name in enumerate(self.runner.outputs)}
        self._changes = cache(self._between)
        system = self.motion.system
        self.outcome.with_film = system.film is not None
        self._patches = [(at[f"T:{p.name}"], at[f"w:{p.name}"]) for p in system.patches]  # friction and slip speed
        self._normals = [(at[f"N:{k.name}"], k.patch, k.opens) for k in system.normals]

    def run(self) -> RunOutcome:
        """Simulate the case to its end. Raises NumericsError if it must stop, OutOfTime."""
        outcome = self.outcome
        try:
            for at_ns, act, turn in self._schedule():
                self._carry(at_ns)
                self._act(act, turn)
            self._carry(self.until_ns)
        except _Left as left:
            outcome.notes.append(str(left))
        finally:
            self._look()
            counts = self.motion.counts()
            outcome.trials = counts["trial_steps"]
            outcome.opened = counts["opened_ticks"]
            outcome.ticks = self.motion.tick
            outcome.seconds = time.thread_time() - self._begin
            outcome.stuck = self._stuck_ticks / max(self.motion.tick, 1)
            outcome.measurements = sum(self.runner.bank.counts())
            with np.errstate(over="ignore", invalid="ignore"):  # for a state outside of the range of numbers
                outcome.energy = abs(self.motion.energy()["error"])
            outcome.stuck_now = self._sticks(self.motion.key)
            outcome.ended = dict(zip(self.runner.outputs, self.runner.output_values().tolist()))
        if self._exchange is not None:
            counts = self._exchange.counters()["wild"]
            clauses = [f"{counts[name]} {name.replace('_', ' ')}" for name in ("not_finite", "clamped") if counts[name]]
            outcome.notes.append(f"commands: {', '.join(clauses)}")
        if outcome.held:
            outcome.notes.append(f"a contact that cannot open pulls by {outcome.held:.3g} N")
        return outcome

    def _schedule(self) -> list[tuple[int, Act, int]]:
        """All actions in order of time: (time [ns], act, its repetition)."""
        actions = []
        for act in self.case.acts:
            turns = 1
            if act.do == "follow":
                turns = (self.until_ns - act.at) // act.every
            elif act.do == "command":
                turns = len(act.values)
            for turn in range(turns):
                at = act.at + turn * act.every
                if at < self.until_ns:
                    actions.append((at, act, turn))
        return sorted(actions, key=lambda action: action[0])

    def _act(self, act: Act, turn: int) -> None:
        runner = self.runner
        if act.do == "set" and act.over is not None:
            runner.ramp(act.target, act.to, act.over // self._step)
        elif act.do == "set":
            runner.apply(act.target, act.to)
        elif act.do == "change":
            self._look()
            runner.set_parameter(act.target, act.to)
            self._set()
        elif act.do == "pause":
            self._pause(round(act.to * 1e9))
        elif act.do == "knock":
            runner.knock(act.to)
        elif act.do == "blocks":
            self._blocks = itertools.cycle([int(value) for value in act.values])
        elif act.do == "follow":
            actuator = runner.inputs[act.target]
            wanted = act.to + act.gain * runner.output(act.of)
            runner.apply(act.target, min(max(wanted, actuator.low), actuator.high))
        else:
            self._command(act, turn)

    def _command(self, act: Act, turn: int) -> None:
        if self._exchange is None:
            journal = Journal(self._step, lambda: self.runner.tick)
            self._exchange = Exchange(self.runner, self._step, 1 << 40, journal)
            drives = tuple(self.runner.inputs) if act.target == "*" else (act.target,)
            self._exchange.admit("wild", drives, act.every)
        drives = self._exchange.queues["wild"].drives
        self._exchange.receive("wild", self.runner.tick, (float(act.values[turn]),) * len(drives))
        self._exchange.take_over()

    def _pause(self, length_ns: int) -> None:
        """Pace a second of frames by a clock that jumps after the first of them."""
        clock = _Leaping()
        pacer = Pacer(self._step, 1.0, self.runner.scene.clock.overrun, clock)
        pacer.anchor()
        for frame in range(1_000_000_000 // self._step):
            pacer.wait()
            if frame == 0:
                clock.time += length_ns
            self.outcome.burst += not pacer.waited and frame > 0
            self._carry((self.motion.tick + 1) * self._step)
        self.outcome.notes.append(f"{counted(pacer.frames_given_up, 'frame')} given up, {self.outcome.burst} caught up")

    def _carry(self, until_ns: int) -> None:
        motion = self.motion
        until = until_ns // self._step
        while motion.tick < until:
            if motion.kept >= ROWS - CHUNK:
                self._look()
            ticks = min(next(self._blocks), until - motion.tick)
            kept = motion.kept
            begin = time.thread_time()
            motion.advance(ticks, keep=True)
            self.outcome.carrying += time.thread_time() - begin
            self._last = (motion.kept - kept - 1) % self.runner.steps + 1
            self.runner.tick = motion.tick // self.runner.steps
            bank = self.runner.bank
            self.outcome.not_finite += int(np.count_nonzero(~np.isfinite(bank.latest)))
            if bank.short:
                bank.fill()
            if motion.event_count:
                self._note()
            if motion.beyond >= 0:
                at = motion.tick * self._step * 1e-9
                raise _Left(f"ends at {at:.3g} s: {self.runner.outputs[motion.beyond]} exceeds the limit of its scene")
            if time.thread_time() - self._begin > self._stop:
                raise OutOfTime(self._stop)

    def _note(self) -> None:
        """Record every mode change at the time of its event; two at one time count as two."""
        events = self.motion.events()
        self._settle(events[0].before)
        for event, key in zip(events, [*(e.before for e in events[1:]), self.motion.key]):
            self._change((event.tick + event.place) * self._step * 1e-9, key)
        self._seen = self.motion.kept

    def _settle(self, key: int) -> None:
        """Record mode changes up to mode set `key` at the start of a frame without an event, by a command or a tie."""
        motion = self.motion
        if key == self._key and motion.kept - self._seen <= 1:
            return
        ended = motion.kept - self._last if motion.event_count else motion.kept  # events change modes within a frame
        mode_sets = motion.log.modes[self._seen : max(ended, self._seen)]
        before = motion.mode_sets.tables.mode_set_of[self._key]
        if (mode_sets != before).any():
            for row in np.flatnonzero(np.diff(mode_sets, prepend=before)).tolist():
                began = (motion.tick - motion.kept + self._seen + row) * self._step * 1e-9
                self._change(began, motion.mode_sets.sets[mode_sets[row]].key)
        self._change((motion.tick - self._last) * self._step * 1e-9, key)

    def _change(self, at: float, key: int) -> None:
        """Count what changes with mode set `key`, and store it while there is room."""
        changes = self._changes(self._key, key)
        self._key = key
        self.outcome.count += len(changes)
        if len(self.outcome.events) < KEPT:
            self.outcome.events += [(at, what) for what in changes]

    def _between(self, before: int, after: int) -> tuple[str, ...]:
        """The difference between two mode sets, in words."""
        if before == after:
            return ()
        old, new = ({*self.motion.system.describe(key).split(", ")} for key in (before, after))
        begun = sorted(new - old)
        ended = sorted(f"no longer {state}" for state in old - new)
        return tuple(begun or ended)

    def _sticks(self, key: int) -> bool:
        """Whether every contact sticks; an open one does not."""
        patches, normals, *_ = self.motion.system.modes(key)
        loaded = {k.patch for k, mode in zip(self.motion.system.normals, normals) if mode != OPEN}
        return bool(patches) and all(mode == STICK and p in loaded for p, mode in enumerate(patches))

    def _look(self) -> None:
        """Check the data of every step, and discard it."""
        motion = self.motion
        outcome = self.outcome
        rows = motion.kept
        if not rows:
            return
        self._settle(motion.key)
        states = motion.log.out[:rows]
        mode_sets = motion.log.modes[:rows]
        values = motion.outputs_at(states, mode_sets)
        motion.kept = self._seen = 0
        outcome.not_finite += int(np.count_nonzero(~np.isfinite(states)))
        for name, column in zip(self.runner.outputs, np.abs(values).max(axis=0).tolist()):
            outcome.largest[name] = max(outcome.largest.get(name, 0.0), column)
        keys = [entry.key for entry in motion.mode_sets.sets]
        sticks = np.array([self._sticks(key) for key in keys])
        self._stuck_ticks += int(sticks[mode_sets].sum())
        if motion.system.film is not None:
            look(motion.system, states, outcome)
        load = values[:, [column for column, *_ in self._normals]].sum(axis=1)
        for column, _, opens in self._normals:
            if opens:
                pull = -float(values[:, column].min()) / max(float(np.abs(load).max()), _TINY)
                outcome.pulling = max(outcome.pulling, pull)
        if motion.integration.method == "smooth":
            slips = np.abs(values[:, [slip for _, slip in self._patches]])
            outcome.slips.append(slips.max(axis=1, initial=0.0))
        largest = float(np.abs(states).max())
        for p in range(len(self._patches)):
            self._look_at_patch(p, states, values, mode_sets, keys, largest)

    def _look_at_patch(
        self, p: int, states: Array, values: Array, mode_sets: NDArray[Any], keys: list[int], largest: float
    ) -> None:
        """Check power, cone and creep of a patch; `largest`: of all states."""
        outcome = self.outcome
        system = self.motion.system
        normals = [(column, opens) for column, of, opens in self._normals if of == p]
        T, w = (values[:, column] for column in self._patches[p])
        load = values[:, [column for column, _ in normals]].sum(axis=1)
        if not any(opens for _, opens in normals) and load.min() < 0.0:
            outcome.held = max(outcome.held, -float(load.min()))  # it can pull, and no law says what friction is then
            T = np.where(load < 0.0, 0.0, T)
            load = np.maximum(load, 0.0)
        friction = float(np.abs(T).max())
        speed = float(np.abs(w).max())
        modes = [system.modes(key)[0][p] for key in keys]
        stuck = np.array([mode == STICK for mode in modes])[mode_sets]
        power = np.where(stuck, 0.0, T * w)  # in stick w is rounding, which creep is compared with
        if not system.patches[p].law.presliding:  # bristles give back what they stored
            outcome.negative_power = max(outcome.negative_power, -float(power.min()) / max(friction * speed, _TINY))
        laws = [system.law(p, key) for key in keys]
        static = []
        for law in laws:
            static.append(max(way.static for way in law.directions))
        most = np.array(static)[mode_sets]
        for mode_set, (mode, law) in enumerate(zip(modes, laws)):
            if law.formula is not None and law.states:
                sign = -1.0 if mode == SLIP_MINUS else 1.0
                memory = list(system.patches[p].memory)
                turned = np.array([sign if state.along else 1.0 for state in law.states])
                for i in np.flatnonzero(mode_sets == mode_set).tolist():
                    slip = 0.0 if stuck[i] else max(sign * float(w[i]), 0.0)
                    z = turned * states[i, memory]
                    most[i] = abs(law.formula.evaluate(law.numbers, slip, float(load[i]), z)[0][0])
            elif not law.constant:  # a film bears more the faster it slides
                slips = np.flatnonzero(~stuck & (mode_sets == mode_set))
                most[slips] = np.maximum(law.static, law.over(np.abs(w[slips])))
        outside = float((np.abs(T) - most * np.maximum(load, 0.0)).max())
        outcome.outside_cone = max(outcome.outside_cone, outside / max(friction, _TINY))
        if stuck.any():
            creep = float(np.abs(w[stuck]).max()) / max(speed, largest, _TINY)
            outcome.creep = max(outcome.creep, creep)


def look(system: System, states: Array, outcome: RunOutcome) -> None:
    """Record in `outcome` how far a point pulls or leaves its cone at `states` [state, n], over the largest force."""
    film = system.film
    assert film is not None
    forces = []
    for kept in ("P", "f", "g")[: film.directions]:
        columns = [system.names.index(at(kept, point)) for point in range(film.points)]
        forces.append(states[:, columns])
    normal, *tangential = forces
    friction = np.sqrt(sum(part**2 for part in tangential))
    outcome.pulling = max(outcome.pulling, -float(normal.min()) / max(float(np.abs(normal).max()), _TINY))
    outside = float((friction - film.mu * np.maximum(normal, 0.0)).max())
    outcome.outside_cone = max(outcome.outside_cone, outside / max(float(friction.max()), _TINY))
