"""Plant, instruments and controllers carried through frames together: one compiled loop.

It goes on while nobody outside has to be asked and ends after a frame at which somebody must look: after an event, an
output beyond its bound, instruments whose random numbers or room are used up, a command that is not as usual. So one
frame for who listens at every tick, and a thousand frames in which nobody listens, are the same code and the same bits.
"""

from __future__ import annotations

from rig.kernel import kernel
from rig.solve.carry import start
from rig.solve.control import NOW, control
from rig.solve.leaf import any_shape, call
from rig.solve.records import BEYOND, EVENTS, REACHED
from rig.solve.sampling import SHORT, sample
from rig.solve.settle import DONE, LOOK


@kernel
def frames(tables, loan, begin, first, last, steps, rack, controls):
    """Carry plant and instruments from row `first` of the log up to row `last`, `steps` rows a frame; like `advance`.

    The controllers of `controls` act from the second frame on. LOOK where it has ended for somebody to look;
    ic[REACHED] tells how far it came.
    """
    work, state, log, seg, plan = loan.work, loan.state, loan.log, loan.segments, loan.plan
    ic = state.ic
    origin = first if begin else ic[REACHED]
    while True:
        if begin:
            if origin > first and not control(controls, rack.latest, state.x):
                return LOOK
            start(tables, work, state, seg, origin)
        begin = True
        end = min(origin + steps, last)
        status = call(plan.carry, any_shape(state.x.shape[0]), tables, work, state, log, seg, plan, end)
        if status != DONE or end == origin:
            return status
        sample(rack, seg)
        origin = end
        controls.clock[NOW] += 1
        if ic[EVENTS] or ic[BEYOND] >= 0 or rack.clock[SHORT]:
            return LOOK
        if origin == last:
            return DONE
