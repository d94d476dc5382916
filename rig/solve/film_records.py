"""The tables that the steps of a film read: of the film and of the structure under it."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
TRAVEL, SLID, FIRST, POINTS, DIRECTIONS, DAMPED = range(6)
"""Indices of FilmTables.where: state of the travel; state of the distance slid; first of the states that hold the
forces on the coordinates; number of points; number of directions; 1 for a damped film."""
PITCH, LONGEST, STIFFNESS, DAMPING, SHEAR, FRICTIONAL = range(6)
"""Indices of FilmTables.numbers."""
GROUP = 5
"""Number of steps that one output polynomial covers. At five sixths of a radian per step, which is 66 kHz at 2 us, its
error is 1 %; that of chords is 9 %."""


class SymmetryClass(NamedTuple):
    """Coordinates of one symmetry: they move both sides of the line of travel alike, or in opposite directions.

    A lane is one direction of a pair of mirrored points.
    """

    rows: Array  # [place, coordinate, lane]
    which: NDArray[np.int64]  # [coordinate] number
    rise: Array  # scratch [coordinate, lane] rows at the next place minus rows at the place below
    now: Array  # scratch [coordinate, lane] rows at this instant
    values: Array  # scratch [coordinate]
    felt: Array  # scratch [lane]


class FilmTables(NamedTuple):
    """Tables of a film and of the structure under it; of length zero without a film.

    m: number of driving states, which are neither coordinates nor speeds nor states of the film.
    """

    symmetric: SymmetryClass
    antisymmetric: SymmetryClass
    numbers: Array  # see PITCH
    where: NDArray[np.int64]  # see TRAVEL
    below: NDArray[np.int64]  # scratch [1] the place at which `rise` begins; -1: none yet
    share: Array  # scratch [1] share of `rise` in the present rows
    places: Array  # [2, point] positions of the points on the slider [m]
    kick: Array  # [coordinate] h / 2 / mass
    turn: Array  # [4, coordinate] propagator of position and velocity over a step, minus one
    loss: Array  # [3, coordinate] energy dissipated by the damper over a step: factors of q^2, q v, v^2
    damped: Array  # scratch [coordinate] energy dissipated by the damper since it was last added
    before: Array  # scratch [coordinate]
    pushed: NDArray[np.int64]  # coordinates on which driving states act
    column: Array  # [pushed, 2, m] their change of position and velocity in a step
    push: Array  # [pushed, m] force
    signal: Array  # [m, m] propagator of the driving states over a step, minus one
    begins: NDArray[np.int64]  # [output + 1] index of the first entry of each output
    entry: NDArray[np.int64]  # [entries] state
    value: Array  # [entries]
    summed: NDArray[np.int64]  # [1] 1: sensors read sums over the points
    seen: Array  # scratch [direction, point] positions of the points
    last: Array  # scratch, positions at the previous step
    gives: Array  # scratch, forces at the points along the rows
    lost: Array  # scratch [3, point] work since last added: friction times travel, friction times sliding, film damper
    moved: Array  # scratch [m]
    begun: Array  # scratch [2, m] driving states at the begin of the tick, and their change since
    held: Array  # scratch [pushed]
    slider_rows: Array  # [slider coordinate, point] normal rows of the slider's coordinates: the same at every place
    advance: Array  # [slider coordinate] h^2 / 12 / mass
    ahead: Array  # scratch [slider coordinate]
    pressed: Array  # scratch [point]
    fits: Array  # [steps, GROUP + 1, GROUP + 1] coefficients of the polynomial through values at the ends of steps
    values: Array  # scratch [GROUP + 1, read] outputs at these ends
