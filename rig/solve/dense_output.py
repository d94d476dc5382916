"""The quartic through a step of dopri5 (dense output), and the first event along it.

A guard that is a row over the state is a quartic too. A guard that depends on the inputs is approximated by a quartic.
The guard itself is evaluated to estimate the error of this fit and to confirm the event that the fit predicts.
"""

from __future__ import annotations

import numpy as np

from rig.kernel import inlined, inner
from rig.solve.forces import inputs
from rig.solve.lanes import lane, lanes
from rig.solve.places import inputs_at, row_times, states_at
from rig.solve.roots import NONE, first_crossing
from rig.solve.rows import ROUND, dot, rounding
from rig.solve.segment_output import quartic_coefficients
from rig.solve.specialised import any_shape, state_count

_EARLY = 0.5  # share of a step
PROBE = 0.9  # place in a step where the error of a quartic through the quarters is largest
_OFF = 4.0  # safety factor on the error found there: bounds it everywhere
_FAINT = 0.03  # share of the rounding bound of a guard: its actual rounding error


@inlined
def quartic_of_step(shape, k, x, y, h, d):
    """Coefficients d[0..4] of the quartic through the step, in powers of theta."""
    n = state_count(shape)
    for i in range(n):
        difference = y[i] - x[i]
        bulge = h * k[0, i] - difference
        r3 = difference - h * k[6, i] - bulge
        r4 = h * (
            k[0, i] * (-12715105075.0 / 11282082432.0)
            + k[2, i] * (87487479700.0 / 32700410799.0)
            - k[3, i] * (10690763975.0 / 1880347072.0)
            + k[4, i] * (701980252875.0 / 199316789632.0)
            - k[5, i] * (1453857185.0 / 822651844.0)
            + k[6, i] * (69997945.0 / 29380423.0)
        )
        # x + th (difference + (1 - th)(bulge + th (r3 + (1 - th) r4)))
        d[0, i] = x[i]
        d[1, i] = difference + bulge
        d[2, i] = -bulge + r3 + r4
        d[3, i] = -r3 - 2.0 * r4
        d[4, i] = r4


@inlined
def evaluate_quartic(shape, d, theta, x):
    """Evaluate the dense output at theta and write the state to x."""
    for i in range(state_count(shape)):
        x[i] = d[0, i] + theta * (d[1, i] + theta * (d[2, i] + theta * (d[3, i] + theta * d[4, i])))


@inner
def guard_value(t, mode_set, w, g, theta):
    """The value of guard g, which depends on the inputs, at theta of the dense output."""
    evaluate_quartic(any_shape(w.y2.shape[0]), w.derivatives, theta, w.y2)
    inputs(t, mode_set, w.y2, w.T, w.scratch)
    return dot(t.G[mode_set, g], w.y2) + dot(t.GT[mode_set, g], w.T)


@inlined
def guard_zero(t, mode_set, w, g, theta, noise):
    """The place where guard g itself becomes zero, at most `noise` below zero; NONE if it has no zero.

    `theta`: zero of its fit. The state at the event has to agree with the event. A contact released only by the error
    of the fit would not move off; it would stick again at once.
    """
    low, high = theta, theta
    above = below = guard_value(t, mode_set, w, g, theta)
    if above > 0.0:  # the fit was early: search up to its next node, where fit and guard agree
        if theta >= 1.0:
            return NONE
        high = min(0.25 * (np.floor(4.0 * theta) + 1.0), 1.0)
        below = guard_value(t, mode_set, w, g, high)
        if below > 0.0:
            return NONE
    elif theta > 0.0:
        low = 0.25 * (np.ceil(4.0 * theta) - 1.0)
        above = guard_value(t, mode_set, w, g, low)
    kept = 0  # the end kept by the last secant; its value is halved if it is kept twice (Illinois)
    while above > 0.0 and below < -noise:
        u = low + (high - low) * above / (above - below)
        if not low < u < high:
            u = 0.5 * (low + high)
            if not low < u < high:
                break
        value = guard_value(t, mode_set, w, g, u)
        if value > 0.0:
            low, above = u, value
            if kept == 1:
                below *= 0.5
            kept = 1
        else:
            high, below = u, value
            if kept == -1:
                above *= 0.5
            kept = -1
    return high


