"""Dormand-Prince 5(4) with dense output and events, for what is not linear: laws over speed in slip, products.

x' = A x + b T(x). Steps are not cut at ticks; the quartic dense output gives the state there. Guards are polynomials
of the dense output and their first fall ends the step. Stick is linear for any law and, without products, is left to
the exact propagator. Signals that swing for ever, such as dither, are put to their exact values after every step. The
law is continued smoothly through w = 0, so the trial step over an event keeps its order.

Source: Dormand and Prince, J. Comp. Appl. Math. 6 (1980) 19; dense output: Hairer, Norsett, Wanner, Solving Ordinary
Differential Equations I, section II.6.
"""

from __future__ import annotations

import numpy as np

from rig.kernel import inlined, inner, local
from rig.solve.books import book, lend_books, read
from rig.solve.dense import at, clear, dense, fall
from rig.solve.emit import crowded, emit_quartic
from rig.solve.forces import forces, lend, rate
from rig.solve.settle import land, passed
from rig.solve.stage import begin, complete, rubbing, stage

_SAFETY, _SHRINK, _GROW = 0.9, 0.2, 5.0
_LEAST = 1e-6  # of the largest coordinate or speed
_MOST = 200_000  # trials for one tick
_SHARE = 0.7  # of the tolerance for the local error, so that event times keep within ten times the tolerance


@inlined
def trial(shape, f, rub, k, x, h, y, z):
    """Stages k[1..6] and the end y of a step h from x, whose k[0] is known; z is scratch."""
    n = len(shape)
    for i in range(n):
        z[i] = x[i]
    late = stage(shape, f, rub, h * (1.0 / 5.0), z, k, 0, begin(shape, rub, k))
    for i in range(n):
        z[i] = x[i] + h * ((3.0 / 40.0) * k[0, i])
    late = stage(shape, f, rub, h * (9.0 / 40.0), z, k, 1, late)
    for i in range(n):
        z[i] = x[i] + h * ((44.0 / 45.0) * k[0, i] - (56.0 / 15.0) * k[1, i])
    late = stage(shape, f, rub, h * (32.0 / 9.0), z, k, 2, late)
    for i in range(n):
        z[i] = x[i] + h * ((19372.0 / 6561.0) * k[0, i] - (25360.0 / 2187.0) * k[1, i] + (64448.0 / 6561.0) * k[2, i])
    late = stage(shape, f, rub, -(h * (212.0 / 729.0)), z, k, 3, late)
    for i in range(n):
        z[i] = x[i] + h * (
            (9017.0 / 3168.0) * k[0, i]
            - (355.0 / 33.0) * k[1, i]
            + (46732.0 / 5247.0) * k[2, i]
            + (49.0 / 176.0) * k[3, i]
        )
    late = stage(shape, f, rub, -(h * (5103.0 / 18656.0)), z, k, 4, late)
    for i in range(n):
        y[i] = x[i] + h * (
            (35.0 / 384.0) * k[0, i]
            + (500.0 / 1113.0) * k[2, i]
            + (125.0 / 192.0) * k[3, i]
            - (2187.0 / 6784.0) * k[4, i]
        )
    late = stage(shape, f, rub, h * (11.0 / 84.0), y, k, 5, late)
    complete(shape, f, rub, k, 6, late)


@inlined
def error(shape, k, y, size, h, tolerance):
    """Largest local error of the step, each state against `tolerance` times its largest size so far.

    Infinite where a stage has left the range of numbers: a law continued far below w = 0 grows without bound, and the
    step must shrink then, not pass for one without error.
    """
    n = len(shape)
    worst = 0.0
    for i in range(n):
        e = (
            h
            * (
                k[0, i] * (71.0 / 57600.0)
                - k[2, i] * (71.0 / 16695.0)
                + k[3, i] * (71.0 / 1920.0)
                - k[4, i] * (17253.0 / 339200.0)
                + k[5, i] * (22.0 / 525.0)
            )
            - (h * (1.0 / 40.0)) * k[6, i]
        )
        if not (abs(e) + abs(y[i]) < np.inf):
            return np.inf
        largest = max(size[i], abs(y[i]))
        if largest > 0.0:
            worst = max(worst, abs(e) * (1.0 / (_SHARE * tolerance * largest)))
    return worst


@inlined
def growth(e):
    """0.9 e^(-1/5) for 0 <= e <= 1, at most `_GROW`: by a cubic within 3 % of it where the step is about right.

    The next step waits for it, and a power takes as long as a stage.
    """
    if e < 0.1:
        return min(_GROW, _SAFETY * e ** (-0.2))
    return (1.6 - 2.3 * e) + (e * e) * (2.9 - 1.3 * e)


@inner
def alike(rates, count, step, size):
    """Coordinates, and speeds, that are next to nothing beside the largest of them are judged by a share of that.

    What only rounding moves, such as a mode of a plate that is in equilibrium, has an error as large as itself.
    """
    for first in (0, count):
        top = 0.0
        for i in range(first, first + count):
            top = max(top, size[i], step * abs(rates[i]))
        for i in range(first, first + count):
            size[i] = max(size[i], _LEAST * top)


@inner
def book_step(shape, f, b, d, theta, h, z, nodes, weights, energy):
    """Energy up to `theta` of the step, by Gauss-Legendre."""
    for q in range(nodes.shape[0]):
        at(shape, d, nodes[q] * theta, z)
        forces(f, z)
        book(b, z, weights[q] * theta * h, energy)


