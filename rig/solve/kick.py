"""Contacts that open and close all the time: exact flow of the structure, kicks by the contacts (Strang splitting).

    v += h/2 M^-1 f(q);   x <- exp(A h) x;   v += h/2 M^-1 f(q)          f: what presses, and its friction

A contact force that rests on positions alone changes no position while it kicks, so each part is solved exactly and
their composition is symplectic: of second order, and the energy of a contact that opens and closes neither grows nor
dies. A force that is held over the step instead feeds the vibration at any step. No lift-off is located: a contact is
what is positive of its row. The end of slip and of stick are seen at the ends of steps.

Source: Strang, SIAM J. Numer. Anal. 5 (1968) 506; Hairer, Lubich and Wanner, Geometric Numerical Integration, II.5.
"""

from __future__ import annotations

from dataclasses import replace
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from rig.kernel import inner
from rig.solve import expm, ledger
from rig.solve.books import lend_books
from rig.solve.forces import dot, forces, lend
from rig.solve.formulation import ModeSet
from rig.solve.products import PRESS, Factor, Product
from rig.solve.rk4 import fell, observe
from rig.solve.settle import passed
from rig.solve.system import Normal, System

Array = NDArray[np.float64]


class Flow(NamedTuple):
    """What the structure does by itself over one step: tables stacked by slot."""

    E: Array  # [slot, n, n] propagator less one, landing folded in
    work: Array  # [slot, term, n, n] integrals of the powers


def refusal(system: System) -> str:
    """Why this system is not for kicks; "" where it is."""
    positions = slice(len(system.coordinates))
    if not any(k.opens and np.any(k.row[positions]) for k in system.normals):
        return "no contact opens here: exact or dopri5"
    over_speed = [p.name for i, p in enumerate(system.patches) if any(not law.constant for law in system.laws(i))]
    if over_speed:
        return f"friction over speed is no force of positions alone ({', '.join(over_speed)}): dopri5"
    if system.products or system.limiters or system.sectors or system.switches:
        return "knows structures and contacts only: exact or dopri5"
    velocities = slice(len(system.coordinates), system.one)
    for k in system.normals:
        if np.any(k.inertia) or np.any(k.row[velocities]):
            return f"the force of {k.name} is none of positions alone: exact or dopri5"
    return ""


def pressed(system: System) -> System:
    """The system with every contact that opens as a product, what is positive of its row; they are no modes any more.

    The product of a normal force k is called N:k, as outputs name it. What they press is one normal force of the patch.
    """
    points = [k for k in system.normals if k.opens]
    count = len(points)
    products = tuple(Product(f"N:{k.name}", (Factor(PRESS, 0, k.row),)) for k in points)
    sums = [np.array([1.0 if k.patch == p else 0.0 for k in points]) for p in range(len(system.patches))]
    none, still = np.zeros(system.n), np.zeros(len(system.coordinates))
    kept = [replace(k, row_t=np.zeros(count)) for k in system.normals if not k.opens]
    loads = [Normal(f"points of {patch.name}", p, none, sums[p], still, still, False)
             for p, patch in enumerate(system.patches) if sums[p].any()]  # fmt: skip
    force_t = np.array([k.direction for k in points]).reshape(count, -1).T
    return replace(system, normals=(*kept, *loads), products=products, force_t=force_t)


def empty(n: int) -> Flow:
    """Tables without a slot."""
    return Flow(np.zeros((0, n, n)), np.zeros((0, ledger.TERMS, n, n)))


def flow(modes: ModeSet, forms: Array, step: float) -> tuple[Array, Array]:
    """The tables of one slot: E and the integrals of the powers `forms` over `step` [s]."""
    E = expm.ladder(modes.A, step)
    nodes = ledger.at_nodes(modes.A, modes.landing, step / 2.0 ** (len(E) - 1))
    E = (modes.landing - np.eye(len(modes.A))) + modes.landing @ E @ modes.landing
    return E[0], ledger.work(nodes, forms, step, E)[0]


@inner
def kick(f, b, x, time, copy, booking, energy):
    """Let the inputs f.T push for `time` [s]: x changes its velocities; the work is that of their mean."""
    nq, patches = b.damping.shape[0], b.slip.shape[0]
    for i in range(nq, 2 * nq):
        s = 0.0
        for p in range(patches, f.T.shape[0]):
            s += f.b[i, p] * f.T[p]
        copy[i] = x[i] + 0.5 * time * s
        x[i] += time * s
    if not booking:
        return
    for i in range(x.shape[0]):
        if i < nq or i >= 2 * nq:
            copy[i] = x[i]
    for p in range(patches):
        force = time * dot(b.friction_t[p], f.T)
        energy[0] += force * dot(b.surface[p], copy)
        energy[1] += force * dot(b.slip[p], copy)
    for i in range(nq):
        energy[3] += time * copy[nq + i] * dot(b.force_t[i], f.T[patches:])


@inner
def stretch(shape, t, own, slot, ic, fc, x, w, origin, ticks, substeps, out, modes, energy, booking, emitting, seg):
    """Carry x until an event or the end of the ticks asked for, `substeps` steps a tick. Returns the guard or -1."""
    n = x.shape[0]
    h = t.step[0] / substeps
    f, b = lend(t, slot, w.T, w.scratch), lend_books(t, slot, w.T)
    E, work = own.E[slot], own.work[slot]
    tick, done, fallen = ic[0], int(fc[0] * substeps + 0.5), -1
    forces(f, x)
    while tick < ticks and fallen < 0:
        for i in range(n):
            w.x0[i] = x[i]
        kick(f, b, x, 0.5 * h, w.copy, booking, energy)
        if booking:
            ledger.book(work, t.active[slot], x, energy)
        for i in range(n):
            s = 0.0
            for j in range(n):
                s += E[i, j] * x[j]
            w.y[i] = x[i] + s
        for i in range(n):
            x[i] = w.y[i]
        forces(f, x)  # they serve the next step too: a kick moves nothing
        kick(f, b, x, 0.5 * h, w.copy, booking, energy)
        for i in range(n):
            w.y[i] = x[i]
        if emitting:
            start = (tick - origin) * t.step[0] + done * h
            observe(shape, f, b, True, w.x0, h, w, start, False, energy, emitting, seg)
        fallen = fell(shape, f, True, w.x0, w.y)
        if emitting or t.stuck[slot]:  # these have asked for forces at other places
            forces(f, x)
        done += 1
        if done == substeps:
            for i in range(n):
                out[tick, i] = x[i]
            modes[tick] = slot
            tick, done = tick + 1, 0
    ic[0], fc[0] = tick, done / substeps
    if fallen >= 0:
        passed(t, slot, fallen, ic, x)
    return fallen
