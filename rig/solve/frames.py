"""Plant, instruments and controllers carried through frames together: one compiled loop.

It goes on while nobody outside has to be asked and ends after a frame at which somebody must look: after an event, an
output beyond its bound, random numbers or room for samples that are used up, a command that is not as usual. So one
frame for who listens at every tick, and a thousand frames in which nobody listens, are the same code and the same bits.
"""

from __future__ import annotations

from typing import NamedTuple

from rig.kernel import kernel
from rig.solve.advance import start
from rig.solve.contact_state import DONE, LOOK
from rig.solve.control_loop import NOW, Controls, control
from rig.solve.random_input import Chance, shake, spent
from rig.solve.records import BEYOND, EVENTS, REACHED
from rig.solve.sampling import SHORT, Rack, sample
from rig.solve.specialised import any_shape, call


class Around(NamedTuple):
    """What is around a plant: its instruments, its controllers, chance."""

    rack: Rack
    controls: Controls
    chance: Chance


@kernel
def frames(tables, loan, begin, first, last, steps, around):
    """Carry plant and instruments from row `first` of the log up to row `last`, `steps` rows a frame; like `advance`.

    `around`: Around, lent; its controllers act from the second frame on. LOOK where it has ended for somebody to look;
    ic[REACHED] tells how far it came.
    """
    work, state, log, seg, plan = loan.work, loan.state, loan.log, loan.segments, loan.plan
    ic, rack, controls = state.ic, around.rack, around.controls
    origin = first if begin else ic[REACHED]
    while True:
        if begin:
            if origin > first and not control(controls, rack.latest, state.x):
                return LOOK
            if last > first:
                shake(around.chance, state.x)
            start(tables, work, state, seg, origin)
        begin = True
        end = min(origin + steps, last)
        status = call(plan.carry, any_shape(state.x.shape[0]), tables, work, state, log, seg, plan, end)
        if status != DONE or end == origin:
            return status
        sample(rack, seg)
        origin = end
        controls.clock[NOW] += 1
        if ic[EVENTS] or ic[BEYOND] >= 0 or rack.clock[SHORT] or spent(around.chance):
            return LOOK
        if origin == last:
            return DONE
