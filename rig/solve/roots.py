"""Locates the first zero crossing of a polynomial from above.

A guard holds while it is positive. Over a cell or a step it is a polynomial in u in [0, 1]. Its first crossing is
isolated in Bernstein form: if all coefficients are positive, there is none; otherwise de Casteljau's algorithm halves
the interval, the left half first. Safeguarded Newton iterations refine the root. A dip that touches zero counts as a
crossing. A guard that starts at zero and rises, because its mode has just begun, is divided by u first, since the event
at u = 0 has been handled already.
"""

from __future__ import annotations

import numpy as np

from rig.compiled.kernel import inner

DEGREE = 12  # largest degree of a polynomial
NONE = 2.0  # no root in [0, 1]
WORK_ROWS = 48  # intervals that may wait to be halved
WORK_COLUMNS = DEGREE + 3
_FAINT = 1e-10  # share of the sum of coefficients: with this slope at zero a dip is 1e-20 of them, far below rounding
_AT = DEGREE + 1
_WIDTH = DEGREE + 2


def _to_bernstein() -> np.ndarray:
    """Conversion from the power basis to the Bernstein basis, [degree, row, column], padded with zeros."""
    from math import comb

    out = np.zeros((DEGREE + 1, DEGREE + 1, DEGREE + 1))
    for d in range(DEGREE + 1):
        for i in range(d + 1):
            for k in range(i + 1):
                out[d, i, k] = comb(i, k) / comb(d, k)
    return out


BERNSTEIN = _to_bernstein()


@inner
def _value(c, low, degree, u):
    p = c[degree]
    for k in range(degree - 1, low - 1, -1):
        p = p * u + c[k]
    return p


@inner
def _slope(c, low, degree, u):
    p = 0.0
    for k in range(degree, low, -1):
        p = p * u + (k - low) * c[k]
    return p


@inner
def _polish(c, low, degree, a, b):
    """The root in [a, b] with p(a) > 0 >= p(b)."""
    u = 0.5 * (a + b)
    for _ in range(80):
        p = _value(c, low, degree, u)
        if p > 0.0:
            a = u
        else:
            b = u
        d = _slope(c, low, degree, u)
        step = u - p / d if d != 0.0 else 2.0
        if abs(step - u) <= 4e-16 or b - a <= 4e-16:
            return u
        u = step if a < step < b else 0.5 * (a + b)
    return u


@inner
def _split(work, row, d):
    """Split at the middle by de Casteljau: the right half stays in `row`, the left half goes to the next row."""
    work[row + 1, 0] = work[row, 0]
    for level in range(d):
        for i in range(d - level):
            work[row, i] = 0.5 * (work[row, i] + work[row, i + 1])
        work[row + 1, level + 1] = work[row, 0]


@inner
def first_crossing(c, degree, zero, work):
    """The smallest u in [0, 1] at which sum_k c[k] u**k becomes zero or negative; NONE if it stays positive.

    `zero`: up to this value of |c[0]| the guard counts as starting at zero. `work`: float64[WORK_ROWS, WORK_COLUMNS].
    """
    low = 0
    if abs(c[0]) <= zero:
        size = 0.0
        for k in range(1, degree + 1):
            size += abs(c[k])
        if size <= zero:  # the cell is too short to decide; the next one decides
            return NONE
        low = 1
        while low < 3 and low < degree and abs(c[low]) <= max(_FAINT * size, zero):
            low += 1
        if c[low] < 0.0:
            return 0.0
    elif c[0] < 0.0:
        return 0.0
    lowest = c[low]
    for k in range(low + 1, degree + 1):
        lowest += min(c[k], 0.0)
    if lowest > 0.0:
        return NONE
    d = degree - low
    for i in range(d + 1):
        s = 0.0
        for k in range(i + 1):
            s += BERNSTEIN[d, i, k] * c[low + k]
        work[0, i] = s
    work[0, _AT], work[0, _WIDTH] = 0.0, 1.0
    top = 1
    while top > 0:
        top -= 1
        changes = 0
        above = True
        touches = False
        for i in range(d + 1):
            if work[top, i] <= 0.0:
                touches = True
            if (work[top, i] > 0.0) != above:
                changes += 1
                above = not above
        if not touches:
            continue
        at, width = work[top, _AT], work[top, _WIDTH]
        if work[top, 0] <= 0.0:
            return at
        if changes == 1:
            return _polish(c, low, degree, at, at + width)
        if width < 1e-10 or top + 2 >= WORK_ROWS:
            return at + 0.5 * width
        _split(work, top, d)
        work[top, _AT], work[top, _WIDTH] = at + 0.5 * width, 0.5 * width
        work[top + 1, _AT], work[top + 1, _WIDTH] = at, 0.5 * width
        top += 2
    return NONE
