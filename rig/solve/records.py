"""The records on which a kernel works: state and scratch of a motion, the log it writes, the plan it follows."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from rig.solve.segments import Segments

Array = NDArray[np.float64]
TICK, KEY, PENDING, EVENTS, SUBDIVIDED, TRIALS, REPEAT, BEYOND, PAST, REACHED, BEGUN, MOST, CROSSED = range(13)
"""Indices of State.ic. Next row of the log | key of the mode set | what has to be done first | events of the block, and
of all blocks before | subdivided ticks | trial steps | repeated events at one instant | first output beyond its bound |
row up to which blocks are done | key at which the search for the contact state began, -1 when it is done | limit of
trial steps for a stretch | guard whose event a leaf has found."""
COUNTERS = CROSSED + 1
PLACE, TRY, HOPED, LENGTH = range(4)
"""Indices of State.fc. Place in the tick, as a share of it | length [s] of the next trial step | length that the error
of the last step suggested | length of the step that a leaf returns."""
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
    both: Array  # [n + inputs]: `at` is its first part, T its last
    at: Array
    rates: Array
    T: Array
    scratch: Array
    swung: Array  # [generator, 2] its states when the block began
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
    """What persists between calls."""

    ic: NDArray[np.int64]  # [COUNTERS]
    fc: Array  # [PLACES]
    x: Array
    energy: Array
    edges: Array  # [1] energy supplied by changes of stiffness at the edges of sectors
    tally: NDArray[np.int64]  # ticks spent in each mode set; the last entry counts all further mode sets
    watched: NDArray[np.int64]  # indices of the outputs that have a bound
    bound: Array  # largest allowed absolute value of each


class Plan(NamedTuple):
    """How a motion is advanced: addresses of code (rig.solve.specialised; 0: not needed), flags (1: yes), settings."""

    carry: int  # the loop over stretches, each in one mode set
    linear: int  # a stretch in a linear mode set, and
    quiet: int  # the leaf for its quiet ticks
    stretch: int  # a stretch in any other mode set, and
    steps: int  # the leaf for its steps
    whole: int  # the derivative, for rigs with more than one patch or with products
    wide: int  # many states: rig.solve.many_states
    bends: int  # at least one mode set is not linear
    fixed: int  # fixed steps: rk4 or kick
    substeps: int  # number of fixed steps in a tick
    tolerance: float  # relative tolerance of dopri5
    with_energy: int  # keep the energy balance
    emitting: int  # write segments for the sensors
    limit: float  # largest allowed absolute value of a state


class Carried(NamedTuple):
    """All these records together, as a motion lends them to a kernel."""

    work: Work
    state: State
    log: Log
    segments: Segments
    plan: Plan
