"""Steps of the method kick, for a film of contact points on a structure (rig.model.film).

    v += h/2 M^-1 F;   (q, v) <- exact flow of the structure, s <- s + travel;   F of the film there;   v += h/2 M^-1 F

Between two kicks the structure follows its exact flow. If its coordinates are uncoupled modes, the position and
velocity of each follow a damped rotation; otherwise a propagator of all states is used. The pressures of
the points depend on their positions; their friction depends on the distance travelled since the previous step. A kick
changes neither, so each part is solved exactly, and their composition is of second order: the energy of a point that
opens and closes neither grows nor decays. No opening is located. Under a light slider its largest error comes from the
stiff film. The positions used for the pressure are therefore extrapolated by h^2/12 along the acceleration that the
pressure gives the slider. This removes that error from the potential of film and slider (Takahashi and Imada) and needs
no further product with the rows. The compression speed of a damped film is computed from the last three positions,
because the velocity at the end of a step is known only after its kick. A force held over the step would feed energy
into the vibration at any step.

Energy: the friction of a step is the mean of its ends. The work of the drive on a point, f times the travel, is then
exactly the sum of what it loses in sliding, stores in shear and passes to the structure. The residual is the difference
between the work of the kicks and that of the springs, of second order in the step.

Most of the computing time goes into two products: the interpolation of the rows together with the positions of the
points, and the forces of the points on the coordinates (rig.solve.column_blocks). The rows of points that stay in place
are constant.

Source: Strang, SIAM J. Numer. Anal. 5 (1968) 506; Hairer, Lubich and Wanner, Geometric Numerical Integration, II.5.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from rig.compiled.kernel import by_address, inlined, inner
from rig.solve.column_blocks import BLOCK, LANE, across, along, blend, copy, lanes, total
from rig.solve.forces import coefficient
from rig.solve.segment_output import nearly_full

Array = NDArray[np.float64]
SUMS = ("normal", "friction", "fraction", "centre_x", "centre_y", "openings")
"""Sums over the points: normal and friction force [N], share of closed points, centre of pressure [m], number of
openings so far."""
NORMAL, FRICTION, FRACTION, CENTRE_X, CENTRE_Y, OPENINGS = range(len(SUMS))
OPEN, STICKS, SLIDES = 0.0, 1.0, 2.0
"""Contact states of a point."""
COUNTED = 2.0**-20
"""Exact increment of the state per opening; a million openings stay below `clock.limit`."""

GROUP = 5
"""Number of steps that one output polynomial covers. At five sixths of a radian per step, which is 66 kHz at 2 us, its
error is 1 %; that of chords is 9 %."""
_EDGE = 1e-11
"""Distance beyond the edge that rounding may cause [m]."""


class SymmetryClass(NamedTuple):
    """Coordinates of one symmetry: they move both sides of the line of travel alike, or in opposite directions.

    A lane is one direction of a pair of mirrored points; of a film without mirror symmetry, of one point. Its
    coordinates are then all in one class.
    """

    rows: Array  # [place, coordinate, lane]
    which: NDArray[np.int64]  # [coordinate] number
    rise: Array  # scratch [coordinate, lane] rows at the next place minus rows at the place below
    now: Array  # scratch [coordinate, lane] rows at this instant
    back: Array  # [lane, coordinate] the same rows of points that stay in place; of length zero for others
    values: Array  # scratch [coordinate]
    felt: Array  # scratch [lane]


class FilmTables(NamedTuple):
    """Tables of a film and of the structure under it; of length zero without a film.

    m: number of driving states, which are neither coordinates nor speeds nor states of network or film. Of mirrored
    points the first half comes first, then their images.
    """

    symmetric: SymmetryClass
    antisymmetric: SymmetryClass
    mirrored: int  # 1: the second half of the points are images of the first
    travel: int  # index of the state of the travel
    slid: int  # of the distance slid
    first: int  # of the first of the states that hold the forces on the coordinates
    points: int  # number
    directions: int  # number
    pitch: float  # between two places [m]; 0: the points stay in place
    longest: float  # longest travel [m]
    stiffness: Array  # [point, N/m]
    shear: Array  # [point, N/m] stiffness
    give: Array  # [point, m/N] one over it
    resist: Array  # [point] damping [N s/m] over 2 h; of length zero without damping
    mu: Array  # [point] at rest
    code: NDArray[np.int64]  # [point] of the friction law
    law: Array  # [point, numbers]; of length zero where each point has one coefficient in stick and slip
    reach: Array  # [point] distance slid over that of the drive
    told: int  # 1: slip speed and contact state of each point are states
    below: NDArray[np.int64]  # scratch [1] the place at which `rise` begins; -1: none yet
    share: Array  # scratch [1] share of `rise` in the present rows
    places: Array  # [2, point] positions of the points on the slider [m]
    kick: Array  # [coordinate] h / 2 / mass
    kicks: Array  # [coordinate, coordinate] h / 2 mass^-1 of coupled masses, columns padded; else of length zero
    turn: Array  # [4, coordinate] propagator of position and velocity over a step, minus one
    loss: Array  # [3, coordinate] energy dissipated by the damper over a step: factors of q^2, q v, v^2
    damped: Array  # scratch [coordinate] energy dissipated by the damper since it was last added
    before: Array  # scratch [coordinate]
    pushed: NDArray[np.int64]  # coordinates on which driving states act; all, if these are many
    column: Array  # [2, m, pushed] their change of position and velocity in a step
    push: Array  # [m, pushed] force
    pushes: Array  # scratch [3, pushed] changes of position and velocity, force or work; padded with zeros
    signal: Array  # [m, m] propagator of the driving states over a step, minus one
    whole: Array  # [n, n] of a coupled structure: its propagator minus one, transposed, padded; else of length zero
    terms: NDArray[np.int64]  # [form] term of the energy balance
    forms: Array  # [form, rows, BLOCK] energy over a step as a form x.W x: of each block the rows from its first on
    changed: Array  # scratch
    part: Array  # scratch [BLOCK]
    begins: NDArray[np.int64]  # [output + 1] index of the first entry of each output
    entry: NDArray[np.int64]  # [entries] state
    value: Array  # [entries]
    summed: NDArray[np.int64]  # [1] 1: sensors read sums over the points
    seen: Array  # scratch [direction, point] positions of the points
    last: Array  # scratch, positions at the previous step
    pull: Array  # scratch [point] friction at the end of the step
    most: Array  # scratch [point] largest friction
    lost: Array  # scratch [3, point] work since last added: friction times travel, friction times sliding, film damper
    moved: Array  # scratch [m]
    begun: Array  # scratch [2, m] driving states at the begin of the tick, and their change since
    held: Array  # scratch [pushed]
    slider_rows: Array  # [slider coordinate, point] normal rows of the slider's coordinates: the same at every place
    stiff_rows: Array  # the same times stiffness over that of the first point
    advance: Array  # [slider coordinate] h^2 / 12 / mass
    ahead: Array  # scratch [slider coordinate]
    pressed: Array  # scratch [point]
    fits: Array  # [steps, GROUP + 1, GROUP + 1] coefficients of the polynomial through values at the ends of steps
    values: Array  # scratch [GROUP + 1, read] outputs at these ends


@inner
def _update_rise(side, low):
    """Write the difference between the rows at place `low` + 1 and at place `low` to side.rise."""
    here, there = side.rows[low], side.rows[low + 1]
    for j in range(here.shape[0]):
        for lane in range(here.shape[1]):
            side.rise[j, lane] = there[j, lane] - here[j, lane]


@inlined
def _interpolate(side, x, base, share):
    """Interpolate the rows of one side and write the displacements at the points to side.felt."""
    which, values = side.which, side.values
    for j in range(which.shape[0]):
        values[j] = x[which[j]]
    blend(base, side.rise, share, values, side.now, side.felt)


@inlined
def _see(side, x):
    """Write the displacements at points that stay in place to side.felt."""
    which, values = side.which, side.values
    for j in range(which.shape[0]):
        values[j] = x[which[j]]
    along(side.now, values, side.felt)


@inner
def _see_in_place(own, x):
    """Compute the positions of points that stay in place, without mirror symmetry."""
    side, points = own.symmetric, own.points
    along(side.now, x, side.felt)
    for direction in range(own.seen.shape[0]):
        seen, last, felt = own.seen[direction], own.last[direction], side.felt[direction * points :]
        for i in range(points):
            last[i] = seen[i]
        for i in range(points):
            seen[i] = felt[i]


@inner
def _press_in_place(own, x, forces):
    """The generalised forces of points that stay in place, without mirror symmetry."""
    side, points = own.symmetric, own.points
    first, felt = own.first + own.kick.shape[0] + len(SUMS), side.felt
    for i in range(points):
        felt[i] = -x[first + i]
    copy(points * (own.directions - 1), x[first + points :], felt[points:])
    along(side.back, felt, side.values)
    copy(forces.shape[0], side.values, forces)


@inlined
def _sum_forces(side, forces):
    """forces[coordinate] of one side = the generalised forces of the values in side.felt."""
    which, values = side.which, side.values
    if side.back.shape[0]:
        along(side.back, side.felt, values)
    else:
        across(side.now, side.felt, values)
    for j in range(which.shape[0]):
        forces[which[j]] = values[j]


@inlined
def _interpolated_rows(own, x, anew):
    """Interpolate the rows at the present place of the slider. Returns False if it is off the structure."""
    travel = x[own.travel]
    place = travel / own.pitch
    low = min(int(max(place, 0.0)), own.symmetric.rows.shape[0] - 2)
    if low != own.below[0]:
        _update_rise(own.symmetric, low)
        _update_rise(own.antisymmetric, low)
        own.below[0] = low
        anew = True
    share = place - low
    part = share if anew else share - own.share[0]
    _interpolate(own.symmetric, x, own.symmetric.rows[low] if anew else own.symmetric.now, part)
    _interpolate(own.antisymmetric, x, own.antisymmetric.rows[low] if anew else own.antisymmetric.now, part)
    own.share[0] = share
    return travel >= -_EDGE and travel <= own.longest + _EDGE


@inner
def locate_points(own, x, anew):
    """Compute the positions of the points, own.seen, and the rows there. Returns False if the slider is off.

    The positions before are kept in own.last.

    The rows are those of the previous step plus a share of the rise; both stay in the fastest cache of the processor.
    `anew`: interpolate them from the table, as at the begin of every tick, so that they do not depend on the past.
    """
    within = True
    if own.pitch == 0.0 and not own.mirrored:
        _see_in_place(own, x)
        return True
    if own.pitch > 0.0:
        within = _interpolated_rows(own, x, anew)
    else:
        _see(own.symmetric, x)
        if own.mirrored:
            _see(own.antisymmetric, x)
    lane = own.seen.shape[1]
    if own.mirrored:
        lane = lane // 2
    for direction in range(own.seen.shape[0]):
        seen, last = own.seen[direction], own.last[direction]
        lanes = slice(direction * lane, (direction + 1) * lane)
        both = own.symmetric.felt[lanes]
        copy(seen.shape[0], seen, last)
        if own.mirrored:
            side, other = -1.0 if direction == 2 else 1.0, own.antisymmetric.felt[lanes]
            for i in range(lane):
                seen[i] = both[i] + other[i]
                seen[lane + i] = side * (both[i] - other[i])
        else:
            copy(lane, both, seen)
    return within


@inlined
def generalised_forces(own, x, forces):
    """forces[coordinate] = the generalised forces of the pressures and frictions of the points."""
    if own.pitch == 0.0 and not own.mirrored:
        _press_in_place(own, x, forces)
        return
    first, points = own.first + own.kick.shape[0] + len(SUMS), own.points
    lane = own.seen.shape[1]
    if own.mirrored:
        lane = lane // 2
    for direction in range(own.seen.shape[0]):
        force, lanes = x[first + direction * points :], slice(direction * lane, (direction + 1) * lane)
        both, way = own.symmetric.felt[lanes], -1.0 if direction == 0 else 1.0  # pressure acts against its row
        if own.mirrored:
            side, other = -1.0 if direction == 2 else 1.0, own.antisymmetric.felt[lanes]
            for i in range(lane):
                own_force, image = way * force[i], way * side * force[lane + i]
                both[i], other[i] = own_force + image, own_force - image
        else:
            for i in range(lane):
                both[i] = way * force[i]
    _sum_forces(own.symmetric, forces)
    if own.mirrored:
        _sum_forces(own.antisymmetric, forces)


@inlined
def kick_coordinates(own, speeds, forces):
    """Add the change of velocity by half a step of the forces."""
    kick = own.kick
    if own.kicks.shape[0]:
        along(own.kicks, forces, own.before)
        for i in range(kick.shape[0]):
            speeds[i] += own.before[i]
    else:
        for i in range(kick.shape[0]):
            speeds[i] += kick[i] * forces[i]


@inner
def propagate_coupled(own, x, energy):
    """Kick the coordinates by half a step, then propagate everything but the film over a whole step.

    For a structure whose coordinates are coupled by its own matrices, or with a network. Adds to the energy balance.
    """
    nq, m, n = own.kick.shape[0], own.moved.shape[0], own.first
    kick_coordinates(own, x[nq : 2 * nq], x[n : n + nq])
    whole, changed, places = own.whole, own.changed, x[:nq]
    for p in range(own.pushed.shape[0]):
        own.held[p] = places[own.pushed[p]]
    along(whole, x[:n], changed)
    for form in range(own.terms.shape[0]):
        taken, first, rows = 0.0, 0, own.forms[form]
        for begin in range(0, n, BLOCK):
            along(rows[first : first + n - begin], x[begin:n], own.part)
            first += n - begin
            for i in range(min(BLOCK, n - begin)):
                taken += x[begin + i] * own.part[i]
        energy[own.terms[form]] += taken
    signals = x[n - m : n]
    for p in range(own.pushed.shape[0]):
        i, mean = own.pushed[p], 0.0
        for j in range(m):
            mean += own.push[j, p] * (signals[j] + 0.5 * changed[n - m + j])
        energy[3] += mean * changed[i]
    for i in range(n):
        x[i] += changed[i]
    for j in range(m):
        own.begun[1, j] += changed[n - m + j]


@inlined
def propagate_structure(own, x, first_signal):
    """Kick the coordinates by half a step, then propagate everything but the film over a whole step.

    The energy that the dampers dissipate is added to own.damped. Returns the work of the driving states.
    """
    nq, m, work = own.kick.shape[0], own.moved.shape[0], 0.0
    places, speeds, forces = x[:nq], x[nq : 2 * nq], x[first_signal + m : first_signal + m + nq]
    kick, taken = own.kick, own.damped  # locals: read from the record once, not at every store
    qq, qv, vv = own.loss[0], own.loss[1], own.loss[2]
    by_place, by_speed, turned, slowed = own.turn[0], own.turn[1], own.turn[2], own.turn[3]
    if own.pushed.shape[0] == nq:
        copy(nq, places, own.held)
    else:
        for p in range(own.pushed.shape[0]):
            own.held[p] = places[own.pushed[p]]
    before = own.before
    for i in range(nq):  # a loop that writes one array is compiled to vectors
        before[i] = speeds[i] + kick[i] * forces[i]
    for i in range(nq):
        taken[i] += qq[i] * places[i] * places[i] + qv[i] * places[i] * before[i] + vv[i] * before[i] * before[i]
    for i in range(nq):
        speeds[i] = before[i] + (turned[i] * places[i] + slowed[i] * before[i])
    for i in range(nq):
        places[i] += by_place[i] * places[i] + by_speed[i] * before[i]
    signals, moved = x[first_signal : first_signal + m], own.moved
    for j in range(m):
        rate, s = own.signal[j], 0.0
        for k in range(m):
            s += rate[k] * signals[k]
        moved[j] = s
    if own.pushed.shape[0] == nq:
        work = _push_all(own, signals, places, speeds)
    else:
        for p in range(own.pushed.shape[0]):
            i, mean, further, faster = own.pushed[p], 0.0, 0.0, 0.0
            for j in range(m):
                further += own.column[0, j, p] * signals[j]
                faster += own.column[1, j, p] * signals[j]
                mean += own.push[j, p] * (signals[j] + 0.5 * moved[j])
            work += mean * (places[i] + further - own.held[p])
            places[i] += further
            speeds[i] += faster
    for j in range(m):
        signals[j] += moved[j]
        own.begun[1, j] += moved[j]
    return work


@inlined
def _push_all(own, signals, places, speeds):
    """Move all coordinates by the driving states over a step. Returns the work of these."""
    further, faster, mean, held = own.pushes[0], own.pushes[1], own.pushes[2], own.held
    count = places.shape[0]
    for p in range(count):
        further[p] = 0.0
    for p in range(count):
        faster[p] = 0.0
    for p in range(count):
        mean[p] = 0.0
    for j in range(signals.shape[0]):
        now, middle = signals[j], signals[j] + 0.5 * own.moved[j]
        far, fast, push = own.column[0, j], own.column[1, j], own.push[j]
        for p in range(count):
            further[p] += far[p] * now
        for p in range(count):
            faster[p] += fast[p] * now
        for p in range(count):
            mean[p] += push[p] * middle
    for p in range(count):
        mean[p] *= places[p] + further[p] - held[p]
    for p in range(count):
        places[p] += further[p]
    for p in range(count):
        speeds[p] += faster[p]
    work = lanes(mean)
    for p in range(LANE, count, LANE):
        work = work + lanes(mean[p:])
    return total(work)


@inner
def contact_forces(own, x, travelled, h):
    """Compute pressure and friction of every point after a step in which the slider travelled by `travelled` [m].

    Returns the number of points that opened.
    """
    points, directions = own.points, own.directions
    first = own.first + own.kick.shape[0] + len(SUMS)
    k, shear, give, mu, reach = own.stiffness, own.shear, own.give, own.mu, own.reach
    normal, friction = x[first : first + points], x[first + points : first + 2 * points]
    deep, place, carried, was = own.pressed, own.seen[0], own.seen[1], own.last[1]
    given, slid_off, pull, largest = own.lost[0], own.lost[1], own.pull, own.most
    for i in range(points):
        deep[i] = max(place[i], 0.0)
    across(own.stiff_rows, deep, own.ahead)
    copy(points, place, deep)
    for r in range(own.ahead.shape[0]):
        row, by = own.slider_rows[r], k[0] * own.advance[r] * own.ahead[r]
        for i in range(points):
            deep[i] -= by * row[i]
    opened = 0
    if own.resist.shape[0] == 0:
        for i in range(points):
            force = k[i] * max(deep[i], 0.0)
            opened += int((normal[i] > 0.0) & (force == 0.0))
            normal[i] = force
    else:
        c, kept = own.resist, first + points * directions
        compressed, older = x[kept : kept + points], x[kept + points : kept + 2 * points]
        old, dashed = own.last[0], own.lost[2]
        for i in range(points):
            force, before = k[i] * max(deep[i], 0.0), normal[i]
            resisted = max(force + c[i] * (3.0 * place[i] - 4.0 * old[i] + older[i]), 0.0) if deep[i] > 0.0 else 0.0
            dashed[i] += 0.5 * (before - k[i] * compressed[i] + resisted - force) * (place[i] - old[i])
            opened += int((before > 0.0) & (resisted == 0.0))
            normal[i], compressed[i], older[i] = resisted, max(deep[i], 0.0), old[i]
    if directions == 2:
        after = first + points * (4 if own.resist.shape[0] else 2)
        speed, state = x[after : after + points * own.told], x[after + points : after + points + points * own.told]
        if own.law.shape[0]:
            for i in range(points):  # the speed here from its means over the last two steps
                most, slip = mu[i] * normal[i], reach[i] * travelled - (carried[i] - was[i])
                if state[i] == SLIDES:
                    now = abs(1.5 * slip / h - 0.5 * speed[i])
                    most = coefficient(own.code[i], own.law[i], now) * normal[i]
                largest[i], pull[i] = most, min(max(friction[i] + shear[i] * slip, -most), most)
        else:
            for i in range(points):
                most, slip = mu[i] * normal[i], reach[i] * travelled - (carried[i] - was[i])
                pull[i] = min(max(friction[i] + shear[i] * slip, -most), most)
        for i in range(points):
            given[i] += 0.5 * (friction[i] + pull[i]) * (reach[i] * travelled)
        if own.told:
            per_second = 1.0 / h
            for i in range(points):
                slip = reach[i] * travelled - (carried[i] - was[i])
                most = largest[i] if own.law.shape[0] else mu[i] * normal[i]
                state[i] = OPEN if normal[i] == 0.0 else SLIDES if abs(pull[i]) >= most else STICKS
                if not own.law.shape[0] or state[i] != SLIDES:  # a falling law over what the shear yields is unstable
                    slip -= give[i] * (pull[i] - friction[i])
                speed[i] = per_second * slip
        for i in range(points):
            slip = reach[i] * travelled - (carried[i] - was[i])
            slid_off[i] += 0.5 * (friction[i] + pull[i]) * (slip - give[i] * (pull[i] - friction[i]))
        copy(points, pull, friction)
    else:
        lateral = x[first + 2 * points : first + 3 * points]
        aside, was_aside = own.seen[2], own.last[2]
        for i in range(points):
            way = reach[i] * travelled
            most, slid, f = mu[i] * normal[i], way - (carried[i] - was[i]), friction[i]
            slid_aside, g = was_aside[i] - aside[i], lateral[i]
            new, new_aside = f + shear[i] * slid, g + shear[i] * slid_aside
            size = math.sqrt(new * new + new_aside * new_aside)
            part = most / size if size > most else 1.0
            new, new_aside = part * new, part * new_aside
            given[i] += 0.5 * (f + new) * way
            slid_off[i] += 0.5 * (f + new) * (slid - give[i] * (new - f))
            slid_off[i] += 0.5 * (g + new_aside) * (slid_aside - give[i] * (new_aside - g))
            friction[i], lateral[i] = new, new_aside
    return opened


@inner
def sum_over_points(own, x, opened):
    """Update the sums over the points."""
    first, points = own.first + own.kick.shape[0], own.points
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
    x[first + OPENINGS] += COUNTED * opened


@inner
def film_outputs(own, x, values):
    """values[output] = the outputs at x, as many as `values` holds."""
    begins, entry, value = own.begins, own.entry, own.value
    for s in range(values.shape[0]):
        total = 0.0
        for e in range(begins[s], begins[s + 1]):
            total += value[e] * x[entry[e]]
        values[s] = total


@inlined
def emit_segment(own, values, steps, start, length, seg):
    """Write one segment over `steps` steps: the polynomial through the outputs at the ends of these steps."""
    at, fit = seg.count[0], own.fits[steps - 1]
    seg.count[0] = at + 1
    for s in range(values.shape[1]):
        coef = seg.coef[at, s]
        for k in range(coef.shape[0]):
            c = 0.0
            if k <= steps:
                for j in range(steps + 1):
                    c += fit[k, j] * values[j, s]
            coef[k] = c
    seg.start[at], seg.length[at] = start, length


@inlined
def add_collected_work(own, energy):
    """Add the work that dampers and points have collected to the energy balance and reset it."""
    for i in range(own.damped.shape[0]):
        energy[2] += own.damped[i]
        own.damped[i] = 0.0
    for i in range(own.points):
        energy[0] += own.lost[0, i]
        energy[1] += own.lost[1, i]
        energy[2] += own.lost[2, i]
        for part in range(3):
            own.lost[part, i] = 0.0


@by_address
def stretch(shape, t, w, state, log, seg, plan, ticks):
    """Advance the state to the end of the ticks; a part (rig.solve.specialised).

    Returns -1, or -2 if the slider leaves the structure.
    """
    own, now, x, energy = t.film, state.progress[0], state.x, state.energy
    substeps, emitting, origin = plan.substeps, plan.emitting, now.reached
    n, nq, h = x.shape[0], own.kick.shape[0], t.step[0] / substeps
    slid, first, first_signal = own.slid, own.first, own.first - own.moved.shape[0]
    speeds, forces = x[nq : 2 * nq], x[first : first + nq]
    values, gathered = own.values, 0
    tick, done, opened = now.tick, int(now.place * substeps + 0.5), 0
    within = locate_points(own, x, True)
    if emitting:
        film_outputs(own, x, values[0])
    while within and tick < ticks and not (emitting and nearly_full(t, 0, seg, ticks - tick)):
        if done == 0:
            for j in range(own.moved.shape[0]):
                own.begun[0, j], own.begun[1, j] = x[first_signal + j], 0.0
        travelled = x[slid]
        if own.whole.shape[0]:
            propagate_coupled(own, x, energy)
        else:
            energy[3] += propagate_structure(own, x, first_signal)
        travelled = x[slid] - travelled
        within = locate_points(own, x, done == 0)
        opened += contact_forces(own, x, travelled, h)
        generalised_forces(own, x, forces)
        kick_coordinates(own, speeds, forces)
        done += 1
        if done == substeps:  # round once per tick: rounding at each of millions of steps would drift
            for j in range(own.moved.shape[0]):
                x[first_signal + j] = own.begun[0, j] + own.begun[1, j]
        if done == substeps or (emitting and own.summed[0]):
            sum_over_points(own, x, opened)
            opened = 0
        if emitting:
            gathered += 1
            film_outputs(own, x, values[gathered])
            if gathered == GROUP or done == substeps:
                emit_segment(
                    own, values, gathered, (tick - origin) * t.step[0] + (done - gathered) * h, gathered * h, seg
                )
                copy(values.shape[1], values[gathered], values[0])
                gathered = 0
        if done == substeps:
            copy(n, x, log.out[tick])
            log.modes[tick] = 0
            tick, done = tick + 1, 0
    if opened:
        sum_over_points(own, x, opened)
    add_collected_work(own, energy)
    now.tick, now.place = tick, done / substeps
    return -1 if within else -2