@inlined
def sample_guards(t, mode_set, w):
    """Evaluate the guards that depend on the inputs, at the quarters of the step and at `PROBE`.

    w.fits[g, 0..5] = values; w.fits[g, 6] = bound on their rounding error.
    """
    found, fits = False, w.guard_samples
    for g in range(t.guards[mode_set]):
        if t.guard_needs_inputs[mode_set, g]:
            found = True
            fits[g, 6] = 0.0
    if found:
        states_at(w.derivatives, lanes(w.probes), w.x_at)
        inputs_at(t, mode_set, w, 0, 6)
        for g in range(t.guards[mode_set]):
            if t.guard_needs_inputs[mode_set, g]:
                values = row_times(t.G[mode_set, g], w.x_at) + row_times(t.GT[mode_set, g], w.T_at)
                for q in range(6):
                    fits[g, q] = lane(values, q)
                    error = 0.0
                    for j in range(w.T_at.shape[0]):
                        error += abs(t.GT[mode_set, g, j] * w.T_at[j, q])
                    fits[g, 6] = max(fits[g, 6], error * ROUND)


@inlined
def first_event_of_fit(t, mode_set, w, g, noise):
    """The first event of guard g, which depends on the inputs, and whether the step is too long to be sure.

    Returns theta (or NONE) and a flag. The guard is fitted by a quartic through five points; a sixth point gives the
    error of the fit. The flag is set if, within this error, an event is possible in an earlier quarter than the one
    found.
    """
    fit, poly = w.guard_samples[g], w.poly
    poly[0], poly[1], poly[2], poly[3], poly[4] = quartic_coefficients(fit[0], fit[1], fit[2], fit[3], fit[4])
    value = poly[0] + PROBE * (poly[1] + PROBE * (poly[2] + PROBE * (poly[3] + PROBE * poly[4])))
    off = _OFF * abs(value - fit[5])
    if off <= noise:
        off = 0.0
    poly[0] -= off
    early = theta = first_crossing(poly, 4, noise, w.roots)
    poly[0] += off
    if early < NONE:
        if off > 0.0:
            theta = first_crossing(poly, 4, noise, w.roots)
        if theta < NONE:
            theta = guard_zero(t, mode_set, w, g, theta, _FAINT * noise)
    return theta, int(4.0 * early) < int(4.0 * theta)


@inner
def first_event(t, mode_set, w):
    """The first event of any guard along the dense output in w.derivatives.

    Returns theta (or NONE), the guard, and whether the step is too long to be sure. The flag is also set if a guard
    begins at zero, as after a contact was released, and has its event early in the step without falling at the begin.
    The guard is small there, but the error of the step is not, so the event may be nothing but this error.
    """
    first, guard, doubtful = NONE, -1, False
    sample_guards(t, mode_set, w)
    poly = w.poly
    for g in range(t.guards[mode_set]):
        noise = rounding(t.G[mode_set, g], w.size)
        unseen = False
        if t.guard_needs_inputs[mode_set, g]:
            noise = max(noise, w.guard_samples[g, 6])
            theta, unseen = first_event_of_fit(t, mode_set, w, g, noise)
        else:
            for c in range(5):
                poly[c] = dot(t.G[mode_set, g], w.derivatives[c])
            theta = first_crossing(poly, 4, noise, w.roots)
        if theta < first:
            first, guard = theta, g
            unseen = unseen or (abs(poly[0]) <= noise and poly[1] >= -noise and theta < _EARLY)
        doubtful = doubtful or unseen
    return first, guard, doubtful


@inlined
def free_of_events(shape, f, d, size):
    """Whether the coefficients alone prove that no guard has an event along the dense output.

    If not, `first_event` decides.
    """
    for g in range(f.G.shape[0]):
        if f.guard_needs_inputs[g]:
            return False
        begin, lowest = 0.0, 0.0
        for c in range(5):
            value = 0.0
            for j in range(state_count(shape)):
                value += f.G[g, j] * d[c, j]
            if c == 0:
                begin = lowest = value
            else:
                lowest += min(value, 0.0)
        if not (lowest > 0.0 and begin > rounding(f.G[g], size)):
            return False
    return True
