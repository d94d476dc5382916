"""Writes the outputs that sensors read, segment by segment.

Linear mode sets give Taylor polynomials. A segment is at most half a reciprocal norm long; the error of nine terms is
then 5e-9. (rig.solve.exact writes longer ones in stiff mode sets.) Mode sets with speed-dependent friction give
the quartic through five points of the dense output. A method checks before each step whether the buffers are
`nearly_full`, and stops there until they have been enlarged.

Outputs over one frame as piecewise polynomials: smooth inside each segment, jumps only between segments.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from rig.compiled.kernel import inlined, inner
from rig.solve.column_blocks import copy, is_zero

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


def empty_segments(signals: int, capacity: int) -> Segments:
    """Buffers for `capacity` segments of `signals` outputs."""
    return Segments(
        np.zeros(1, dtype=np.int64),
        np.zeros(capacity),
        np.zeros(capacity),
        np.zeros((capacity, signals, DEGREE + 1)),
    )


@inlined
def nearly_full(t, mode_set, seg, ticks):
    """Whether `seg` may be too small for one more step or tick, with `ticks` ticks left in the block."""
    return seg.count[0] + ticks + t.room[mode_set] + 4 > seg.start.shape[0]


@inner
def emit_linear(t, mode_set, x, start, length, seg, derivatives):
    """Write segments of the outputs over [start, start + length] s from the state x at the start."""
    n = x.shape[0]
    longest = 2.0 * t.step[0] / 2.0 ** t.depth[mode_set]
    pieces = int(length / longest * (1.0 - 1e-12)) + 1
    piece = length / pieces
    copy(n, x, derivatives[0])
    for p in range(pieces):
        at, top = seg.count[0], 0
        while top < DEGREE and not is_zero(derivatives[top]):  # a uniform motion has only two terms
            top += 1
            f = piece / top
            for i in range(n):
                s = 0.0
                for j in range(n):
                    s += t.A[mode_set, i, j] * derivatives[top - 1, j]
                derivatives[top, i] = f * s
        for k in range(top + 1, DEGREE + 1):
            for i in range(n):
                derivatives[k, i] = 0.0
        for s in range(seg.coef.shape[1]):
            coef, signal = seg.coef[at, s], t.signals[mode_set, s]
            for k in range(DEGREE + 1):
                coef[k] = 0.0
            for i in range(n):  # outside, because one sum after the other would wait for each of its additions
                f = signal[i]
                for k in range(DEGREE + 1):
                    coef[k] += f * derivatives[k, i]
        seg.start[at], seg.length[at] = start + p * piece, piece
        seg.count[0] = at + 1
        if p + 1 < pieces:
            for i in range(n):
                s = 0.0
                for k in range(DEGREE + 1):
                    s += derivatives[k, i]
                derivatives[0, i] = s


@inner
def part_of_quartic(coef, begin, width):
    """Replace the coefficients of a quartic by those over the part [begin, begin + width] of its interval."""
    if begin != 0.0:
        c1, c2, c3, c4 = coef[1], coef[2], coef[3], coef[4]
        coef[0] += begin * (c1 + begin * (c2 + begin * (c3 + begin * c4)))
        coef[1] = c1 + begin * (2.0 * c2 + begin * (3.0 * c3 + begin * (4.0 * c4)))
        coef[2] = c2 + begin * (3.0 * c3 + begin * (6.0 * c4))
        coef[3] = c3 + begin * (4.0 * c4)
    if width != 1.0:
        power = 1.0
        for k in range(1, 5):
            power *= width
            coef[k] *= power


@inner
def close_segment(start, length, seg):
    """Complete the segment whose quartics have been written."""
    at = seg.count[0]
    seg.count[0] = at + 1
    for s in range(seg.coef.shape[1]):
        for k in range(5, DEGREE + 1):
            seg.coef[at, s, k] = 0.0
    seg.start[at], seg.length[at] = start, length


@inner
def quartic_coefficients(a, b, c, d, e):
    """The coefficients of the quartic through five equidistant values on [0, 1]."""
    return (
        a,
        (-25.0 * a + 48.0 * b - 36.0 * c + 16.0 * d - 3.0 * e) / 3.0,
        (70.0 * a - 208.0 * b + 228.0 * c - 112.0 * d + 22.0 * e) / 3.0,
        (-80.0 * a + 288.0 * b - 384.0 * c + 224.0 * d - 48.0 * e) / 3.0,
        (32.0 * a - 128.0 * b + 192.0 * c - 128.0 * d + 32.0 * e) / 3.0,
    )
