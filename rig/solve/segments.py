"""The signals of one frame as piecewise polynomials: smooth inside each segment, jumps only between segments."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

DEGREE = 8


class Segments(NamedTuple):
    """What a frame looked like, for the instruments.

    Signal j in segment i:  y_j(start[i] + u length[i]) = sum_k coef[i, j, k] u^k,  0 <= u <= 1.
    The first count[0] segments tile the frame without a gap, none straddles a sample step or an event, and none has
    the length 0. The arrays are buffers: longer than needed, written anew each frame.
    """

    count: NDArray[np.int64]  # type: ignore[assignment]  # [1]; tuple.count is not needed
    start: NDArray[np.float64]  # [capacity], s after the start of the frame
    length: NDArray[np.float64]  # [capacity], s
    coef: NDArray[np.float64]  # [capacity, signals, DEGREE + 1]
