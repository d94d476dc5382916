"""The memory of a motion: what compiled code reads and writes, and what can be read from it after a call."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from rig.lent_records import Loan
from rig.motion.ready import Integration, Ready
from rig.solve import energy_balance
from rig.solve.advance import TALLIED
from rig.solve.records import (
    BEYOND,
    COUNTERS,
    EVENTS,
    EVENTS_BEFORE,
    KEY,
    PLACES,
    SUBDIVIDED,
    TRIALS,
    MotionRecords,
    MotionState,
    empty_log,
)
from rig.solve.segment_output import empty_segments

Array = NDArray[np.float64]
SEGMENTS, MOST_SEGMENTS = 1 << 10, 1 << 18
"""Room for the smooth segments of a frame, to begin with and at most."""
MOST_EVENTS = 1 << 20
"""Room for the events of a block of many frames, at most."""
COLLECTED = 1 << 12
"""Room for the events of all frames of a call."""


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
    ic: NDArray[np.int64]
    fc: Array
    size: Array


class MotionMemory:
    """State, log and smooth segments of a motion at tick `tick`, lent to compiled code as `loan`.

    `made`: the system with its workspace and plan. `cap`, `frame`, `bounds`: see `rig.motion.motion.Motion`. `kept`:
    number of ticks in the log; `_first`: the first of them that the last call has added. `collects`: keep the events of
    all frames of a call, not only of the last one.
    """

    def __init__(
        self, made: Ready, integration: Integration, cap: int, frame: int, bounds: Mapping[int, float], collects: bool
    ) -> None:
        self.integration, self._cap, self._frame, self._collects = integration, cap, frame, collects
        self.tick = self._first = self.kept = 0
        self.segments = empty_segments(integration.read, SEGMENTS)
        self._take(made)
        self.state = MotionState(
            ic=np.zeros(COUNTERS, dtype=np.int64),
            fc=np.zeros(PLACES),
            x=self.system.start.copy(),
            energy=np.zeros(energy_balance.TERMS),
            edges=np.zeros(1),
            tally=np.zeros(TALLIED, dtype=np.int64),
            watched=np.array(list(bounds), dtype=np.int64),
            bound=np.array(list(bounds.values()), dtype=np.float64),
        )

    def _take(self, made: Ready) -> None:
        """Continue with another system, which `rig.motion.ready` has prepared; the state stays as it is."""
        self.system, self._outputs, self.mode_sets, self.work = made.system, made.outputs, made.mode_sets, made.work
        self.plan, self._event_text, self._now, self._carry = made.plan, made.event_text, made.now, made.carry
        self._evaluate: Callable[..., None] | None = None

    def _make_room(self, rows: int, ticks: int) -> None:
        """Make room for rows of states, and for the events that a block of `ticks` may have."""
        self.log = empty_log(rows, self.system.n)
        self._make_room_for_events(ticks)

    def _make_room_for_events(self, ticks: int) -> None:
        """Make room for the events that a block of `ticks` may have, which may contain many frames."""
        frame = min(self._frame or ticks, ticks)
        usual, most = self._cap * max(1, ticks // 10), self._cap * max(1, frame // 10) * -(-ticks // max(frame, 1))
        events = max(usual, min(most, MOST_EVENTS))
        new = empty_log(0, 0, events, max(COLLECTED, 2 * events) if self._collects else 0)
        self.log = new._replace(out=self.log.out, modes=self.log.modes)
        self._ticks = ticks
        self._lend()

    def _lend(self) -> None:
        self.loan = Loan(MotionRecords(self.work, self.state, self.log, self.segments, self.plan))

    def _more_segments(self) -> None:
        """Double the room for the segments of a frame; existing segments are kept."""
        old, count = self.segments, int(self.segments.count[0])
        self.segments = empty_segments(self.integration.read, 2 * len(old.start))
        self.segments.count[0] = count
        for new, kept in zip(self.segments[1:], old[1:]):
            new[:count] = kept[:count]
        self._lend()

    def save(self) -> Saved:
        """What `go_back` needs to continue from here again."""
        state = self.state
        return Saved(state.x.copy(), state.ic.copy(), state.fc.copy(), self.work.size.copy())

    def go_back(self, saved: Saved) -> None:
        """Return to a saved state of the same system. Energy, ticks and log are not reset."""
        state = self.state
        state.x[:], state.ic[:], state.fc[:] = saved.x, saved.ic, saved.fc
        self.work.size[:] = saved.size

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
            "events": int(ic[EVENTS_BEFORE]),
            "opened_ticks": int(ic[SUBDIVIDED]),
            "trial_steps": int(ic[TRIALS]),
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
        return int(self.state.ic[BEYOND])

    @property
    def event_count(self) -> int:
        """The number of events in the last call of `advance`, or in its last frame if they are not collected."""
        return int(self.log.collected[0] if self._collects else self.state.ic[EVENTS])

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
        log, count = self.log, self.event_count
        events, places = (log.met, log.met_place) if self._collects else (log.event, log.place)
        return self.tick - self.kept, events[:count].copy(), places[:count].copy()
