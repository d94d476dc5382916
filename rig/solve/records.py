"""The records on which a kernel works: state and scratch of a motion, the log it writes, the plan it follows.

With the codes of contact states and of guards, as mode sets and kernels number them.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from rig.solve.segment_output import Segments

Array = NDArray[np.float64]
SLIP_PLUS, SLIP_MINUS, STICK = range(3)
CLOSED, OPEN = range(2)
LINEAR, LOW, HIGH = range(3)
# kinds of guards: what happens when the guard falls through zero
G_SLIP, G_RELEASE_PLUS, G_RELEASE_MINUS, G_OPEN, G_CLOSE = range(5)
G_LIMIT_LOW, G_LIMIT_HIGH, G_LIMIT_BACK, G_NEXT, G_PREVIOUS = range(5, 10)
GUARD_NAMES = (
    "slip ends",
    "releases +",
    "releases -",
    "opens",
    "closes",
    "clamps low",
    "clamps high",
    "unclamps",
    "enters the next",
    "enters the one before",
)


PROGRESS = np.dtype(
    [
        ("tick", np.int64),  # next row of the log
        ("key", np.int64),  # of the mode set
        ("pending", np.int64),  # what has to be done first (rig.solve.contact_state)
        ("events", np.int64),  # of the block
        ("subdivided", np.int64),  # ticks
        ("trials", np.int64),  # trial steps
        ("repeat", np.int64),  # repeated events at one instant
        ("beyond", np.int64),  # first output beyond its bound; -1: none
        ("events_before", np.int64),  # of all blocks before
        ("reached", np.int64),  # row up to which blocks are done
        ("search_began_at", np.int64),  # key at which the search for the contact state began; -1: it is done
        ("trial_limit", np.int64),  # of a stretch
        ("crossed", np.int64),  # guard whose event a leaf has found
        ("place", np.float64),  # in the tick, as a share of it
        ("next_length", np.float64),  # s, of the next trial step
        ("suggested_length", np.float64),  # s, by the error of the last step
        ("step_length", np.float64),  # s, of the step that a leaf returns
    ],
    align=True,
)
"""How far a motion has come: first the whole numbers, then the others."""


class Workspace(NamedTuple):
    """Scratch memory of one motion, allocated once (rig.model.tables). n: number of states."""

    k: Array  # [7, n padded to whole lanes] derivatives at the stages of a step
    k16: Array  # [16, n padded] the same of dop853, and
    bends: Array  # [4, n padded] sums of them for the error and the path
    y: Array  # [n] state at the end of a step, or at a quadrature node; like y2, at and rates with room for whole lanes
    y2: Array  # [n] state at a stage or at a place within a step
    x0: Array  # [n] state at the begin of a step (rk4) or of a row of quiet ticks (exact)
    copy: Array  # [n] copy of the state for its landing projection
    size: Array  # [n] largest absolute value of each state so far
    x_at_end: Array  # [n] state at the end of the previous block
    law_argument: Array  # [n] argument of the friction law as a row over the state (PatchFriction)
    law_argument_x: Array  # [n] its rate of change as a row over the state
    law_load: Array  # [n] load of the patch as a row over the state
    law_load_x: Array  # [n] its rate of change as a row over the state
    law_argument_p: Array  # [inputs] rates of change of the argument and of the load with each product
    law_load_p: Array  # [inputs]
    at: Array  # [n] state at which `whole_derivative` computes the derivative
    rates: Array  # [n] the derivative at `at`
    T: Array  # [inputs] friction forces and products
    scratch: Array  # [patch, patch] matrix of the equations of coupled friction forces
    generators_at_begin: Array  # [generator, 2] its states at the begin of the block
    derivatives: Array  # [DEGREE + 1, n] coefficients of the state as a polynomial of the place in a step or cell
    spare: Array  # [DEGREE + 1, n] the same for outputs while `derivatives` is in use
    poly: Array  # [DEGREE + 1] coefficients of one guard along a step or cell
    roots: Array  # [WORK_ROWS, WORK_COLUMNS] intervals of the search for a zero crossing (rig.solve.roots)
    g: Array  # [guard] values of the guards at the begin of a tick
    guard_samples: Array  # [guard, 7] of those that depend on inputs: values at six places of a step, rounding bound
    values: Array  # [2, output] outputs that sensors read, at both ends of a segment
    nodes: Array  # [node] quadrature nodes in [0, 1] of the energy terms in a linear mode set
    weights: Array  # [node] weights of `nodes`
    x_at: Array  # [n, LANE] states at several places of a step, in lanes (rig.solve.places)
    T_at: Array  # [inputs, LANE] inputs there
    in_part: Array  # [LANE] five times 1, then 0
    quarters: Array  # [LANE] 0, 1/4, 1/2, 3/4, 1, then 0
    simpson: Array  # [LANE] weights of Simpson's rule at the quarters, for the energy terms of rk4
    probes: Array  # [LANE] the quarters and another place, at which guards that depend on inputs are evaluated
    cell_changes: Array  # [PLACES, n] changes of the states to the places of a cell (rig.solve.collocation)
    cell_inputs: Array  # [PLACES, inputs] and of the inputs
    cell_size: Array  # [n] scales of the states for the errors of the cell
    node_inputs: Array  # [inputs x (DEGREE + 1)] of each input its value at the begin, and its changes to the nodes
    input_powers: Array  # [DEGREE + 1, inputs] coefficients of the inputs as polynomials of the place in the cell
    stages: Array  # [8, n] solutions of the stages of a step of rosenbrock, and their
    matrix: Array  # [n, n] matrix and
    row_order: NDArray[np.int64]  # [n] the order of its rows,
    right: Array  # [n] right-hand side, and
    slopes: Array  # [inputs, n] derivatives of the inputs over the state
    nodes3: Array  # [LANE] five times 0, then three Gauss-Legendre nodes in [0, 1] of the energy terms of dopri5
    weights3: Array  # [LANE] weights of `nodes3`


class MotionLog(NamedTuple):
    """The log that one call writes: states and mode sets at ticks, events."""

    out: Array  # [tick, n]
    modes: NDArray[np.int64]  # [tick]
    event: NDArray[np.int64]  # [event, 4] tick, guard kind, owner, key before
    place: Array  # [event] place in the tick
    met: NDArray[np.int64]  # [all, 4] like `event`, of all frames of a call; no rows: not collected
    met_place: Array  # [all] like `place`
    collected: NDArray[np.int64]  # [1] number of events in `met`


class MotionState(NamedTuple):
    """What persists between calls."""

    progress: NDArray[Any]  # PROGRESS [1]
    x: Array
    energy: Array
    edges: Array  # [1] energy supplied by changes of stiffness at the edges of sectors
    tally: NDArray[np.int64]  # ticks spent in each mode set; the last entry counts all further mode sets
    watched: NDArray[np.int64]  # indices of the outputs that have a bound
    bound: Array  # largest allowed absolute value of each


class MotionPlan(NamedTuple):
    """How a motion is advanced: addresses of code (rig.solve.specialised; 0: not needed), flags (1: yes), settings."""

    advance_block: int  # the loop over stretches, each in one mode set
    make_consistent: int  # the search for the contact state after an event or a command
    linear_stretch: int  # a stretch in a linear mode set, and
    quiet_ticks: int  # the specialised kernels for its quiet ticks
    certified_cell: int  # and for a cell of a subdivided tick
    stretch: int  # a stretch in any other mode set, and
    take_steps: int  # the specialised kernel for its steps
    whole_derivative: int  # the derivative, for rigs with more than one patch or with products,
    inputs_of_state: int  # its inputs,
    raise_to_rounding: int  # the scales after a refused step, and
    input_slopes_of_state: int  # of rosenbrock the slopes of the inputs
    memory_errors: int  # and what laws with memory make of its errors
    take_cell: int  # of stiff mode sets: a cell of dopri5,
    first_event_of_fits: int  # the first event of a cell, and
    emit_graded: int  # its outputs
    degree: int  # of the path through a step: 7 of dop853, 4 of others
    many_states: int  # many states: rig.solve.many_states
    nonlinear: int  # at least one mode set is not linear
    fixed_steps: int  # fixed steps: rk4 or kick
    substeps: int  # number of fixed steps in a tick
    tolerance: float  # relative tolerance of dopri5, dop853 and rosenbrock
    with_energy: int  # keep the energy balance
    emitting: int  # write segments for the sensors
    limit: float  # largest allowed absolute value of a state


class MotionRecords(NamedTuple):
    """All these records together, as a motion lends them to a kernel."""

    work: Workspace
    state: MotionState
    log: MotionLog
    segments: Segments
    plan: MotionPlan


def empty_log(rows: int, n: int, events: int = 0, collected: int = 0) -> MotionLog:
    """A log with room for `rows` ticks of `n` states, `events` in a frame and `collected` in all frames of a call.

    Nothing is read before it is written: to clear the room would take longer than a short motion.
    """
    whole = [np.empty((count, 4), dtype=np.int64) for count in (events, collected)]
    ticks = np.empty(rows, dtype=np.int64)
    none = np.zeros(1, dtype=np.int64)
    return MotionLog(np.empty((rows, n)), ticks, whole[0], np.empty(events), whole[1], np.empty(collected), none)
