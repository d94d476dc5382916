"""The motion of a rig: one state, its time and its contact state, advanced tick by tick.

Time is an int64 tick plus the place inside it. The result depends only on the ticks at which states are written.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from rig.errors import Jammed, NumericsError
from rig.kernel import entry
from rig.lent_records import Loan
from rig.model.singular import singular
from rig.model.system import System
from rig.motion.balance import Balance, Here
from rig.motion.ready import How, Ready, add, foreseen, kept_by, made, parts
from rig.motion.stops import where, why
from rig.solve import energy_balance
from rig.solve.advance import TALLIED, advance, evaluate
from rig.solve.contact_state import CHECK, DONE, LOOK, NEED, OVERFULL, START
from rig.solve.frames import frames as carried_in_frames
from rig.solve.records import (
    BEGUN,
    BEYOND,
    COUNTERS,
    EVENTS,
    KEY,
    PAST,
    PENDING,
    PLACE,
    PLACES,
    REACHED,
    SUBDIVIDED,
    TICK,
    TRIALS,
    TRY,
    Carried,
    Log,
    State,
)
from rig.solve.segment_output import empty_segments

Array = NDArray[np.float64]
SEGMENTS, MOST_SEGMENTS = 1 << 10, 1 << 18
"""Room for the smooth segments of a frame, to begin with and at most."""


class Frames(NamedTuple):
    """How a motion is advanced together with instruments and controllers: in frames of `steps` ticks.

    `around`: a rig.solve.frames.Around. An advance may end early, after a frame at which the caller has to act.
    """

    steps: int
    around: Loan


@dataclass(frozen=True)
class Event:
    """A change of the contact state at tick `tick` + `place` (a share of the step); `before`: the previous mode set."""

    tick: int
    place: float
    what: str
    before: int


class Saved(NamedTuple):
    """State, counters and places of rig.solve.records.State, and the largest value of each state so far."""

    x: Array
    ic: NDArray[np.int64]
    fc: Array
    size: Array


class Motion:
    """A system in motion. `write` puts a command into force, `advance` advances the state; both act at `tick`.

    `step_ns`: sample step, the only step of the method exact. `outputs`: extended rows (rig.model.assembly) of the
    outputs that `outputs_at` evaluates; the first `read` of them go to `segments`, for the sensors. `tolerance`: of
    dopri5, for event times and for local errors relative to the largest value of each state. `substeps`: steps of rk4
    or kick in a sample step. `smoothing`: of the method smooth [m/s]. `cap`: events allowed in one call (in ten ticks
    of a longer one). `limit`: largest |state| allowed. `with_energy`: keep the energy balance. `longest`: ticks of the
    longest call. `bounds`: largest absolute value of outputs, by index; `beyond` then gives the first output that
    exceeds its bound at the end of a call. `frames`: how the motion is advanced together with instruments and
    controllers, if at all.

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
    ) -> None:
        lent = () if frames is None else (frames.around,)
        self.how = How(
            step_ns,
            method,
            float(tolerance),
            int(substeps),
            float(smoothing),
            float(limit),
            bool(with_energy),
            read,
            lent,
        )
        self.tick = 0
        self.segments = empty_segments(read, SEGMENTS)
        self._outputs, self._cap = outputs or [], cap
        self._kernel: Any = advance if frames is None else carried_in_frames
        self._more = frames or ()
        self._block = None if frames is None else frames.steps
        self._first = self.kept = 0
        self._foresees = 0
        self._take(made(system, self._outputs, self.how))
        system = self.system
        self.state = State(
            ic=np.zeros(COUNTERS, dtype=np.int64),
            fc=np.zeros(PLACES),
            x=system.start.copy(),
            energy=np.zeros(energy_balance.TERMS),
            edges=np.zeros(1),
            tally=np.zeros(TALLIED, dtype=np.int64),
            watched=np.array(list(bounds or {}), dtype=np.int64),
            bound=np.array(list((bounds or {}).values()), dtype=np.float64),
        )
        self._room(longest, self._block or longest)
        self.restart(system.start)
        self._prepare()

    def restart(self, x: Array) -> None:
        """Start again at tick 0 from state `x` [n], as a new motion. Mode sets already built are kept."""
        state, system = self.state, self.system
        for part in (state.ic, state.fc, state.energy, state.edges, state.tally, self.work.size):
            part[:] = 0
        state.ic[PENDING], state.ic[BEGUN] = START, -1
        state.fc[TRY] = self.how.step_ns * 1e-9
        state.x[:] = x
        self.mode_sets.take()
        self.tick = 0
        at_start = system.key([0] * len(system.patches), [0] * len(system.normals), [0] * len(system.limiters))
        sprung = self.how.method == "kick" and system.film is None
        self.balance = Balance(Here(system, state.x, at_start, self.mode_sets.tables), sprung)
        self._run(0, 0)
        self._begun = state.x.copy()

    def save(self) -> Saved:
        """What `go_back` needs to continue from here once more."""
        state = self.state
        return Saved(state.x.copy(), state.ic.copy(), state.fc.copy(), self.work.size.copy())

    def go_back(self, saved: Saved) -> None:
        """Return to a saved state of the same system. Energy, ticks and log are not reset."""
        state = self.state
        state.x[:], state.ic[:], state.fc[:] = saved.x, saved.ic, saved.fc
        self.work.size[:] = saved.size

    def _prepare(self) -> None:
        """Build the mode sets of a turn over all sectors or of a switch in advance: a paced run has no time for it."""
        for key in self.system.turn(self.key) if self.system.varies else self.system.thrown(self.key):
            add(self.mode_sets, key)

    def foresee(self, keys: Iterable[int] = (), most: int = 32) -> None:
        """Build the mode sets `keys` and those that events of the contacts lead to, if there are at most `most`.

        Each takes some milliseconds at its first visit, for which a paced run has no time. From now on `ready` does
        this too.
        """
        self._foresees = most
        foreseen(self.mode_sets, self.key, keys, most)

    def _take(self, made: Ready) -> None:
        self.system, self._outputs, self.mode_sets, self.work = made.system, made.outputs, made.mode_sets, made.work
        self.plan, self._told, self._now, self._carry = made.plan, made.told, made.now, made.carry

    def ready(self, system: System, outputs: list[dict[str, float]] | None = None) -> Ready:
        """Prepare another system for `replace`, with the mode sets that this motion has visited.

        The motion itself is not changed, so another thread may call this while the motion advances. Raises ValueError
        if the systems differ in their patches, normal forces or sectors, or if the method does not support the new one.
        """
        new = made(system, self._outputs if outputs is None else outputs, self.how)
        old, key = self.system, self.key
        if parts(old) != parts(new.system):
            raise ValueError("it changes the contacts of the rig; start a new run with it")
        for known in self.mode_sets.keys:
            add(new.mode_sets, new.system.taken_over(old, known))
        if self._foresees:
            foreseen(new.mode_sets, new.system.taken_over(old, key), (), self._foresees)
        carry = entry(self._kernel, new.mode_sets.handle, self.loan, True, 0, 0, *self._more)
        return new._replace(carry=carry)

    def _room(self, rows: int, ticks: int) -> None:
        """Make room for rows of states and for as many events as a block of `ticks` may have."""
        none = np.zeros(0)
        self.log = Log(np.zeros((rows, self.system.n)), np.zeros(rows, dtype=np.int64), none.astype(np.int64), none)
        self._events(ticks)

    def _events(self, ticks: int) -> None:
        events = self._cap * max(1, ticks // 10)
        self.log = self.log._replace(event=np.zeros((events, 4), dtype=np.int64), place=np.zeros(events))
        self._ticks = ticks
        self._lend()

    def _lend(self) -> None:
        self.loan = Loan(Carried(self.work, self.state, self.log, self.segments, self.plan))

    @property
    def x(self) -> Array:
        """The present state."""
        return self.state.x

    @property
    def key(self) -> int:
        """The key of the present mode set."""
        return int(self.state.ic[KEY])

    @property
    def mode_set(self) -> int:
        """The index of the present mode set in the tables."""
        return int(self.mode_sets.tables.mode_set_of[self.key])

    def counts(self) -> dict[str, int]:
        """Ticks, events, subdivided ticks, trial steps of dopri5, mode sets visited."""
        ic = self.state.ic
        return {
            "ticks": self.tick,
            "events": int(ic[PAST]),
            "opened_ticks": int(ic[SUBDIVIDED]),
            "trial_steps": int(ic[TRIALS]),
            "mode_sets": len(self.mode_sets.sets),
        }

    def stick_share(self) -> float:
        """The share of the ticks so far in which every loaded patch was stuck."""
        tally = self.state.tally[: len(self.mode_sets.sets)]
        return float(tally[self.mode_sets.sticks[:TALLIED]].sum() / max(int(self.state.tally.sum()), 1))

    def write(self, index: int, value: float) -> None:
        """Set state `index` to `value` now. The contact state is checked before the next step.

        The energy that this supplies to the structure counts as an impulse in the energy balance.
        """
        balance, before = self.balance, 0.0
        structural = index < 2 * len(self.system.coordinates)
        if balance.sprung:
            balance.pause(self._here())
        if structural:
            before = self._here().stored()
        self.state.x[index] = value
        if structural:
            balance.impulses += self._here().stored() - before
        if balance.sprung:
            balance.go_on(self._here())

    def begin(self) -> None:
        """Determine the contact state as at a start, after states were written and before the first step."""
        if self.tick == 0 and (self.state.x.shape != self._begun.shape or (self.state.x != self._begun).any()):
            self.state.ic[PENDING], self.state.ic[BEGUN] = START, -1
            self._run(0, 0)
            self._begun = self.state.x.copy()

    def replace(self, ready: Ready) -> None:
        """Continue as another system: states of the same name keep their values, or what the systems name as conserved.

        The contact state is checked again. The change of the stored energy counts as an impulse in the energy balance.
        """
        old, balance, before = self.system, self.balance, self._here().stored()
        self.terms()  # collect the sums of the mode sets that are dropped
        balance.pause(self._here())
        spent = dict(zip(self.mode_sets.keys, self.state.tally.tolist()))
        x, key, system = self.state.x, self.key, ready.system
        sizes = dict(zip(old.names, self.work.size.tolist()))
        self._take(ready)
        self.work.size[:] = [sizes.get(name, 0.0) for name in system.names]
        kept = kept_by(system, old, x)
        self.state = self.state._replace(x=kept, tally=np.zeros_like(self.state.tally))
        for visited, ticks in spent.items():
            mode_set = add(self.mode_sets, system.taken_over(old, visited))
            self.state.tally[min(mode_set, TALLIED - 1)] += ticks
        if system.n != old.n:
            self.log = self.log._replace(out=np.zeros((len(self.log.out), system.n)))
        self.state.ic[KEY] = system.taken_over(old, key, kept)
        self.state.ic[PENDING] = CHECK
        balance.impulses += self._here().stored() - before
        balance.go_on(self._here())
        self._lend()
        self._run(0, 0)

    def advance(self, ticks: int, keep: bool = False) -> bool:
        """Advance the state by `ticks` ticks. `states` and `mode_sets_of_states` then hold what was reached.

        `keep`: append to what earlier calls kept; set `kept` to 0 to begin anew. Returns True if an advance in `frames`
        ended, perhaps early, after a frame at which the caller has to act; `events` are then those of this frame.
        """
        first = self.kept if keep else 0
        last = first + ticks
        block = self._block or ticks
        if last > len(self.log.out):
            self._room(last, block)
        elif block != self._ticks:
            self._events(block)
        self._first = first
        return self._run(first, last)

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
        return int(self.state.ic[BEYOND])

    def _run(self, first: int, last: int) -> bool:
        more = self._more
        if self._carry is None:
            self._carry = entry(self._kernel, self.mode_sets.handle, self.loan, True, first, last, *more)
        status = self._carry(self.mode_sets.handle, self.loan, True, first, last, *more)
        while status == NEED or (status == OVERFULL and 2 * len(self.segments.start) <= MOST_SEGMENTS):
            if status == NEED:
                try:
                    self.mode_sets.add(self.key)
                except np.linalg.LinAlgError:
                    self._reached(first, int(self.state.ic[REACHED]))
                    error = singular(self.system, self.key)
                    raise (Jammed if error.jams else NumericsError)(error.why, *self._where()) from None
            else:
                self._more_segments()
            status = self._carry(self.mode_sets.handle, self.loan, False, first, last, *more)
        self._reached(first, last if status == DONE else int(self.state.ic[REACHED]))
        if status not in (DONE, LOOK):
            stop, what = why(status, self.system, self.how, self.state, self.log, len(self.segments.start))
            raise stop(what, *self._where())
        return status == LOOK  # type: ignore[no-any-return]

    def _reached(self, first: int, last: int) -> None:
        self.kept = last
        self.tick += last - first

    def _more_segments(self) -> None:
        """Double the room for the segments of a frame; existing segments are kept."""
        old, count = self.segments, int(self.segments.count[0])
        self.segments = empty_segments(self.how.read, 2 * len(old.start))
        self.segments.count[0] = count
        for new, kept in zip(self.segments[1:], old[1:]):
            new[:count] = kept[:count]
        self._lend()

    def _where(self) -> tuple[float, str, dict[str, float]]:
        ic, fc = self.state.ic, self.state.fc
        time = (self.tick + int(ic[TICK]) - self.kept + float(fc[PLACE])) * self.how.step_ns * 1e-9
        return time, *where(self.system, self.key, self.state.x)

    def events(self) -> list[Event]:
        """The events of the last call of `advance`."""
        first, events, places = self.met()
        met = zip(events.tolist(), places.tolist())
        return [
            Event(first + tick, place, self._told(kind, owner), before) for (tick, kind, owner, before), place in met
        ]

    def met(self) -> tuple[int, NDArray[np.int64], Array]:
        """The events of the last call as numbers, with ticks counted from the returned first tick.

        Returns first tick; [event, 4] tick, guard kind, owner, key before; [event] places in the tick.
        """
        count = self.event_count
        return self.tick - int(self.state.ic[TICK]), self.log.event[:count].copy(), self.log.place[:count].copy()

    def outputs_at(self, states: Array, mode_sets: NDArray[np.int64]) -> Array:
        """Every output [state, output] at `states` [state, n].

        `mode_sets` [state]: index of the mode set in which each is evaluated.
        """
        values = np.zeros((len(states), len(self._outputs)))
        evaluate(self.mode_sets.handle, self.loan, states, mode_sets, values)
        return values

    def outputs_now(self) -> Array:
        """Every output [output] at this instant (a view, overwritten by the next call)."""
        states, mode_sets, values = self._now
        states[0] = self.state.x
        mode_sets[0] = self.mode_sets.tables.mode_set_of[self.state.ic[KEY]]
        evaluate(self.mode_sets.handle, self.loan, states, mode_sets, values)
        return values[0]  # type: ignore[no-any-return]

    @property
    def event_count(self) -> int:
        """The number of events in the last call of `advance`."""
        return int(self.state.ic[EVENTS])

    def terms(self) -> Array:
        """The terms of the energy balance so far [J], in the order of rig.solve.energy_balance.NAMES."""
        energy = self.state.energy
        energy += self.mode_sets.take()
        return energy.copy()

    def residual(self) -> dict[str, float] | None:
        """The energy residual of the contacts under kick (rig.motion.balance); None for other methods."""
        return self.balance.residual(self._here(), self.terms()) if self.balance.sprung else None

    def energy(self) -> dict[str, float]:
        """The energy balance so far [J]; `error` is its residual relative to the largest term or store."""
        terms = self.terms()
        return self.balance.told(self._here(), terms, float(self.state.edges[0]))

    def _here(self) -> Here:
        return Here(self.system, self.state.x, self.key, self.mode_sets.tables)