@inner
def emit(shape, f, b, d, from_theta, to_theta, h, z, values, start, seg):
    """One segment of the signals between two instants of the step."""
    for q in range(5):
        at(shape, d, from_theta + 0.25 * q * (to_theta - from_theta), z)
        forces(f, z)
        read(b, z, values[q])
    emit_quartic(values, start, (to_theta - from_theta) * h, seg)


@inlined
def swing(shape, t, w, time, x):
    """Put the generators among the signals of x to their exact values, `time` [s] after the block began.

    Nothing damps them: the errors of the steps would add up, in amplitude and in phase. Every index of x is a constant
    of the compiled code, so that x stays in registers.
    """
    for g in range(t.swing.shape[0]):
        turn = t.swing_rate[g] * time
        sine, cosine = np.sin(turn), np.cos(turn)
        a, b = w.swung[g, 0], w.swung[g, 1]
        for i in range(len(shape)):
            if i == t.swing[g, 0]:
                x[i] = cosine * a + sine * b
            elif i == t.swing[g, 1]:
                x[i] = cosine * b - sine * a


@inner
def stretch(shape, t, slot, ic, fc, x, w, origin, ticks, out, modes, energy, booking, emitting, seg, tolerance):
    """Carry x in slip until an event or the end of the ticks asked for.

    ic[0] tick, fc[0] place in it, fc[1] step to try next; out[i] state after tick i. Returns the guard, -1 at the
    end, -2 where no step is short enough. What a step works on is lent to nobody, so that it stays in registers:
    `here` is the state, and a copy of the dense output goes to who asks for more than ticks.
    """
    n = len(shape)
    tick_length = t.step[0]
    f, b = lend(t, slot, w.T, w.scratch), lend_books(t, slot, w.T)
    k, y, z, d, size = local(shape, w.k), local(shape, w.y), local(shape, w.y2), local(shape, w.derivatives), w.size
    here, path = local(shape, w.copy), w.derivatives
    rub = rubbing(shape, f, w)
    tick, place, next_h = ic[0], fc[0], fc[1]
    fallen = -1
    for i in range(n):
        size[i] = max(size[i], abs(x[i]))
        here[i] = x[i]
    rate(shape, f, True, here, k[0])
    alike(k[0], t.damping.shape[1], tick_length, size)
    most = ic[5] + _MOST * (ticks - tick)
    hoped = 0.0  # step that the error of the last one promised
    while tick < ticks and fallen == -1 and not (emitting and crowded(t, slot, seg, ticks - tick)):
        left = ((ticks - tick) - place) * tick_length
        h = next_h if next_h < left - 1e-9 * tick_length else left
        trial(shape, f, rub, k, here, h, y, z)
        e = error(shape, k, y, size, h, tolerance)
        ic[5] += 1
        if not (e <= 1.0):
            next_h = h * max(_SHRINK, _SAFETY * e ** (-0.2))
            if next_h < 1e-14 * tick_length or ic[5] > most:
                fallen = -2
            continue
        grow = growth(e)
        if h >= next_h or grow < 1.0:  # an error that grows goes on growing
            next_h = h * max(_SHRINK, min(grow, (grow * grow) * (h / hoped)))
        hoped = h * grow
        dense(shape, k, here, y, h, d)
        end = 1.0
        if booking or emitting or not clear(shape, f, d, size):
            for c in range(5):
                for i in range(n):
                    path[c, i] = d[c, i]
            theta, fallen, doubtful = fall(shape, f, path, size, w.y2, w.poly, w.roots, w.fits)
            if doubtful and h > 1e-12 * tick_length:
                next_h, fallen = _SHRINK * h, -1
                continue
            if fallen >= 0:
                end = theta
            if booking:
                book_step(shape, f, b, path, end, h, w.y2, w.nodes3, w.weights3, energy)
        done, share = 0.0, tick_length / h
        while True:  # ticks that lie inside the step
            to = done + (1.0 - place) * share
            if fallen < 0 and tick == ticks - 1 and h == left:
                to = 1.0
            if to > end or (fallen >= 0 and to >= end):
                break
            if emitting:
                begin = (tick - origin + place) * tick_length
                emit(shape, f, b, path, done, to, h, w.y2, w.values, begin, seg)
            at(shape, d, to, out[tick])
            modes[tick] = slot
            tick += 1
            place = 0.0
            done = to
            if tick == ticks:
                break
        if done < end:
            if emitting:
                begin = (tick - origin + place) * tick_length
                emit(shape, f, b, path, done, end, h, w.y2, w.values, begin, seg)
            place += (end - done) * h / tick_length
        if fallen >= 0:
            at(shape, d, end, here)
            continue
        swing(shape, t, w, ((tick - origin) + place) * tick_length, y)
        for i in range(n):
            here[i] = y[i]
            k[0, i] = k[6, i]
            size[i] = max(size[i], abs(here[i]))
        if t.stuck[slot]:
            for i in range(n):
                x[i] = here[i]
            land(t, slot, x, w.copy)
            for i in range(n):
                here[i] = x[i]
    ic[0], fc[0], fc[1] = tick, place, next_h
    for i in range(n):
        x[i] = here[i]
    if fallen >= 0:
        passed(t, slot, fallen, ic, x)
    elif fallen == -1:
        for i in range(n):
            out[ticks - 1, i] = x[i]
    return fallen
