"""Steps of the method kick where the contacts are a film under a slider that travels (rig.solve.film).

    v += h/2 M^-1 F;   (q, v) <- exact flow of the structure, s <- s + travel;   F of the film there;   v += h/2 M^-1 F

Between two kicks each coordinate moves on its own: a damped turn of its place and velocity. What the points press with
rests on where they are, and their friction on how far they were carried since the step before, so that the composition
is of second order (compare rig.solve.kick). The compression speed, where the film is damped, is taken from the last
three places, for the velocity at the end of a step is not known before its kick. A force that is held over the step
instead feeds the vibration at any step.

Energy: the friction of a step is the mean of its ends, so that what a point is given by the drive, f times the travel,
is exactly what it loses in sliding, what its shear stores and what the structure gets. What does not close is what the
kicks do beside the work of the springs, by the square of the step.

What a step costs is the interpolation of the rows with the product that says where the points are, and the product that
says what they push (rig.solve.lanes).
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from rig.kernel import inlined, inner
from rig.solve import expm, ledger
from rig.solve.emit import crowded, emit_chord
from rig.solve.film import CENTRE_X, CENTRE_Y, FRACTION, FRICTION, NORMAL, OPENINGS, SUMS, Film, on
from rig.solve.lanes import BLOCK, across, blend, zeros
from rig.solve.records import PLACE, REACHED, TICK
from rig.solve.system import System

Array = NDArray[np.float64]
TRAVEL, FIRST, POINTS, DIRECTIONS, DAMPED = range(5)
"""Of Riding.where: state of the travel, of the first force on a coordinate; points, directions; 1: the film is damped."""
PITCH, STIFFNESS, DAMPING, SHEAR, FRICTIONAL = range(5)
"""Of Riding.numbers."""


class Side(NamedTuple):
    """Coordinates that move both sides of the line of travel alike, or against each other. A lane: of a pair of points
    a direction."""

    rows: Array  # [place, coordinate, lane]
    which: NDArray[np.int64]  # [coordinate] number
    now: Array  # scratch [coordinate, lane] rows at this instant
    values: Array  # scratch [coordinate]
    felt: Array  # scratch [lane]


class Riding(NamedTuple):
    """Tables of a film and the structure under it, of length zero without one. m: signals that the film does not own."""

    alike: Side
    against: Side
    numbers: Array  # see PITCH
    where: NDArray[np.int64]  # see TRAVEL
    places: Array  # [2, point] of the points on the slider
    weight: Array  # [coordinate] 1 / mass
    turn: Array  # [coordinate, 4] flow of place and velocity over a step, less one
    loss: Array  # [coordinate, 3] what the damper takes over a step, of q^2, q v, v^2
    pushed: NDArray[np.int64]  # coordinates that signals push
    column: Array  # [pushed, 2, m] what that moves them in a step
    push: Array  # [pushed, m] force
    signal: Array  # [m, m] flow of the signals over a step, less one
    begins: NDArray[np.int64]  # [read + 1] where the entries of a quantity begin
    entry: NDArray[np.int64]  # [entries] state
    value: Array  # [entries]
    summed: NDArray[np.int64]  # [1] 1: the sensors read sums over the points
    seen: Array  # scratch [direction, point] where the points are
    last: Array  # scratch, the step before
    gives: Array  # scratch, forces along the rows
    lost: Array  # scratch [3, point] of the stretch so far: mean friction times travel, times sliding; lost in the film
    moved: Array  # scratch [m]
    held: Array  # scratch [pushed]


def empty() -> Riding:
    """Tables of a rig without a film."""
    z, none = np.zeros, np.zeros(0, dtype=np.int64)
    return Riding(
        alike=Side(z((0, 0, BLOCK)), none, z((0, BLOCK)), z(0), z(0)),
        against=Side(z((0, 0, BLOCK)), none, z((0, BLOCK)), z(0), z(0)),
        numbers=z(0),
        where=none,
        places=z((2, 0)),
        weight=z(0),
        turn=z((0, 4)),
        loss=z((0, 3)),
        pushed=none,
        column=z((0, 2, 0)),
        push=z((0, 0)),
        signal=z((0, 0)),
        begins=none,
        entry=none,
        value=z(0),
        summed=none,
        seen=z((0, 0)),
        last=z((0, 0)),
        gives=z((0, 0)),
        lost=z((3, 0)),
        moved=z(0),
        held=z(0),
    )


def tables(system: System, step: float, read: Array) -> Riding:
    """The tables of a system with a film for steps of `step` s; `read` [quantity, n]: rows of what the sensors read."""
    film = system.film
    assert film is not None
    nq, first = len(system.coordinates), system.names.index(on(system.coordinates[0]))
    directions = film.directions
    m = first - system.one
    turn, loss = np.zeros((nq, 4)), np.zeros((nq, 3))
    mass, force = np.diag(system.mass), system.force[:, system.one : first]
    pushed = np.flatnonzero(force.any(axis=1))
    signals = np.ascontiguousarray(system.signals[:m, system.one : first])
    column = np.zeros((len(pushed), 2, m))
    for i in range(nq):
        A = np.zeros((2 + m, 2 + m))
        A[0, 1] = 1.0
        A[1, :2] = -system.stiffness[i, i] / mass[i], -system.damping[i, i] / mass[i]
        A[1, 2:], A[2:, 2:] = force[i] / mass[i], signals
        own = A[:2, :2].copy()
        E = expm.ladder(own, step)
        turn[i] = E[0].ravel()
        form = np.array([[[0.0, 0.0], [0.0, system.damping[i, i]]]])
        taken = ledger.work(ledger.at_nodes(own, np.eye(2), step / 2.0 ** (len(E) - 1)), form, step, E)[0, 0]
        loss[i] = taken[0, 0], 2.0 * taken[0, 1], taken[1, 1]
        for p in np.flatnonzero(pushed == i).tolist():
            column[p] = expm.ladder(A, step)[0][:2, 2:]
    entries = np.nonzero(read)
    sums = first + nq + np.arange(len(SUMS))
    return Riding(
        alike=_side(film, 1.0),
        against=_side(film, -1.0),
        numbers=np.array([film.pitch, film.stiffness, film.damping, film.shear, film.mu]),
        where=np.array([system.names.index(film.travel), first, film.points, directions, film.damping > 0.0]),
        places=np.array([film.x, film.y]),
        weight=1.0 / mass,
        turn=turn,
        loss=loss,
        pushed=pushed,
        column=column,
        push=np.ascontiguousarray(force[pushed]),
        signal=expm.ladder(signals, step)[0],
        begins=np.concatenate([[0], np.cumsum(np.count_nonzero(read, axis=1))]).astype(np.int64),
        entry=entries[1].astype(np.int64),
        value=read[entries],
        summed=np.array([np.isin(entries[1], sums).any()], dtype=np.int64),
        seen=zeros((directions, film.points)),
        last=zeros((directions, film.points)),
        gives=zeros((directions, film.points)),
        lost=np.zeros((3, film.points)),
        moved=np.zeros(m),
        held=np.zeros(len(pushed)),
    )


def _side(film: Film, parity: float) -> Side:
    """The coordinates of one parity."""
    which = np.flatnonzero(film.parity == parity)
    lanes = film.directions * (film.points // 2)
    rows = zeros((len(film.rows), len(which), -(-lanes // BLOCK) * BLOCK))
    rows[:, :, :lanes] = film.rows[:, :, which].transpose(0, 2, 1, 3).reshape(*rows.shape[:2], -1)
    return Side(rows, which, zeros(rows.shape[1:]), zeros(len(which)), zeros(rows.shape[2]))


@inlined
def _felt(side, x, low, share):
    """What the coordinates of one side do at the points, in side.felt."""
    for j in range(side.which.shape[0]):
        side.values[j] = x[side.which[j]]
    blend(side.rows[low], side.rows[low + 1], share, side.values, side.now, side.felt)


@inlined
def _pushed(side, forces):
    """forces[coordinate] of one side = what side.felt comes to."""
    across(side.now, side.felt, side.values)
    for j in range(side.which.shape[0]):
        forces[side.which[j]] = side.values[j]


@inlined
def look(own, x):
    """Where the points are, in own.seen, and the rows there; false where the slider is off the structure."""
    place = x[own.where[TRAVEL]] / own.numbers[PITCH]
    low = min(int(max(place, 0.0)), own.alike.rows.shape[0] - 2)
    _felt(own.alike, x, low, place - low)
    _felt(own.against, x, low, place - low)
    pairs = own.seen.shape[1] // 2
    for direction in range(own.seen.shape[0]):
        side = -1.0 if direction == 2 else 1.0
        for i in range(pairs):
            both, other = own.alike.felt[direction * pairs + i], own.against.felt[direction * pairs + i]
            own.seen[direction, i] = both + other
            own.seen[direction, pairs + i] = side * (both - other)
    return place >= -1e-9 and place <= own.alike.rows.shape[0] - 1 + 1e-9


@inlined
def push(own, forces):
    """forces[coordinate] = what own.gives comes to."""
    pairs = own.seen.shape[1] // 2
    for direction in range(own.seen.shape[0]):
        side = -1.0 if direction == 2 else 1.0
        for i in range(pairs):
            one, image = own.gives[direction, i], side * own.gives[direction, pairs + i]
            own.alike.felt[direction * pairs + i] = one + image
            own.against.felt[direction * pairs + i] = one - image
    _pushed(own.alike, forces)
    _pushed(own.against, forces)


@inlined
def flow(own, x, nq, one):
    """Carry coordinates and signals over a step without the film. Returns the work of what signals push."""
    m, work = own.moved.shape[0], 0.0
    for p in range(own.pushed.shape[0]):
        own.held[p] = x[own.pushed[p]]
    for i in range(nq):
        q, v = x[i], x[nq + i]
        x[i] = q + (own.turn[i, 0] * q + own.turn[i, 1] * v)
        x[nq + i] = v + (own.turn[i, 2] * q + own.turn[i, 3] * v)
    for j in range(m):
        own.moved[j] = 0.0
        for k in range(m):
            own.moved[j] += own.signal[j, k] * x[one + k]
    for p in range(own.pushed.shape[0]):
        i, mean = own.pushed[p], 0.0
        for j in range(m):
            x[i] += own.column[p, 0, j] * x[one + j]
            x[nq + i] += own.column[p, 1, j] * x[one + j]
            mean += own.push[p, j] * (x[one + j] + 0.5 * own.moved[j])
        work += mean * (x[i] - own.held[p])
    for j in range(m):
        x[one + j] += own.moved[j]
    return work


@inlined
def damped(own, x, nq):
    """What the dampers take over a step that begins at x."""
    s = 0.0
    for i in range(nq):
        q, v = x[i], x[nq + i]
        s += own.loss[i, 0] * q * q + own.loss[i, 1] * q * v + own.loss[i, 2] * v * v
    return s


@inner
def press(own, x, travelled, h):
    """What every point presses with and what its friction is, after a step in which the slider has travelled so far.

    Returns how many have opened.
    """
    points = own.where[POINTS]
    first = own.where[FIRST] + own.weight.shape[0] + len(SUMS)
    k, c, shear, mu = own.numbers[STIFFNESS], own.numbers[DAMPING], own.numbers[SHEAR], own.numbers[FRICTIONAL]
    lateral, is_damped = own.where[DIRECTIONS] == 3, own.where[DAMPED] == 1
    compressed = first + points * own.where[DIRECTIONS]
    opened = 0
    for i in range(points):
        d, before = own.seen[0, i], x[first + i]
        force = k * max(d, 0.0)
        if is_damped:
            old, older = own.last[0, i], x[compressed + points + i]
            pressed = max(force + c * (3.0 * d - 4.0 * old + older) / (2.0 * h), 0.0) if d > 0.0 else 0.0
            own.lost[2, i] += 0.5 * (before - k * x[compressed + i] + pressed - force) * (d - old)
            x[compressed + i], x[compressed + points + i] = max(d, 0.0), old
            force = pressed
        opened += int(before > 0.0 and force == 0.0)
        x[first + i], own.gives[0, i] = force, -force
        at, most = first + points + i, mu * force
        slid, f = travelled - (own.seen[1, i] - own.last[1, i]), x[at]
        new = f + shear * slid
        if lateral:
            aside, g = own.last[2, i] - own.seen[2, i], x[at + points]
            new_aside = g + shear * aside
            size = np.sqrt(new * new + new_aside * new_aside)
            if size > most:
                new, new_aside = new * (most / size), new_aside * (most / size)
            own.lost[1, i] += 0.5 * (g + new_aside) * (aside - (new_aside - g) / shear)
            x[at + points], own.gives[2, i] = new_aside, new_aside
        else:
            new = min(max(new, -most), most)
        own.lost[0, i] += 0.5 * (f + new) * travelled
        own.lost[1, i] += 0.5 * (f + new) * (slid - (new - f) / shear)
        x[at], own.gives[1, i] = new, new
    return opened


@inlined
def total(own, x, opened):
    """Sums over the points."""
    first, points = own.where[FIRST] + own.weight.shape[0], own.where[POINTS]
    normal, friction, closed, along, aside = 0.0, 0.0, 0, 0.0, 0.0
    for i in range(points):
        force = x[first + len(SUMS) + i]
        normal += force
        friction += x[first + len(SUMS) + points + i]
        closed += int(force > 0.0)
        along += own.places[0, i] * force
        aside += own.places[1, i] * force
    x[first + NORMAL], x[first + FRICTION], x[first + FRACTION] = normal, friction, closed / points
    x[first + CENTRE_X] = along / normal if normal > 0.0 else 0.0
    x[first + CENTRE_Y] = aside / normal if normal > 0.0 else 0.0
    x[first + OPENINGS] += opened


@inlined
def read(own, x, values):
    """values[quantity] = what the sensors read at x."""
    for s in range(values.shape[0]):
        value = 0.0
        for e in range(own.begins[s], own.begins[s + 1]):
            value += own.value[e] * x[own.entry[e]]
        values[s] = value


@inlined
def book(own, energy):
    """Add what the points have been given and have lost in this stretch."""
    for i in range(own.where[POINTS]):
        energy[0] += own.lost[0, i]
        energy[1] += own.lost[1, i]
        energy[2] += own.lost[2, i]
        for part in range(3):
            own.lost[part, i] = 0.0


@inner
def stretch(shape, t, w, state, log, seg, plan, ticks):
    """Part: carry the state until the end of the ticks asked for. Returns -1; -2 where the slider leaves the rig."""
    own, ic, fc, x, energy = t.film, state.ic, state.fc, state.x, state.energy
    substeps, booking, emitting, origin = plan.substeps, plan.booking, plan.emitting, ic[REACHED]
    n, nq, h = x.shape[0], own.weight.shape[0], t.step[0] / substeps
    travel, first, one = own.where[TRAVEL], own.where[FIRST], own.where[FIRST] - own.moved.shape[0]
    begin, end = w.values[0], w.values[1]
    tick, done, opened = ic[TICK], int(fc[PLACE] * substeps + 0.5), 0
    within = look(own, x)
    if emitting:
        read(own, x, begin)
    while within and tick < ticks and not (emitting and crowded(t, 0, seg, ticks - tick)):
        for i in range(nq):
            x[nq + i] += 0.5 * h * own.weight[i] * x[first + i]
        if booking:
            energy[2] += damped(own, x, nq)
        travelled = x[travel]
        energy[3] += flow(own, x, nq, one)
        travelled = x[travel] - travelled
        for direction in range(own.seen.shape[0]):
            for i in range(own.seen.shape[1]):
                own.last[direction, i] = own.seen[direction, i]
        within = look(own, x)
        opened += press(own, x, travelled, h)
        push(own, x[first : first + nq])
        for i in range(nq):
            x[nq + i] += 0.5 * h * own.weight[i] * x[first + i]
        done += 1
        if done == substeps or (emitting and own.summed[0]):
            total(own, x, opened)
            opened = 0
        if emitting:
            read(own, x, end)
            emit_chord(begin, end, (tick - origin) * t.step[0] + (done - 1) * h, h, seg)
            for s in range(begin.shape[0]):
                begin[s] = end[s]
        if done == substeps:
            for i in range(n):
                log.out[tick, i] = x[i]
            log.modes[tick] = 0
            tick, done = tick + 1, 0
    if opened:
        total(own, x, opened)
    book(own, energy)
    ic[TICK], fc[PLACE] = tick, done / substeps
    return -1 if within else -2
