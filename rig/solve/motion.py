"""The motion of a rig: one state, its time and its modes, carried forward tick by tick.

Time is an int64 tick plus the place inside it. What is simulated depends on the ticks at which states are written and
on nothing else: cutting a run into blocks of other sizes gives the same bits for linear mode sets.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from rig.errors import Chatter, Diverged, Jammed, NumericsError
from rig.kernel import bundle, inner, kernel
from rig.solve import dopri5, exact, ledger, rk4
from rig.solve.emit import emit_linear, empty_segments
from rig.solve.formulation import G_LIMIT_LOW, G_OPEN, GUARD_NAMES, System
from rig.solve.roots import DEGREE, WORK_COLUMNS, WORK_ROWS
from rig.solve.segments import Segments
from rig.solve.settle import CHATTER, DONE, JAM, LOST, NEED, READY, SETTLE, START, dot, settle
from rig.solve.slots import Slots

Array = NDArray[np.float64]
METHODS = ("exact", "dopri5", "rk4")
_TICK, _KEY, _PENDING, _EVENTS, _OPENED, _TRIALS, _REPEAT = range(7)
_U, _TRY = range(2)
_FLUSH = 1e-150


class Work(NamedTuple):
    """Scratch of one motion, allocated once."""

    k: Array
    y: Array
    y2: Array
    x0: Array
    copy: Array
    size: Array
    T: Array
    scratch: Array
    derivatives: Array
    spare: Array
    poly: Array
    roots: Array
    g: Array
    values: Array
    nodes: Array
    weights: Array
    nodes5: Array
    weights5: Array


class Log(NamedTuple):
    """What one call writes: states and slots at ticks, events."""

    out: Array  # [tick, n]
    modes: NDArray[np.int64]  # [tick]
    event: NDArray[np.int64]  # [event, 4] tick, guard kind, owner, key before
    place: Array  # [event] place in the tick


class State(NamedTuple):
    """What lives between calls."""

    ic: NDArray[np.int64]
    fc: Array
    x: Array
    energy: Array


@dataclass(frozen=True)
class Event:
    """A change of modes at tick `tick` + `place` (a share of the step)."""

    tick: int
    place: float
    what: str
    before: int


@kernel
def advance(shape, tables, lent, ticks, method, tolerance, substeps, booking, emitting):
    """Carry the state through `ticks` ticks; returns a status, to be called again when a mode set is asked for."""
    w, state, log, seg = lent.content
    return carry(shape, tables.content, w, state, log, seg, ticks, method, tolerance, substeps, booking, emitting)


@inner
def carry(shape, t, w, state, log, seg, ticks, method, tolerance, substeps, booking, emitting):
    """`advance` on borrowed arrays."""
    ic, fc, x, energy = state.ic, state.fc, state.x, state.energy
    n = len(shape)
    while True:
        if ic[_PENDING] != READY:
            status = settle(t, ic, x, w.T, w.scratch, w.copy, ic[_REPEAT] > 1)
            if status != DONE:
                return status
        if ic[_TICK] >= ticks:
            break
        slot = t.slot_of[ic[_KEY]]
        before = ic[_KEY]
        if method == 2:
            guard = rk4.stretch(
                shape, t, slot, ic, fc, x, w, ticks, substeps, log.out, log.modes, energy, booking, emitting, seg
            )
        elif t.falling[slot]:
            guard = dopri5.stretch(
                shape, t, slot, ic, fc, x, w, ticks, log.out, log.modes, energy, booking, emitting, seg, tolerance
            )
            fc[_U] = min(fc[_U], 1.0 - 1.2e-16)
            if guard == -2:
                return LOST
        else:
            guard = -1
            if fc[_U] == 0.0:
                first = ic[_TICK]
                for g in range(t.count[slot]):
                    w.g[g] = dot(t.G[slot, g], x)
                for i in range(n):
                    w.x0[i] = x[i]
                block = 1 if emitting else ticks - first
                done = exact.quiet(
                    shape, t.LP[slot, 0], t.G[slot], t.B[slot], t.count[slot], x, w.g, block, log.out[first:]
                )
                for tick in range(first, first + done):
                    log.modes[tick] = slot
                    start = w.x0 if tick == first else log.out[tick - 1]
                    if booking:
                        ledger.book(t.work[slot, 0], start, energy)
                if emitting and done:
                    emit_linear(t, slot, w.x0, first * t.step[0], t.step[0], seg, w.derivatives)
                ic[_TICK] += done
                if done == block:
                    continue
            ic[_OPENED] += 1
            guard = exact.opened(t, slot, ic, fc, x, w, energy, emitting, seg, ic[_TICK] * t.step[0])
            if guard < 0:
                for i in range(n):
                    log.out[ic[_TICK], i] = x[i]
                log.modes[ic[_TICK]] = slot
                ic[_TICK] += 1
        if guard >= 0:
            e = ic[_EVENTS]
            if e >= log.event.shape[0]:
                return CHATTER
            same = e > 0 and log.event[e - 1, 0] == ic[_TICK] and abs(log.place[e - 1] - fc[_U]) < 1e-12
            ic[_REPEAT] = ic[_REPEAT] + 1 if same else 0
            log.event[e, 0], log.event[e, 1] = ic[_TICK], t.kind[slot, guard]
            log.event[e, 2], log.event[e, 3] = t.owner[slot, guard], before
            log.place[e] = fc[_U]
            ic[_EVENTS] = e + 1
    for i in range(n):
        if abs(x[i]) < _FLUSH:
            x[i] = 0.0
        if not (abs(x[i]) < 1e300):
            return LOST
    return DONE


class Motion:
    """A system in motion. `write` puts a command in force, `advance` carries the state on; both act at `tick`.

    `step_ns`: sample step, the exact method's only step. `signals`: extended rows of the quantities written to
    `segments` for the sensors. `tolerance`: of dopri5, local error relative to each state's size. `substeps`: rk4
    steps in a sample step. `cap`: events allowed in one call. `limit`: largest |state| before the run is stopped.

    Raises Diverged, Jammed, Chatter (rig.errors) with time, mode and state; the state is kept.
    """

    def __init__(
        self,
        system: System,
        step_ns: int,
        method: str = "dopri5",
        signals: list[dict[str, float]] | None = None,
        tolerance: float = 1e-7,
        substeps: int = 1,
        cap: int = 200,
        limit: float = 1e6,
        booking: bool = True,
        longest: int = 1,
    ) -> None:
        if method not in METHODS:
            raise ValueError(f"unknown method {method!r}; known: {', '.join(METHODS)}")
        if method == "exact" and any(not p.law.constant for p in system.patches):
            names = ", ".join(p.name for p in system.patches if not p.law.constant)
            raise ValueError(f"exact needs friction that is constant in slip; {names} depends on speed: use dopri5")
        self.system, self.step_ns, self.method = system, step_ns, method
        self.tolerance, self.substeps, self.limit = tolerance, substeps, limit
        self.booking, self.emitting = booking, bool(signals)
        self.slots = Slots(system, step_ns * 1e-9, signals or [])
        n, P, S = system.n, len(system.patches), len(signals or [])
        guards = self.slots.tables.G.shape[1]
        five = np.polynomial.legendre.leggauss(5)
        self.work = Work(
            k=np.zeros((7, n)),
            y=np.zeros(n),
            y2=np.zeros(n),
            x0=np.zeros(n),
            copy=np.zeros(n),
            size=np.zeros(n),
            T=np.zeros(P),
            scratch=np.zeros((P, P)),
            derivatives=np.zeros((DEGREE + 1, n)),
            spare=np.zeros((DEGREE + 1, n)),
            poly=np.zeros(DEGREE + 1),
            roots=np.zeros((WORK_ROWS, WORK_COLUMNS)),
            g=np.zeros(guards),
            values=np.zeros((5, S)),
            nodes=ledger.NODES,
            weights=ledger.WEIGHTS,
            nodes5=0.5 * (five[0] + 1.0),
            weights5=0.5 * five[1],
        )
        self.state = State(
            ic=np.zeros(8, dtype=np.int64),
            fc=np.array([0.0, step_ns * 1e-9]),
            x=system.start.copy(),
            energy=np.zeros(ledger.TERMS),
        )
        self.state.ic[_PENDING] = START
        self.tick = 0
        self.events_before = 0
        self.segments: Segments = empty_segments(S, 1024)
        self._cap = cap
        self._shape = (0.0,) * n
        self._room(longest)
        self.stored_at_start = ledger.stored(system, self.state.x)
        self._settle()

    def _room(self, ticks: int) -> None:
        n = self.system.n
        self.log = Log(
            out=np.zeros((ticks, n)),
            modes=np.zeros(ticks, dtype=np.int64),
            event=np.zeros((self._cap * max(1, ticks // 10), 4), dtype=np.int64),
            place=np.zeros(self._cap * max(1, ticks // 10)),
        )
        self._lent = bundle((self.work, self.state, self.log, self.segments))

    @property
    def x(self) -> Array:
        """The state now (a view; write through `write`)."""
        return self.state.x

    @property
    def key(self) -> int:
        """The mode set now."""
        return int(self.state.ic[_KEY])

    @property
    def time(self) -> float:
        """Simulated time now [s]."""
        return self.tick * self.step_ns * 1e-9

    @property
    def counts(self) -> dict[str, int]:
        """Events, opened ticks, dopri5 trial steps, mode sets visited."""
        ic = self.state.ic
        return {
            "events": self.events_before,
            "opened_ticks": int(ic[_OPENED]),
            "trial_steps": int(ic[_TRIALS]),
            "mode_sets": len(self.slots.sets),
        }

    def write(self, index: int, value: float) -> None:
        """Put state `index` to `value` now; modes are settled before the next step."""
        self.state.x[index] = value
        self.state.ic[_PENDING] = max(int(self.state.ic[_PENDING]), SETTLE)

    def _settle(self) -> None:
        """Settle the modes at the present instant without moving."""
        self._run(0)

    def advance(self, ticks: int) -> None:
        """Carry the state `ticks` ticks on. `log.out[:ticks]` holds the states, `events()` the events."""
        if ticks > len(self.log.out):
            self._room(ticks)
        ic = self.state.ic
        ic[_TICK] = 0
        ic[_EVENTS] = 0
        ic[_PENDING] = max(int(ic[_PENDING]), SETTLE)
        self.segments.count[0] = 0
        self._run(ticks)
        self.tick += ticks
        self.events_before += int(ic[_EVENTS])

    def _run(self, ticks: int) -> None:
        method = METHODS.index(self.method)
        while True:
            status = advance(
                self._shape,
                self.slots.handle,
                self._lent,
                ticks,
                method,
                self.tolerance,
                self.substeps,
                self.booking,
                self.emitting,
            )
            if status == DONE:
                break
            if status != NEED:
                self._stop(status)
            self.slots.add(self.key)
        count = int(self.segments.count[0])
        if count > len(self.segments.start):
            raise NumericsError(
                f"{count} smooth segments in one block, room for {len(self.segments.start)}", *self._where()
            )
        if ticks and abs(self.state.x).max() > self.limit:
            self._stop(LOST)

    def _where(self) -> tuple[float, str, dict[str, float]]:
        ic, fc = self.state.ic, self.state.fc
        time = (self.tick + int(ic[_TICK]) + float(fc[_U])) * self.step_ns * 1e-9
        return time, self.system.describe(self.key), dict(zip(self.system.names, self.state.x.tolist()))

    def _stop(self, status: int) -> None:
        where = self._where()
        if status == JAM:
            raise Jammed("no contact mode agrees with the equations: jamming (Painleve)", *where)
        if status == CHATTER:
            last = self.log.event[int(self.state.ic[_EVENTS]) - 1]
            raise Chatter(
                f"more than {len(self.log.event)} events in one block; the last: {self.what(int(last[1]), int(last[2]))}. "
                "Raise clock.events_per_frame if this is meant",
                *where,
            )
        raise Diverged(f"the state has left the limit of {self.limit:g} or is not finite", *where)

    def what(self, kind: int, owner: int) -> str:
        """An event in words, e.g. "contact releases +"."""
        if kind >= G_LIMIT_LOW:
            name = self.system.limiters[owner].name
        elif kind >= G_OPEN:
            name = self.system.normals[owner].name
        else:
            name = self.system.patches[owner].name
        return f"{name} {GUARD_NAMES[kind]}"

    def events(self) -> list[Event]:
        """Events of the last call of `advance`."""
        count = int(self.state.ic[_EVENTS])
        first = self.tick - int(self.state.ic[_TICK])
        return [
            Event(first + int(e[0]), float(u), self.what(int(e[1]), int(e[2])), int(e[3]))
            for e, u in zip(self.log.event[:count], self.log.place[:count])
        ]

    def energy(self) -> dict[str, float]:
        """The ledger so far [J], and `error`: what does not close, relative to what was turned over."""
        terms = self.state.energy
        stored = ledger.stored(self.system, self.state.x) - self.stored_at_start
        turned = max(float(np.abs(terms).max()), abs(stored), 1e-30)
        out = dict(zip(ledger.NAMES, terms.tolist()))
        out["stored"] = stored
        out["error"] = (float(terms @ ledger.SIGNS) - stored) / turned
        return out


def rows(motion: Motion, names: list[dict[str, float]]) -> Any:
    """Values of extended rows at the present instant, [row]."""
    from rig.solve.slots import signal_rows

    modes = motion.slots.sets[int(motion.slots.tables.slot_of[motion.key])]
    over_x, over_t = signal_rows(motion.system, modes, names)
    return over_x @ motion.x + over_t @ motion.work.T
