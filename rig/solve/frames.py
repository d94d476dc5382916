"""One compiled loop that advances plant, instruments and controllers through many frames.

It runs until the caller has to act, and then ends after a frame: an event that cannot be collected, an output beyond
its bound, exhausted random numbers, a full sample buffer, or an unusual command. A single frame and a thousand frames
without an interruption run the same code and give the same bits.
"""

from __future__ import annotations

from typing import NamedTuple

from rig.compiled.kernel import inlined, kernel
from rig.solve.advance import begin_block
from rig.solve.contact_state import DONE, LOOK
from rig.solve.control_loop import ControllerTables, run_controllers
from rig.solve.forces import RandomNumbers, used_up, write_next_number
from rig.solve.sampling import GATHERED, InstrumentTables, gather_frame, run_instruments
from rig.solve.specialised import any_shape, call

_MANY = 64
"""Segments that are not kept for a further frame: they would not stay in the processor's cache. # chosen"""


class Surroundings(NamedTuple):
    """The records of a frame beside the plant: sensors, compiled controllers, random numbers."""

    instruments: InstrumentTables
    controllers: ControllerTables
    random_numbers: RandomNumbers


@inlined
def collect(log, events):
    """Append the events of a frame to MotionLog.met, if it has rows; whether there is room for another frame's."""
    done, most = log.collected[0], log.met.shape[0]
    if most == 0:
        return False
    for e in range(events):
        for c in range(4):
            log.met[done + e, c] = log.event[e, c]
        log.met_place[done + e] = log.place[e]
    log.collected[0] = done + events
    return done + events + log.event.shape[0] <= most


@inlined
def begin_frame(tables, work, state, seg, instruments, origin):
    """Begin a frame at row `origin` of the log, behind the segments of frames that wait for the instruments."""
    kept = seg.count[0] if instruments.clock[0].waiting else 0
    begin_block(tables, work, state, seg, origin)
    seg.count[0] = kept
    if not kept:
        instruments.begins[0] = 0


@kernel
def advance_frames(tables, loan, begin, first, last, steps, surroundings):
    """Advance plant and instruments from row `first` of the log to row `last`, `steps` rows per frame.

    `surroundings`: Surroundings, lent (rig.compiled.records); its controllers act from the second frame on. The other
    arguments and the status are those of `advance`. Returns LOOK if it ended early because the caller has to act;
    now.reached is the row reached.
    """
    work, state, log, seg, plan = loan.work, loan.state, loan.log, loan.segments, loan.plan
    now, instruments, controllers = state.progress[0], surroundings.instruments, surroundings.controllers
    clock, at_work = instruments.clock[0], controllers.clock[0]
    origin = first if begin else now.reached
    while True:
        if begin:
            if origin > first and not run_controllers(controllers, instruments.latest, state.x):
                return LOOK
            if last > first:
                write_next_number(surroundings.random_numbers, state.x)
            begin_frame(tables, work, state, seg, instruments, origin)
        begin = True
        end = min(origin + steps, last)
        status = call(plan.advance_block, any_shape(state.x.shape[0]), tables, work, state, log, seg, plan, end)
        if status != DONE or end == origin:
            if clock.waiting:
                run_instruments(instruments, seg)
            return status
        gather_frame(instruments, seg)
        origin = end
        at_work.tick += 1
        full = now.events > 0 and not collect(log, now.events)
        acts = full or now.beyond >= 0 or used_up(surroundings.random_numbers)
        waits = clock.waiting < GATHERED and seg.count[0] < _MANY and at_work.count == 0
        if acts or origin == last or not waits:
            run_instruments(instruments, seg)
            if acts or clock.short:
                return LOOK
        if origin == last:
            return DONE
