"""The motion of a rig: one state, its time and its contact state, advanced tick by tick.

Time is an int64 tick plus the place inside it. The result depends only on the ticks at which states are written.
Compiled code advances the state; rig.motion.stop says in words why it had to stop.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from rig.compiled.kernel import entry
from rig.compiled.records import Loan
from rig.errors import Jammed, NumericsError
from rig.model.method import FILM_HELPS
from rig.model.mode_sets import MOST_BYTES, ModeSets
from rig.model.singular import singular
from rig.model.system import System
from rig.model.workspace import scales_of_memory
from rig.motion.balance import Balance, CurrentState
from rig.motion.changed_film import follow_change
from rig.motion.law_fault import law_fault
from rig.motion.ready import Integration, Ready, add, build_ahead, carried_state, completed, parts, prepared
from rig.motion.stop import where, why
from rig.solve import energy_balance
from rig.solve.advance import TALLIED, advance, energy_in_contacts, evaluate_outputs
from rig.solve.contact_state import CHECK, DONE, LOOK, LOST, NEED, OVERFULL, START
from rig.solve.frames import advance_frames
from rig.solve.records import PROGRESS, MotionRecords, MotionState, empty_log
from rig.solve.segment_output import empty_segments

Array = NDArray[np.float64]
SEGMENTS = 1 << 10
"""Room for the smooth segments of a frame to begin with."""
MOST_SEGMENTS = 1 << 18
"""Most room for the smooth segments of a frame."""
MOST_EVENTS = 1 << 20
"""Room for the events of a block of many frames, at most."""
_ROOMY = 64  # times as many ticks as a call may have the room that was made for events: new room takes a millisecond
COLLECTED = 1 << 12
"""Room for the events of all frames of a call."""
_COUNTS = sum(kind == np.int64 for kind, *_ in (PROGRESS.fields or {}).values())


@dataclass(frozen=True)
class Event:
    """A change of the contact state at tick `tick` + `place` (a share of the step); `before`: the previous mode set."""

    tick: int
    place: float
    what: str
    before: int


class Saved(NamedTuple):
    """State, counters and places of rig.solve.records.MotionState, and the largest value of each state so far."""

    x: Array
    progress: NDArray[Any]
    size: Array


class Frames(NamedTuple):
    """How a motion is advanced together with instruments and controllers: in frames of `steps` ticks.

    `surroundings`: a rig.solve.frames.Surroundings. An advance may end early, after a frame at which the caller has to
    act. An event is such a case, unless `collects`: then events are collected as long as there is room for them.
    """

    steps: int
    surroundings: Loan
    collects: bool = False


def _kept(state: MotionState) -> dict[str, NDArray[Any]]:
    """Views of the parts of `state` that a checkpoint holds, by name; the others are settings."""
    counts = state.progress.view(np.int64)[:_COUNTS]
    lengths = state.progress.view(np.float64)[_COUNTS:]
    return {"x": state.x, "ic": counts, "fc": lengths} | {
        name: getattr(state, name) for name in ("energy", "edges", "tally")
    }


class Motion:
    """A system in motion. `write` puts a command into force, `advance` advances the state; both act at `tick`.

    `step_ns`: sample step, the only step of the method exact. `outputs`: extended rows (rig.model.assembly) of the
    outputs that `outputs_at` evaluates; the first `read` of them go to `segments`, for the sensors. `tolerance`: of
    dopri5 and rosenbrock, for event times and for local errors relative to the largest value of each state. `substeps`:
    steps of rk4 or kick in a sample step. `smoothing`: of the method smooth [m/s]. `cap`: events allowed in one frame
    (in ten ticks of a longer one). `frame`: ticks of a frame; by default a call is one. `limit`: largest |state|
    allowed. `with_energy`: keep the energy balance. `longest`: ticks of the longest call. `bounds`: largest absolute
    value of outputs, by index; `beyond` then gives the first output that exceeds its bound at the end of a call.
    `frames`: how the motion is advanced together with instruments and controllers, if at all.

    Raises ValueError for a method that does not support the system; while running Diverged, Jammed, Chatter
    (rig.errors) with time, mode and state. The state is kept then.
    """

    def __init__(
        self,
        system: System,
        step_ns: int,
        method: str,
        outputs: list[dict[str, float]] | None = None,
        read: int = 0,
        tolerance: float = 1e-7,
        substeps: int = 1,
        cap: int = 200,
        limit: float = 1e6,
        with_energy: bool = True,
        longest: int = 1,
        bounds: Mapping[int, float] | None = None,
        frames: Frames | None = None,
        smoothing: float = 1e-3,
        frame: int = 0,
    ) -> None:
        loans = () if frames is None else (frames.surroundings,)
        integration = Integration(
            step_ns,
            method,
            float(tolerance),
            int(substeps),
            float(smoothing),
            float(limit),
            bool(with_energy),
            read,
            loans,
        )
        self._kernel: Any = advance if frames is None else advance_frames
        self._more = () if frames is None else frames[:2]
        self._block = None if frames is None else frames.steps
        self._built_ahead = 0
        made = prepared(system, outputs or [], integration)
        frame = self._block or frame
        bounds = bounds or {}
        collects = frames is not None and frames.collects
        self.integration = integration
        self._cap = cap
        self._frame = frame
        self._collects = collects
        self.tick = self._first = self.kept = 0
        self.segments = empty_segments(integration.read, SEGMENTS)
        self.loan: Loan | None = None
        self._take(made)
        self.state = MotionState(
            progress=np.zeros(1, dtype=PROGRESS),
            x=self.system.start.copy(),
            energy=np.zeros(energy_balance.TERMS),
            edges=np.zeros(1),
            tally=np.zeros(TALLIED, dtype=np.int64),
            watched=np.array(list(bounds), dtype=np.int64),
            bound=np.array(list(bounds.values()), dtype=np.float64),
        )
        self._make_room(longest, self._block or longest)
        self.restart(self.system.start)
        self._prepare()

    def _take(self, made: Ready) -> None:
        """Continue with another system, which `rig.motion.ready` has prepared; the state stays as it is."""
        self.system = made.system
        self._outputs = made.outputs
        self.mode_sets = made.mode_sets
        self.work = made.work
        self.plan = made.plan
        self._event_text = made.event_text
        self._now = made.now
        self._carry = made.carry
        self._evaluate: Callable[..., None] | None = None

    def _make_room(self, rows: int, ticks: int) -> None:
        """Make room for rows of states, and for the events that a block of `ticks` may have."""
        self.log = empty_log(rows, self.system.n)
        self._make_room_for_events(ticks)

    def _make_room_for_events(self, ticks: int) -> None:
        """Make room for the events that a block of `ticks` may have, which may contain many frames."""
        frame = min(self._frame or ticks, ticks)
        usual = self._cap * max(1, ticks // 10)
        most = self._cap * max(1, frame // 10) * -(-ticks // max(frame, 1))
        events = max(usual, min(most, MOST_EVENTS))
        new = empty_log(0, 0, events, max(COLLECTED, 2 * events) if self._collects else 0)
        self.log = new._replace(out=self.log.out, modes=self.log.modes)
        self._ticks = ticks
        self._lend()

    def _lend(self) -> None:
        self.loan = Loan(MotionRecords(self.work, self.state, self.log, self.segments, self.plan), self.loan)

    def _more_segments(self) -> None:
        """Double the room for the segments of a frame; existing segments are kept."""
        old = self.segments
        count = int(self.segments.count[0])
        self.segments = empty_segments(self.integration.read, 2 * len(old.start))
        self.segments.count[0] = count
        for new, kept in zip(self.segments[1:], old[1:]):
            new[:count] = kept[:count]
        self._lend()

    def save(self) -> Saved:
        """What `go_back` needs to continue from here again."""
        state = self.state
        return Saved(state.x.copy(), state.progress.copy(), self.work.size.copy())

    def go_back(self, saved: Saved) -> None:
        """Return to a saved state of the same system. Energy, ticks and log are not reset."""
        self.state.x[:], self.state.progress[:], self.work.size[:] = saved

    @property
    def x(self) -> Array:
        """The present state."""
        return self.state.x

    @property
    def key(self) -> int:
        """The key of the present mode set."""
        return int(self.state.progress[0]["key"])

    @property
    def mode_set(self) -> int:
        """The index of the present mode set in the tables."""
        return int(self.mode_sets.tables.mode_set_of[self.key])

    def counts(self) -> dict[str, int]:
        """Ticks, events, subdivided ticks, trial steps of dopri5 and rosenbrock, mode sets visited."""
        now = self.state.progress[0]
        return {
            "ticks": self.tick,
            "events": int(now["events_before"]),
            "opened_ticks": int(now["subdivided"]),
            "trial_steps": int(now["trials"]),
            "mode_sets": len(self.mode_sets.sets),
        }

    def stick_share(self) -> float:
        """The share of the ticks so far in which every loaded patch was stuck."""
        tally = self.state.tally[: len(self.mode_sets.sets)]
        return float(tally[self.mode_sets.sticks[:TALLIED]].sum() / max(int(self.state.tally.sum()), 1))

    @property
    def states(self) -> Array:
        """The states at the ends of the ticks of the last call, [tick, n]."""
        return self.log.out[self._first : self.kept]

    @property
    def mode_sets_of_states(self) -> NDArray[np.int64]:
        """The indices of their mode sets, [tick]."""
        return self.log.modes[self._first : self.kept]

    @property
    def beyond(self) -> int:
        """The index of the first output beyond its bound at the end of the last call; -1 if there is none."""
        return int(self.state.progress[0]["beyond"])

    @property
    def event_count(self) -> int:
        """The number of events in the last call of `advance`, or in its last frame if they are not collected."""
        return int(self.log.collected[0] if self._collects else self.state.progress[0]["events"])

    def events(self) -> list[Event]:
        """The events that `event_count` counts."""
        first, events, places = self.met()
        met = zip(events.tolist(), places.tolist())
        return [
            Event(first + tick, place, self._event_text(kind, owner), before)
            for (tick, kind, owner, before), place in met
        ]

    def met(self) -> tuple[int, NDArray[np.int64], Array]:
        """The events that `event_count` counts as numbers, with ticks counted from the returned first tick.

        Returns first tick; [event, 4] tick, guard kind, owner, key before; [event] places in the tick.
        """
        log = self.log
        count = self.event_count
        events, places = (log.met, log.met_place) if self._collects else (log.event, log.place)
        return self.tick - self.kept, events[:count].copy(), places[:count].copy()

    def restart(self, x: Array) -> None:
        """Start again at tick 0 from state `x` [n], as a new motion. Mode sets already built are kept."""
        state = self.state
        system = self.system
        for part in (state.progress, state.energy, state.edges, state.tally):
            part[:] = 0
        self.work.size[:] = scales_of_memory(system)
        self._search_contacts()
        state.progress["next_length"] = self.integration.step_ns * 1e-9
        state.x[:] = x
        self.mode_sets.collected_energy()
        self.tick = 0
        at_start = system.key([0] * len(system.patches), [0] * len(system.normals), [0] * len(system.limiters))
        self.balance = Balance(CurrentState(system, state.x, at_start), self.integration.with_energy)
        self._run(0, 0)
        self._begun = state.x.copy()

    def _prepare(self) -> None:
        """Build the mode sets of a turn over all sectors or of a switch in advance: a paced run has no time for it."""
        for key in self.system.keys_of_turn(self.key) if self.system.varies else self.system.switched_keys(self.key):
            add(self.mode_sets, key)

    def foresee(self, keys: Iterable[int] = (), most: int = 32) -> None:
        """Build the mode sets `keys` and those that events of the contacts lead to, if there are at most `most`.

        Each takes some milliseconds at its first visit, for which a paced run has no time. From now on `ready` does
        this too.
        """
        self._built_ahead = most
        if build_ahead(self.mode_sets, self.key, keys, most):
            self._complete()

    def _complete(self) -> None:
        """Compile what stiff mode sets need, if it is not compiled yet."""
        plan = completed(self.plan, self.system)
        if plan is not self.plan:
            self.plan = plan
            self._lend()

    def ready(self, system: System, outputs: list[dict[str, float]] | None = None) -> Ready:
        """Prepare another system for `replace`, with the mode sets that this motion has visited.

        The motion itself is not changed, so another thread may call this while the motion advances. Raises ValueError
        if the systems differ in their patches, normal forces or sectors, or if the method does not support the new one.
        """
        new = prepared(system, self._outputs if outputs is None else outputs, self.integration)
        old = self.system
        key = self.key
        if parts(old) != parts(new.system):
            raise ValueError("it changes the contacts of the rig; start a new run with it")
        for known in self.mode_sets.keys:
            add(new.mode_sets, new.system.corresponding_key(old, known))
        stiff = new.mode_sets.stiff
        if self._built_ahead:
            stiff = build_ahead(new.mode_sets, new.system.corresponding_key(old, key), (), self._built_ahead)
        if stiff:
            new = new._replace(plan=completed(new.plan, new.system))
        carry = entry(self._kernel, new.mode_sets.handle, self.loan, True, 0, 0, *self._more)
        return new._replace(carry=carry)

    def write(self, index: int, value: float) -> None:
        """Set state `index` to `value` now. The contact state is checked before the next step.

        The energy that this supplies to the structure counts as an impulse in the energy balance.
        """
        structural = index < 2 * len(self.system.coordinates)
        before = self._current_state().stored() if structural else 0.0
        self.state.x[index] = value
        if structural:
            self.balance.impulses += self._current_state().stored() - before

    def begin(self) -> None:
        """Determine the contact state as at a start, after states were written and before the first step."""
        if self.tick == 0 and (self.state.x.shape != self._begun.shape or (self.state.x != self._begun).any()):
            self._search_contacts()
            self._run(0, 0)
            self._begun = self.state.x.copy()

    def _search_contacts(self) -> None:
        """Let the next call of the kernels determine the contact state as at a start."""
        self.state.progress["pending"] = START
        self.state.progress["search_began_at"] = -1

    def replace(self, ready: Ready) -> None:
        """Continue as another system: states of the same name keep their values, or what the systems name as conserved.

        The contact state is checked again. The change of the stored energy counts as an impulse in the energy balance.
        """
        old = self.system
        before = self._current_state().stored()
        self.terms()  # collect the sums of the mode sets that are dropped
        spent = dict(zip(self.mode_sets.keys, self.state.tally.tolist()))
        x = self.state.x
        key = self.key
        system = ready.system
        sizes = dict(zip(old.names, self.work.size.tolist()))
        self._take(ready)
        self.work.size[:] = [sizes.get(name, 0.0) or least for name, least in zip(system.names, self.work.size)]
        kept = carried_state(system, old, x)
        self.state = self.state._replace(x=kept, tally=np.zeros_like(self.state.tally))
        for visited, ticks in spent.items():
            mode_set = add(self.mode_sets, system.corresponding_key(old, visited))
            self.state.tally[min(mode_set, TALLIED - 1)] += ticks
        if system.n != old.n:
            self.log = self.log._replace(out=np.zeros((len(self.log.out), system.n)))
        step = self.integration.step_ns * 1e-9 / self.integration.substeps
        lost = follow_change(system, self.mode_sets.tables.film, step, old, kept)
        self.state.energy[energy_balance.NAMES.index("friction")] += lost
        self.state.progress["key"] = system.corresponding_key(old, key, kept)
        self.state.progress["pending"] = CHECK
        self.balance.impulses += self._current_state().stored() - before + lost
        self._lend()
        self._run(0, 0)

    def checkpoint(self) -> dict[str, NDArray[Any]]:
        """What `resume` needs, by name; nothing here changes. Empty for the method kick: its tables have a memory too.

        Unlike `save` it holds tick counts, energy balance and mode sets, so that another process can continue from it.
        """
        if self.integration.method == "kick":
            return {}
        kept = {name: part.copy() for name, part in _kept(self.state).items()}
        kept |= {"size": self.work.size.copy(), "ended": self.work.x_at_end.copy()}
        kept |= {"keys": np.array(self.mode_sets.keys, dtype=np.int64), "balance": self.balance.numbers}
        return kept | self.mode_sets.sums()

    def resume(self, saved: Mapping[str, NDArray[Any]], tick: int) -> None:
        """Continue at `tick` from the `checkpoint` of a motion of the same system, with the same bits.

        Raises ValueError for a checkpoint of another system.
        """
        kept = _kept(self.state) | {"size": self.work.size, "ended": self.work.x_at_end}
        for name, array in kept.items():
            if saved[name].shape != array.shape:
                raise ValueError(f"{name} has the shape {saved[name].shape}, not {array.shape}")
        integration = self.integration
        keys = tuple(saved["keys"].tolist())
        if self.mode_sets.keys[: len(keys)] != keys:  # else this motion has built them in this order itself
            implicit = integration.method == "rosenbrock"
            step = integration.step_ns * 1e-9
            self.mode_sets = ModeSets(self.system, step, self._outputs, integration.read, implicit=implicit)
            for key in keys:
                add(self.mode_sets, key)
        self.mode_sets.put_sums(saved)
        for name, array in kept.items():
            array[:] = saved[name]
        self.balance.numbers = saved["balance"]
        self.tick = tick
        self.kept = 0
        self._first = 0
        if not tick:
            self._begun = self.state.x.copy()

    def advance(self, ticks: int, keep: bool = False) -> bool:
        """Advance the state by `ticks` ticks. `states` and `mode_sets_of_states` then hold what was reached.

        `keep`: append to the results of earlier calls; set `kept` to 0 to begin again. Returns True if an advance in
        `frames` ended, perhaps early, after a frame at which the caller has to act.
        """
        first = self.kept if keep else 0
        last = first + ticks
        block = self._block or ticks
        if last > len(self.log.out):
            self._make_room(last, block)
        elif not block <= self._ticks <= _ROOMY * block:
            self._make_room_for_events(block)
        self._first = first
        return self._run(first, last)

    def _run(self, first: int, last: int) -> bool:
        more = self._more
        self.log.collected[0] = 0
        if self._carry is None:
            self._carry = entry(self._kernel, self.mode_sets.handle, self.loan, True, first, last, *more)
        if self.mode_sets.stiff:
            self._complete()
        status = self._carry(self.mode_sets.handle, self.loan, True, first, last, *more)
        while status == NEED or (status == OVERFULL and 2 * len(self.segments.start) <= MOST_SEGMENTS):
            if status == NEED:
                if self.mode_sets.full:
                    self._forget_mode_sets(first)
                try:
                    self.mode_sets.add(self.key)
                except np.linalg.LinAlgError:
                    self._reached(first, int(self.state.progress[0]["reached"]))
                    error = singular(self.system, self.key)
                    raise (Jammed if error.jams else NumericsError)(error.why, *self._where()) from None
                if self.mode_sets.stiff:
                    self._complete()
            else:
                self._more_segments()
            status = self._carry(self.mode_sets.handle, self.loan, False, first, last, *more)
        self._reached(first, last if status == DONE else int(self.state.progress[0]["reached"]))
        if status not in (DONE, LOOK):
            stop, what = why(status, self.system, self.integration, self.state, self.log, len(self.segments.start))
            if status == LOST:
                what = law_fault(self.system, self.key, self.state.x) or what
            raise stop(what, *self._where())
        return status == LOOK  # type: ignore[no-any-return]

    def _forget_mode_sets(self, first: int) -> None:
        """Make room for more mode sets. Those of the states in the log are needed, to evaluate outputs there."""
        self.terms()
        rows = int(self.state.progress[0]["tick"])
        if not self.mode_sets.forget(np.unique(self.log.modes[:rows])):
            self._reached(first, int(self.state.progress[0]["reached"]))
            count = len(self.mode_sets.sets)
            what = f"the {count} mode sets of a single call fill the memory that they may have, {MOST_BYTES >> 20} MB"
            raise NumericsError(f"{what}: {FILM_HELPS}", *self._where())

    def _reached(self, first: int, last: int) -> None:
        self.kept = last
        self.tick += last - first

    def _where(self) -> tuple[float, str, dict[str, float]]:
        now = self.state.progress[0]
        time = (self.tick + int(now["tick"]) - self.kept + float(now["place"])) * self.integration.step_ns * 1e-9
        return time, *where(self.system, self.key, self.state.x)

    def outputs_at(self, states: Array, mode_sets: NDArray[np.int64]) -> Array:
        """Every output [state, output] at `states` [state, n].

        `mode_sets` [state]: index of the mode set in which each is evaluated.
        """
        values = np.empty((len(self._outputs), len(states)))
        self.write_outputs(states, mode_sets, values, 0)
        return values.T

    def write_outputs(self, states: Array, mode_sets: NDArray[np.int64], values: Array, first: int) -> None:
        """Write every output at `states` [state, n] to `values` [output, any number of states], from `first` on."""
        evaluate_outputs(self.mode_sets.handle, self.loan, states, mode_sets, values, first)

    def outputs_now(self) -> Array:
        """Every output [output] at this instant (a view, overwritten by the next call)."""
        states, mode_sets, values = self._now
        states[0] = self.state.x
        mode_sets[0] = self.mode_set
        if self._evaluate is None:
            self._evaluate = entry(evaluate_outputs, self.mode_sets.handle, self.loan, states, mode_sets, values, 0)
        self._evaluate(self.mode_sets.handle, self.loan, states, mode_sets, values, 0)
        return values[:, 0]

    def terms(self) -> Array:
        """The terms of the energy balance so far [J], in the order of rig.solve.energy_balance.NAMES."""
        energy = self.state.energy
        energy += self.mode_sets.collected_energy()
        return energy.copy()

    def energy(self) -> dict[str, float]:
        """The energy balance so far [J]; `error` is its residual relative to the largest term or store.

        With laws with memory what friction took is divided: `bristles` is stored in the contacts now, `heat` the rest.
        """
        terms = self.terms()
        out = self.balance.report(self._current_state(), terms, float(self.state.edges[0]))
        if self.system.remembers:
            out["bristles"] = energy_in_contacts(self.mode_sets.handle, self.loan, self.mode_set)
            out["heat"] = out["friction"] - out["bristles"]
        return out

    def _current_state(self) -> CurrentState:
        return CurrentState(self.system, self.state.x, self.key)
