"""Strang splitting for contacts that open and close all the time: exact flow of the structure, kicks by the contacts.

    v += h/2 M^-1 f(q);   x <- exp(A h) x;   v += h/2 M^-1 f(q)          f: normal forces and their friction

A contact force that depends on positions alone changes no position during a kick. Each part is therefore solved
exactly, and their composition is symplectic and of second order: the energy of a contact that opens and closes neither
grows nor decays. A force that is held over the step would feed energy into the vibration at any step. No lift-off is
located: a normal force is the positive part of its row. The end of slip and of stick is detected at the ends of steps.

A step takes four products with tables, in vector code (rig.solve.column_blocks): the step of the structure; the normal
force of every point, with the guards; the effect of these forces (skipping open points costs more than it saves); and x
x^T for the energy balance, whose terms are computed only when they are read, as in rig.solve.many_states. The two half
kicks at one instant have the same forces, which are computed once.

Source: Strang, SIAM J. Numer. Anal. 5 (1968) 506; Hairer, Lubich and Wanner, Geometric Numerical Integration, II.5.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from rig.compiled.kernel import inlined, inner
from rig.solve.column_blocks import ROUND, copy, dot, gather, multiply, rounding
from rig.solve.contact_state import apply_event
from rig.solve.segment_output import emit_chord, nearly_full

Array = NDArray[np.float64]


class KickTables(NamedTuple):
    """Tables of the method kick, stacked by mode set, and scratch.

    Rows: the guards of the mode set, then surface and slip speeds of the patches.

    Columns of `push`, the effect of a force of 1 N at a point: accelerations | rate of change of the rows | the guards,
    at once | friction of the patches | forces along the coordinates | the part of these forces that its spring takes
    up, along the coordinates and along the states that are neither positions nor velocities.
    """

    step: Array  # [mode set, block, n, BLOCK] propagator minus one, projection of stick included
    rows: Array  # [mode set, block, n, BLOCK] normal force of each point, then the rows
    push: Array  # [mode set, block, point, BLOCK]
    work: Array  # [mode set, term, n, n] integrals of the powers over a step
    whole: Array  # [mode set, n, n padded to blocks] sum of x x^T over the steps, after the first half kick
    moved: Array  # scratch [columns of `step`]
    seen: Array  # scratch [columns of `rows`]
    given: Array  # scratch [columns of `push`]
    filled: Array  # scratch [n padded to blocks]
    force: Array  # scratch [point]
    before: Array  # scratch [guard]
    spring: Array  # [1] work of the kicks on the springs of the points [J]


@inlined
def normal_forces(own, mode_set, x):
    """Compute the normal forces and the rows at x, own.seen, and the effect of the forces, own.given."""
    multiply(own.rows[mode_set], x, 0, own.rows.shape[1], own.seen)
    for k in range(own.force.shape[0]):
        own.force[k] = max(own.seen[k], 0.0)
    multiply(own.push[mode_set], own.force, 0, own.push.shape[1], own.given)


@inlined
def add_contact_energy(own, nq, patches, x, scale, shift, energy):
    """Add `scale` [s] times the powers of the contact forces at x, with the speeds `shift` [s] later."""
    rows = own.before.shape[0] + 2 * patches
    seen = own.force.shape[0] + own.before.shape[0]
    change = nq + own.before.shape[0]
    friction = nq + rows + own.before.shape[0]
    for p in range(patches):
        force = scale * own.given[friction + p]
        energy[0] += force * (own.seen[seen + p] + shift * own.given[change + p])
        energy[1] += force * (own.seen[seen + patches + p] + shift * own.given[change + patches + p])
    s = 0.0
    for i in range(nq):
        s += own.given[friction + patches + i] * (x[nq + i] + shift * own.given[i])
    energy[3] += scale * s
    taken = friction + patches + nq
    s = 0.0
    for i in range(nq):
        s += own.given[taken + i] * (x[nq + i] + shift * own.given[i])
    own.spring[0] += scale * s


@inlined
def add_load_work(own, n, nq, patches):
    """Add half of the work on the springs over a step in which a load was moved, at the present forces."""
    first = nq + 2 * (own.before.shape[0] + patches) + patches + 2 * nq
    s = 0.0
    for j in range(2 * nq, n):
        s += own.given[first + j - 2 * nq] * own.moved[j]
    own.spring[0] += 0.5 * s


@inner
def guard_rounding(own, t, mode_set, g, x):
    """The size of the rounding error of guard g at x."""
    size, patches = rounding(t.G[mode_set, g], x), t.slip.shape[0]
    for k in range(own.force.shape[0]):
        size += ROUND * abs(t.GT[mode_set, g, patches + k] * own.force[k])
    return size


@inlined
def crossed_guard(own, t, mode_set, nq, x):
    """The first guard that is no longer positive at x, or is clearly negative; -1 if there is none.

    Updates own.before, the values of the guards.
    """
    crossed = -1
    points, at_once = own.force.shape[0], nq + own.before.shape[0] + 2 * t.slip.shape[0]
    for g in range(t.guards[mode_set]):
        value = own.seen[points + g] + own.given[at_once + g]
        if crossed < 0 and value <= 0.0:
            rounded = guard_rounding(own, t, mode_set, g, x)
            if own.before[g] > rounded or value < -rounded:
                crossed = g
        own.before[g] = value
    return crossed


@inlined
def write_outputs(own, t, mode_set, T, x, values):
    """Write the outputs that sensors read at x; `normal_forces` must have been called at x.

    No patch has speed-dependent friction here.
    """
    patches = T.shape[0] - own.force.shape[0]
    for p in range(patches):
        T[p] = 0.0
    copy(own.force.shape[0], own.force, T[patches:])
    for s in range(values.shape[0]):
        values[s] = dot(t.signals[mode_set, s], x) + dot(t.signals_t[mode_set, s], T)


@inner
def stretch(shape, t, w, state, log, seg, plan, ticks):
    """Advance the state to an event or to the end of the ticks; a part (rig.solve.specialised).

    Returns the guard of the event, or -1.
    """
    own, now, x, energy = t.kick, state.progress[0], state.x, state.energy
    substeps, with_energy, emitting, origin = plan.substeps, plan.with_energy, plan.emitting, now.reached
    mode_set = t.mode_set_of[now.key]
    n, nq, patches, points = x.shape[0], t.force.shape[0], t.slip.shape[0], own.force.shape[0]
    h = t.step[0] / substeps
    begin, end = w.values[0], w.values[1]
    given, seen, moved = own.given, own.seen, own.moved
    tick, done, crossed = now.tick, int(now.place * substeps + 0.5), -1
    normal_forces(own, mode_set, x)
    crossed_guard(own, t, mode_set, nq, x)  # the guards at the begin, kept in own.before
    if with_energy:
        add_contact_energy(own, nq, patches, x, 0.5 * h, 0.25 * h, energy)
    if emitting:
        write_outputs(own, t, mode_set, w.T, x, begin)
    while tick < ticks and crossed < 0 and not (emitting and nearly_full(t, mode_set, seg, ticks - tick)):
        for i in range(nq):
            x[nq + i] += 0.5 * h * given[i]
        if with_energy:
            copy(n, x, own.filled)
            gather(own.whole[mode_set], own.filled, 1.0)
        multiply(own.step[mode_set], x, 0, own.step.shape[1], moved)
        for i in range(n):
            x[i] += moved[i]
        if with_energy:
            add_load_work(own, n, nq, patches)
        normal_forces(own, mode_set, x)  # serves both the kick that ends this step and the one that begins the next
        if with_energy:
            add_load_work(own, n, nq, patches)
        for i in range(nq):
            x[nq + i] += 0.5 * h * given[i]
        for r in range(own.before.shape[0] + 2 * patches):
            seen[points + r] += 0.5 * h * given[nq + r]
        if with_energy:
            add_contact_energy(own, nq, patches, x, h, 0.0, energy)
        if emitting:
            write_outputs(own, t, mode_set, w.T, x, end)
            emit_chord(begin, end, (tick - origin) * t.step[0] + done * h, h, seg)
            copy(begin.shape[0], end, begin)
        crossed = crossed_guard(own, t, mode_set, nq, x)
        done += 1
        if done == substeps:
            copy(n, x, log.out[tick])
            log.modes[tick] = mode_set
            tick, done = tick + 1, 0
    if with_energy:  # the kick that begins the next step belongs to the next stretch
        add_contact_energy(own, nq, patches, x, -0.5 * h, 0.25 * h, energy)
    now.tick, now.place = tick, done / substeps
    if crossed >= 0:
        apply_event(t, mode_set, crossed, now, x)
    return crossed
