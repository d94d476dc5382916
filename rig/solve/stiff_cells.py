"""Cells of stiff mode sets: polynomials of outputs and guards over cells in which a Taylor series would not converge.

In a stiff mode set a tick has very many cells, because some states decay within a tiny part of it. As soon as these
states have decayed, everything is smooth again. So outputs and guards are evaluated with the exact propagators at the
Chebyshev-Lobatto places of a cell, [0, PLACES], however long it is. Every second place is a node of a polynomial, the
others check it. A cell is as long as its polynomials are accurate: short after an event, then each is twice as long as
the one before, and a whole tick at last. The number of cells grows with the logarithm of the stiffness.
"""

from __future__ import annotations

from math import comb

import numpy as np
from numpy.typing import NDArray

from rig.kernel import inlined, inner
from rig.solve.many_states import emit_cells
from rig.solve.roots import NONE, first_crossing
from rig.solve.rows import ROUND, dot, rounding
from rig.solve.segment_output import emit_linear
from rig.solve.segments import DEGREE

PLACES = 0.5 - 0.5 * np.cos(np.pi * np.arange(1, 2 * DEGREE + 1) / (2 * DEGREE))
"""In turn a check and a node; the node at the begin of the cell is left out."""
_NEAR = 1e-9  # error of an output at a check, relative to its values at the ends of the cell
_EXACT, _FAINT = 1e-12, 1.0 / 64.0  # error of a guard with which an event is located: of its changes, of its noise
_OFF = 4.0  # safety factor on the error of a guard at the checks: bounds it everywhere


def _lagrange() -> tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.float64]]:
    """What the polynomial makes of the changes from the begin of a cell to its nodes, each [., node].

    Coefficients of u^1 .. u^DEGREE; values at the checks; all Bernstein coefficients.
    """
    nodes = np.concatenate([[0.0], PLACES[1::2]])
    powers, checks = np.zeros((2, DEGREE, DEGREE))
    for i in range(DEGREE):
        others = np.delete(nodes, i + 1)
        powers[:, i] = np.polynomial.polynomial.polyfromroots(others)[1:] / np.prod(nodes[i + 1] - others)
        checks[:, i] = np.prod((PLACES[::2, None] - others) / (nodes[i + 1] - others), axis=1)
    hulls = [[comb(b, k) / comb(DEGREE, k) for k in range(1, DEGREE + 1)] for b in range(DEGREE + 1)]
    return powers, checks, np.array(hulls) @ powers


POWERS, CHECKS, _HULL = _lagrange()


@inlined
def fit(rows, x, change):
    """Write the changes to the nodes, as far as `rows` [place, n] give them; returns the largest error at a check."""
    worst = 0.0
    for i in range(DEGREE):
        change[i] = dot(rows[2 * i + 1], x)
    for c in range(DEGREE):
        off = -dot(rows[2 * c], x)
        for i in range(DEGREE):
            off += CHECKS[c, i] * change[i]
        worst = max(worst, abs(off))
    return worst


@inner
def first_event_of_fits(t, mode_set, level, x, w):
    """The first event of any guard over the cell of step / 2^level from x: its place in it, or NONE, and the guard.

    The guard is -1 without an event, and -2 if a polynomial is not accurate enough to locate one. w.poly and w.roots
    are overwritten. A guard that falls is followed to its zero from any positive value: its terms may be so large
    beside it (the force that holds a body to a surface behind a fast drive) that their rounding error is no small time.
    A change within this error of a guard that is zero or less decides nothing; the next cell decides (rig.solve.roots).
    """
    first, guard, change = NONE, -1, w.roots[0]
    for g in range(t.guards[mode_set]):
        begin, zero = dot(t.G[mode_set, g], x), rounding(t.G[mode_set, g], w.size)
        off, lowest, largest = _OFF * fit(t.along[mode_set, level, g], x, change), begin, 0.0
        for b in range(DEGREE + 1):
            bound = begin
            for i in range(DEGREE):
                bound += _HULL[b, i] * change[i]
            lowest = min(lowest, bound)
        for i in range(DEGREE):
            largest = max(largest, abs(change[i]))
        if lowest > off + zero or (-zero <= begin <= 0.0 and off + largest <= zero):
            continue
        if off > _EXACT * largest + _FAINT * zero:
            return NONE, -2
        w.poly[0] = begin
        for k in range(DEGREE):
            w.poly[k + 1] = 0.0
            for i in range(DEGREE):
                w.poly[k + 1] += POWERS[k, i] * change[i]
        u = first_crossing(w.poly, DEGREE, 0.0 if begin > 0.0 > w.poly[1] else zero, w.roots)
        if u < first:
            first, guard = u, g
    return first, guard


