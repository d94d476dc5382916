"""Plant and instruments carried through frames together: one compiled loop.

It goes on while nobody outside has to be asked and ends after a frame at which somebody must look: after an event, an
output beyond its bound, instruments whose random numbers or room are used up. So one frame for a controller that
listens at every tick, and a thousand frames in which nobody listens, are the same code and the same bits.
"""

from __future__ import annotations

from rig.kernel import kernel, lent
from rig.solve.carry import BEYOND, EVENTS, REACHED, carry, start
from rig.solve.settle import DONE, LOOK
from sensors.sampling import SHORT, sample


@kernel
def frames(shape, tables, loan, begin, first, last, wide, tolerance, substeps, booking, emitting, limit, steps, rack):
    """Carry plant and instruments from row `first` of the log up to row `last`, `steps` rows a frame; like `advance`.

    LOOK where it has ended for somebody to look; ic[REACHED] tells how far it came.
    """
    w, state, log, seg = loan.content
    r = rack.content
    t, work, now, written, read, sensors = lent(tables.content), lent(w), lent(state), lent(log), lent(seg), lent(r)
    ic = state.ic
    origin = first if begin else ic[REACHED]
    while True:
        if begin:
            start(t, work, now, read, origin)
        begin = True
        end = min(origin + steps, last)
        status = carry(
            shape, t, work, now, written, read, origin, end, wide, tolerance, substeps, booking, emitting, limit
        )
        if status != DONE or end == origin:
            return status
        sample(sensors, seg)
        origin = end
        if ic[EVENTS] or ic[BEYOND] >= 0 or r.clock[SHORT]:
            return LOOK
        if origin == last:
            return DONE
