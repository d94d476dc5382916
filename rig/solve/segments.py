"""Outputs over one frame as piecewise polynomials: smooth inside each segment, jumps only between segments."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

DEGREE = 8


class Segments(NamedTuple):
    """The outputs over one frame, for the instruments.

    Output j in segment i:  y_j(start[i] + u length[i]) = sum_k coef[i, j, k] u^k,  0 <= u <= 1.

    The first count[0] segments cover the frame without a gap. None straddles a sample step or an event, and none has
    length 0. The arrays are buffers: longer than needed, overwritten in each frame.
    """

    count: NDArray[np.int64]  # type: ignore[assignment]  # [1]; tuple.count is not needed
    start: NDArray[np.float64]  # [capacity], s after the start of the frame
    length: NDArray[np.float64]  # [capacity], s
    coef: NDArray[np.float64]  # [capacity, signals, DEGREE + 1]
