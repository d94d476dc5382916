"""Contacts that open and close all the time: exact flow of the structure, kicks by the contacts (Strang splitting).

    v += h/2 M^-1 f(q);   x <- exp(A h) x;   v += h/2 M^-1 f(q)          f: what presses, and its friction

A contact force that rests on positions alone changes no position while it kicks, so each part is solved exactly and
their composition is symplectic: of second order, and the energy of a contact that opens and closes neither grows nor
dies. A force that is held over the step instead feeds the vibration at any step. No lift-off is located: a contact is
what is positive of its row. The end of slip and of stick are seen at the ends of steps.

What a step costs is four products with tables in the processor's vectors (rig.solve.lanes): the structure's step; what
every point would press, and the guards; what that pushes (to pass over points that are open costs more than it saves);
and x x^T for the ledger, whose forms are worked out when somebody asks, as in rig.solve.wide. The two half kicks at one
instant are of the same forces, which are found once.

Source: Strang, SIAM J. Numer. Anal. 5 (1968) 506; Hairer, Lubich and Wanner, Geometric Numerical Integration, II.5.
"""

from __future__ import annotations

from dataclasses import replace
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from rig.kernel import inlined, inner
from rig.solve import expm, ledger
from rig.solve.books import read
from rig.solve.emit import crowded, emit_chord
from rig.solve.formulation import ModeSet
from rig.solve.lanes import BLOCK, blocks, gather, multiply, zeros
from rig.solve.products import PRESS, Factor, Product
from rig.solve.records import KEY, PLACE, REACHED, TICK
from rig.solve.rows import ROUND, rounding
from rig.solve.settle import passed
from rig.solve.system import Normal, System

Array = NDArray[np.float64]


class Flow(NamedTuple):
    """Tables stacked by slot, and scratch. Rows: the slot's guards, then surface and slip speeds of the patches.

    Columns of `push`, what a newton at a point does: accelerations | the rows' change in a second | the guards', at
    once | friction of the patches | forces along the coordinates | those that its spring takes up, along the
    coordinates and along the states that are no motion.
    """

    step: Array  # [slot, block, n, BLOCK] propagator less one, landing folded in
    look: Array  # [slot, block, n, BLOCK] what presses at each point, then the rows
    push: Array  # [slot, block, point, BLOCK]
    work: Array  # [slot, term, n, n] integrals of the powers over a step
    whole: Array  # [slot, n, n and what fills the block] sum of x x^T over the steps, after the first half kick
    moved: Array  # scratch [what `step` gives]
    seen: Array  # scratch [what `look` gives]
    given: Array  # scratch [what `push` gives]
    filled: Array  # scratch [n and what fills the block]
    force: Array  # scratch [point]
    before: Array  # scratch [guard]
    spring: Array  # [1] work that the kicks have done on the springs of the points [J]


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