@inner
def fit_outputs(t, mode_set, level, x, seg, w):
    """Write the polynomials of the outputs over the cell of step / 2^level from x to the next segment.

    Returns False if one of them is not accurate. w.poly is overwritten.
    """
    change, guards = w.poly, t.G.shape[1]
    for s in range(seg.coef.shape[1]):
        signal, coef, noise = t.signals[mode_set, s], seg.coef[seg.count[0], s], 0.0
        for j in range(x.shape[0]):
            noise += abs(signal[j]) * max(w.size[j], abs(x[j]))
        coef[0] = dot(signal, x)
        error = fit(t.along[mode_set, level, guards + s], x, change)
        if error > _NEAR * max(abs(coef[0]), abs(coef[0] + change[DEGREE - 1])) + ROUND * noise:
            return False
        for k in range(DEGREE):
            coef[k + 1] = 0.0
            for i in range(DEGREE):
                coef[k + 1] += POWERS[k, i] * change[i]
    return True


@inner
def emit_graded(t, mode_set, x, level, start, seg, w, many_states):
    """Write segments of the outputs over the cell of step / 2^level from x, each as long as its polynomials allow.

    Returns False, writing nothing, if there is too little room. w.y2, w.copy, w.poly, w.derivatives are overwritten.
    """
    n, depth, first = x.shape[0], t.depth[mode_set], seg.count[0]
    here, moved, cells, done = w.y2, w.copy, 1 << (depth - level), 0
    finest = t.step[0] / 2.0**depth
    for i in range(n):
        here[i] = x[i]
    while done < cells:
        at, width = depth, 1
        while width < cells and done % (2 * width) == 0:
            at, width = at - 1, 2 * width
        if seg.count[0] + 1 > seg.start.shape[0]:
            seg.count[0] = first
            return False
        while at < depth and not fit_outputs(t, mode_set, at, here, seg, w):
            at, width = at + 1, width // 2
        if at < depth:
            seg.start[seg.count[0]], seg.length[seg.count[0]] = start + done * finest, width * finest
            seg.count[0] += 1
        elif many_states:
            emit_cells(t, mode_set, here, 1.0, start + done * finest, finest, seg)
        else:
            emit_linear(t, mode_set, here, start + done * finest, finest, seg, w.derivatives)
        done += width
        for i in range(n):
            moved[i] = dot(t.E[mode_set, at, i], here)
        for i in range(n):
            here[i] += moved[i]
    return True


@inlined
def emit_cell(t, mode_set, x, level, start, length, seg, w, many_states):
    """Write the outputs over [start, start + length] s, the cell of step / 2^level from x.

    Returns False, writing nothing, if there is too little room: only in stiff mode sets (`nearly_full`).
    """
    if t.room[mode_set] == 0:
        return emit_graded(t, mode_set, x, level, start, seg, w, many_states)
    if many_states:
        emit_cells(t, mode_set, x, 2.0 ** (t.depth[mode_set] - level), start, length, seg)
    else:
        emit_linear(t, mode_set, x, start, length, seg, w.derivatives)
    return True
