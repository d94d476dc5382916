"""What a kernel works on: the state of a motion, its scratch, what it writes down, how it is carried on."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from rig.solve.segments import Segments

Array = NDArray[np.float64]
TICK, KEY, PENDING, EVENTS, OPENED, TRIALS, REPEAT, BEYOND, PAST, REACHED, BEGUN, MOST, FELL = range(13)
"""Of State.ic. Row of the log to be written next | mode set | what settling has to do first | events of the block, and
of all blocks before | ticks that were opened | trial steps | how often the same instant had an event | first output
beyond its bound | row up to which blocks are done | mode set of which settling has begun, -1 when it is done | trials
up to which a stretch may go | guard that a leaf has seen to fall."""
COUNTERS = FELL + 1
PLACE, TRY, HOPED, LENGTH = range(4)
"""Of State.fc. Place in the tick, a share of it | step [s] to try next | that the error of the last one promised | of
the step that a leaf hands over."""
PLACES = LENGTH + 1


class Work(NamedTuple):
    """Scratch of one motion, allocated once."""

    k: Array
    y: Array
    y2: Array
    x0: Array
    copy: Array
    size: Array
    ended: Array  # the state at the end of the block before
    ask: Array
    ask_x: Array
    bear: Array
    bear_x: Array
    both: Array  # [n + inputs]: `at` and T, the first and the last of them
    at: Array
    rates: Array
    T: Array
    scratch: Array
    swung: Array  # [generator, 2] its signals when the block began
    derivatives: Array
    spare: Array
    poly: Array
    roots: Array
    g: Array
    fits: Array
    values: Array
    nodes: Array
    weights: Array
    nodes3: Array
    weights3: Array


class Log(NamedTuple):
    """What one call writes: states and mode sets at ticks, events."""

    out: Array  # [tick, n]
    modes: NDArray[np.int64]  # [tick]
    event: NDArray[np.int64]  # [event, 4] tick, guard kind, owner, key before
    place: Array  # [event] place in the tick


class State(NamedTuple):
    """What lives between calls."""

    ic: NDArray[np.int64]  # [COUNTERS]
    fc: Array  # [PLACES]
    x: Array
    energy: Array
    edges: Array  # [1] energy that came in with the stiffness of new sectors
    tally: NDArray[np.int64]  # ticks spent in each mode set; the last counts all beyond
    watched: NDArray[np.int64]  # outputs that have a bound
    bound: Array  # of their sizes


class Plan(NamedTuple):
    """How a motion is carried on. Addresses of code (rig.solve.specialised) are 0 where none is asked; 1: yes."""

    carry: int  # of the loop over stretches in one mode set
    linear: int  # of a stretch in a linear one, and
    quiet: int  # of the leaf for its quiet ticks
    stretch: int  # of a stretch in any other one, and
    steps: int  # of the leaf for its steps
    whole: int  # of the derivative of rigs with more than one patch, or products
    wide: int  # many states: rig.solve.many_states
    bends: int  # some mode set is not linear
    fixed: int  # steps, of rk4 or kick
    substeps: int  # of fixed steps in a tick
    tolerance: float  # of dopri5
    with_energy: int  # keep the energy balance
    emitting: int  # write segments for the sensors
    limit: float  # of the size of a state


class Carried(NamedTuple):
    """All of this together, as a motion lends it."""

    work: Work
    state: State
    log: Log
    segments: Segments
    plan: Plan