def _whole(columns: int) -> int:
    return -(-columns // BLOCK) * BLOCK


def empty(system: System | None, guards: int) -> Flow:
    """Tables without a slot, for a system of `pressed` with at most so many guards; of no length for None."""
    n, nq, P, points = 0, 0, 0, 0
    if system is not None:
        n, nq, P, points = system.n, len(system.coordinates), len(system.patches), len(system.products)
    rows = guards + 2 * P
    width = _whole(nq + rows + guards + P + n)
    return Flow(
        step=zeros((0, _whole(n) // BLOCK, n, BLOCK)),
        look=zeros((0, _whole(points + rows) // BLOCK, n, BLOCK)),
        push=zeros((0, width // BLOCK, points, BLOCK)),
        work=zeros((0, ledger.TERMS, n, n)),
        whole=zeros((0, n, _whole(n))),
        moved=zeros(_whole(n)),
        seen=zeros(_whole(points + rows)),
        given=zeros(width),
        filled=zeros(_whole(n)),
        force=zeros(points),
        before=zeros(guards),
        spring=zeros(1),
    )


def tables(system: System, modes: ModeSet, forms: Array, step: float, guards: int) -> dict[str, Array]:
    """The tables of one slot. `forms`: of the powers; `step` [s]; `guards`: what all slots have room for."""
    P, points = len(system.patches), len(system.products)
    E = expm.ladder(modes.A, step)
    nodes = ledger.at_nodes(modes.A, modes.landing, step / 2.0 ** (len(E) - 1))
    E = (modes.landing - np.eye(len(modes.A))) + modes.landing @ E @ modes.landing
    press = _rows(system)
    rows = np.zeros((guards + 2 * P, system.n))
    at_once = np.zeros((guards, points))
    rows[: len(modes.guards)], at_once[: len(modes.guards)] = modes.guards, modes.guards_t[:, P:]
    rows[guards:] = np.concatenate([ledger.supplied(system), system.slip_rows])
    b = modes.b[:, P:]
    nq = len(system.coordinates)
    springs = (compliances(system)[:, None] * press).T
    taken = np.concatenate([springs[:nq], springs[2 * nq :]])
    push = np.concatenate([b[nq : 2 * nq], rows @ b, at_once, modes.friction_t[:, P:], system.force_t, taken])
    return {
        "step": blocks(E[0]),
        "look": blocks(np.concatenate([press, rows])),
        "push": blocks(push),
        "work": ledger.work(nodes, forms, step, E)[0],
        "whole": np.zeros((system.n, _whole(system.n))),
    }


def _rows(system: System) -> Array:
    """What presses at each point, as a row over the states."""
    return np.array([product.factors[0].row for product in system.products], dtype=np.float64)


def compliances(system: System) -> Array:
    """Compression for each newton at a point [m/N]: the part of its push that gives way as the row says; [point].

    0 for a force that no position changes.
    """
    rows = _rows(system)[:, : len(system.coordinates)]
    stiff = np.sum(rows * rows, axis=1)
    give = np.einsum("pi,ip->p", rows, system.force_t)
    return np.asarray(-give / np.where(stiff > 0.0, stiff, np.inf), dtype=np.float64)


def held(system: System, x: Array) -> float:
    """The energy in the springs of the points at x [J]."""
    force = np.maximum(_rows(system) @ x, 0.0)
    return float(0.5 * np.sum(compliances(system) * force * force))


@inlined
def press(own, slot, x):
    """What presses at x, its rows in own.seen, and what that pushes in own.given."""
    multiply(own.look[slot], x, 0, own.look.shape[1], own.seen)
    for k in range(own.force.shape[0]):
        own.force[k] = max(own.seen[k], 0.0)
    multiply(own.push[slot], own.force, 0, own.push.shape[1], own.given)


@inlined
def book(own, nq, patches, x, scale, shift, energy):
    """Add `scale` [s] times the powers of what pushes at x, its speeds those `shift` [s] later."""
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
def commanded(own, n, nq, patches):
    """Book half of what the springs take up over a step because a load moved, at the forces of now."""
    first = nq + 2 * (own.before.shape[0] + patches) + patches + 2 * nq
    s = 0.0
    for j in range(2 * nq, n):
        s += own.given[first + j - 2 * nq] * own.moved[j]
    own.spring[0] += 0.5 * s


@inner
def noise(own, t, slot, g, x):
    """Size of the rounding error of guard g at x."""
    size, patches = rounding(t.G[slot, g], x), t.slip.shape[0]
    for k in range(own.force.shape[0]):
        size += ROUND * abs(t.GT[slot, g, patches + k] * own.force[k])
    return size


@inlined
def fell(own, t, slot, nq, x):
    """The first guard that is no longer positive at x, or has clearly fallen; -1 if none. Keeps them in own.before."""
    fallen = -1
    points, at_once = own.force.shape[0], nq + own.before.shape[0] + 2 * t.slip.shape[0]
    for g in range(t.guards[slot]):
        value = own.seen[points + g] + own.given[at_once + g]
        if fallen < 0 and value <= 0.0:
            rounded = noise(own, t, slot, g, x)
            if own.before[g] > rounded or value < -rounded:
                fallen = g
        own.before[g] = value
    return fallen


@inlined
def tell(own, t, slot, T, x, values):
    """What the sensors read at x, where `press` has just been asked; laws over speed there are none."""
    patches = T.shape[0] - own.force.shape[0]
    for p in range(patches):
        T[p] = 0.0
    for k in range(own.force.shape[0]):
        T[patches + k] = own.force[k]
    read(t, slot, T, x, values)


@inner
def stretch(shape, t, w, state, log, seg, plan, ticks):
    """Part: carry the state until an event or the end of the ticks asked for. Returns the guard or -1."""
    own, ic, fc, x, energy = t.flow, state.ic, state.fc, state.x, state.energy
    substeps, booking, emitting, origin = plan.substeps, plan.booking, plan.emitting, ic[REACHED]
    slot = t.slot_of[ic[KEY]]
    n, nq, patches, points = x.shape[0], t.force.shape[0], t.slip.shape[0], own.force.shape[0]
    h = t.step[0] / substeps
    begin, end = w.values[0], w.values[1]
    given, seen, moved = own.given, own.seen, own.moved
    tick, done, fallen = ic[TICK], int(fc[PLACE] * substeps + 0.5), -1
    press(own, slot, x)
    fell(own, t, slot, nq, x)  # where the guards begin
    if booking:
        book(own, nq, patches, x, 0.5 * h, 0.25 * h, energy)
    if emitting:
        tell(own, t, slot, w.T, x, begin)
    while tick < ticks and fallen < 0 and not (emitting and crowded(t, slot, seg, ticks - tick)):
        for i in range(nq):
            x[nq + i] += 0.5 * h * given[i]
        if booking:
            for i in range(n):
                own.filled[i] = x[i]
            gather(own.whole[slot], own.filled, 1.0)
        multiply(own.step[slot], x, 0, own.step.shape[1], moved)
        for i in range(n):
            x[i] += moved[i]
        if booking:
            commanded(own, n, nq, patches)
        press(own, slot, x)  # serves both the kick that ends this step and the one that begins the next
        if booking:
            commanded(own, n, nq, patches)
        for i in range(nq):
            x[nq + i] += 0.5 * h * given[i]
        for r in range(own.before.shape[0] + 2 * patches):
            seen[points + r] += 0.5 * h * given[nq + r]
        if booking:
            book(own, nq, patches, x, h, 0.0, energy)
        if emitting:
            tell(own, t, slot, w.T, x, end)
            emit_chord(begin, end, (tick - origin) * t.step[0] + done * h, h, seg)
            for s in range(begin.shape[0]):
                begin[s] = end[s]
        fallen = fell(own, t, slot, nq, x)
        done += 1
        if done == substeps:
            for i in range(n):
                log.out[tick, i] = x[i]
            log.modes[tick] = slot
            tick, done = tick + 1, 0
    if booking:  # the kick that begins the next step is not of this stretch
        book(own, nq, patches, x, -0.5 * h, 0.25 * h, energy)
    ic[TICK], fc[PLACE] = tick, done / substeps
    if fallen >= 0:
        passed(t, slot, fallen, ic, x)
    return fallen
