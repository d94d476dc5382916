"""Writing down, segment by segment, the quantities that the sensors read.

Linear mode sets give Taylor polynomials; a segment is no longer than half a reciprocal norm, where nine terms leave
5e-9. Mode sets with a law over speed give the quartic through five points of the dense output. Who writes asks before
each step whether the buffers are `crowded`, and stops there until they have been enlarged.
"""

from __future__ import annotations

import numpy as np

from rig.kernel import inlined, inner
from rig.solve.segments import DEGREE, Segments


def empty_segments(signals: int, capacity: int) -> Segments:
    """Buffers for `capacity` segments of `signals` quantities."""
    return Segments(
        np.zeros(1, dtype=np.int64),
        np.zeros(capacity),
        np.zeros(capacity),
        np.zeros((capacity, signals, DEGREE + 1)),
    )


@inlined
def crowded(t, mode_set, seg, ticks):
    """Whether `seg` may have no room for what one step or one tick writes, of a block with so many ticks left."""
    return seg.count[0] + ticks + 2 ** t.depth[mode_set] + 4 > seg.start.shape[0]


@inner
def emit_linear(t, mode_set, x, start, length, seg, derivatives):
    """Segments of the signals over [start, start + length] s, from x at the start."""
    n = x.shape[0]
    longest = 2.0 * t.step[0] / 2.0 ** t.depth[mode_set]
    pieces = int(length / longest * (1.0 - 1e-12)) + 1
    piece = length / pieces
    for i in range(n):
        derivatives[0, i] = x[i]
    for p in range(pieces):
        at = seg.count[0]
        for k in range(1, DEGREE + 1):
            f = piece / k
            for i in range(n):
                s = 0.0
                for j in range(n):
                    s += t.A[mode_set, i, j] * derivatives[k - 1, j]
                derivatives[k, i] = f * s
        for s in range(seg.coef.shape[1]):
            for k in range(DEGREE + 1):
                c = 0.0
                for i in range(n):
                    c += t.signals[mode_set, s, i] * derivatives[k, i]
                seg.coef[at, s, k] = c
        seg.start[at], seg.length[at] = start + p * piece, piece
        seg.count[0] = at + 1
        if p + 1 < pieces:
            for i in range(n):
                s = 0.0
                for k in range(DEGREE + 1):
                    s += derivatives[k, i]
                derivatives[0, i] = s


@inner
def emit_quartic(values, start, length, seg):
    """One segment from signal values at u = 0, 1/4, 1/2, 3/4, 1: `values` [5, signal]."""
    for s in range(values.shape[1]):
        through(values, s, seg.coef[seg.count[0], s])
    close(start, length, seg)


@inner
def through(values, s, coef):
    """The quartic through the values of signal s."""
    coef[0], coef[1], coef[2], coef[3], coef[4] = quartic(
        values[0, s], values[1, s], values[2, s], values[3, s], values[4, s]
    )


@inner
def part(coef, begin, width):
    """Coefficients of a quartic over [begin, begin + width] of its interval, in place of those over the whole."""
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
def close(start, length, seg):
    """Close the segment whose quartics are written."""
    at = seg.count[0]
    seg.count[0] = at + 1
    for s in range(seg.coef.shape[1]):
        for k in range(5, DEGREE + 1):
            seg.coef[at, s, k] = 0.0
    seg.start[at], seg.length[at] = start, length


@inner
def emit_chord(begin, end, start, length, seg):
    """One segment from signal values at its ends: straight, for methods of second order."""
    at = seg.count[0]
    seg.count[0] = at + 1
    for s in range(begin.shape[0]):
        seg.coef[at, s, 0], seg.coef[at, s, 1] = begin[s], end[s] - begin[s]
        for k in range(2, DEGREE + 1):
            seg.coef[at, s, k] = 0.0
    seg.start[at], seg.length[at] = start, length


@inner
def quartic(a, b, c, d, e):
    """Coefficients of the quartic through five equidistant values on [0, 1]."""
    return (
        a,
        (-25.0 * a + 48.0 * b - 36.0 * c + 16.0 * d - 3.0 * e) / 3.0,
        (70.0 * a - 208.0 * b + 228.0 * c - 112.0 * d + 22.0 * e) / 3.0,
        (-80.0 * a + 288.0 * b - 384.0 * c + 224.0 * d - 48.0 * e) / 3.0,
        (32.0 * a - 128.0 * b + 192.0 * c - 128.0 * d + 32.0 * e) / 3.0,
    )
