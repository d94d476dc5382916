"""What the steps of a film read: the tables of the film and of the structure under it, as records."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
TRAVEL, SLID, FIRST, POINTS, DIRECTIONS, DAMPED = range(6)
"""Of Riding.where: states of the travel, of the way slid, of the first force on a coordinate; points; directions; 1 for
a damped film."""
PITCH, LONGEST, STIFFNESS, DAMPING, SHEAR, FRICTIONAL = range(6)
"""Of Riding.numbers."""
GROUP = 5
"""Steps that the sensors are told of together, by one polynomial: at five sixths of a radian a step, which is 66 kHz
and 2 us, it is right to 1 %, where chords leave 9 %."""


class Side(NamedTuple):
    """Coordinates that move both sides of the line of travel alike, or against each other. A lane: of a pair of points
    a direction.
    """

    rows: Array  # [place, coordinate, lane]
    which: NDArray[np.int64]  # [coordinate] number
    rise: Array  # scratch [coordinate, lane] from the place below to the next one
    now: Array  # scratch [coordinate, lane] rows at this instant
    values: Array  # scratch [coordinate]
    felt: Array  # scratch [lane]


class Riding(NamedTuple):
    """Tables of a film and the structure under it, of length zero without one. m: signals that are not the film's."""

    alike: Side
    against: Side
    numbers: Array  # see PITCH
    where: NDArray[np.int64]  # see TRAVEL
    below: NDArray[np.int64]  # scratch [1] the place that the rise begins at; -1: none yet
    share: Array  # scratch [1] of the rise that the rows have now
    places: Array  # [2, point] of the points on the slider
    kick: Array  # [coordinate] h / 2 / mass
    turn: Array  # [4, coordinate] flow of place and velocity over a step, less one
    loss: Array  # [3, coordinate] what the damper takes over a step, of q^2, q v, v^2
    damped: Array  # scratch [coordinate] what it has taken in the stretch so far
    before: Array  # scratch [coordinate]
    pushed: NDArray[np.int64]  # coordinates that signals push
    column: Array  # [pushed, 2, m] what that moves them in a step
    push: Array  # [pushed, m] force
    signal: Array  # [m, m] flow of the signals over a step, less one
    begins: NDArray[np.int64]  # [output + 1] where the entries of one begin
    entry: NDArray[np.int64]  # [entries] state
    value: Array  # [entries]
    summed: NDArray[np.int64]  # [1] 1: the sensors read sums over the points
    seen: Array  # scratch [direction, point] where the points are
    last: Array  # scratch, the step before
    gives: Array  # scratch, forces along the rows
    lost: Array  # scratch [3, point] of the stretch so far: mean friction times travel, times sliding; lost in the film
    moved: Array  # scratch [m]
    begun: Array  # scratch [2, m] signals at the begin of the tick, and how far they have moved since
    held: Array  # scratch [pushed]
    riders: Array  # [rider, point] normal rows of the coordinates whose rows are the same everywhere: the slider's
    advance: Array  # [rider] h^2 / 12 / mass
    ahead: Array  # scratch [rider]
    pressed: Array  # scratch [point]
    fits: Array  # [steps, GROUP + 1, GROUP + 1] coefficients of the polynomial through values at the ends of steps
    values: Array  # scratch [GROUP + 1, read] of these
