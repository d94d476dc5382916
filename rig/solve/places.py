"""State, inputs and readings at several places of a step at once: one lane for each place.

Energy terms and outputs need them at three and five places of every step. Evaluated one after the other they took half
of the time of a run with sensors.
"""

from __future__ import annotations

from rig.compiled.kernel import inlined, inner
from rig.solve.column_blocks import LANE, alike, is_zero, lane, lanes, total, write
from rig.solve.energy_balance import RESISTOR
from rig.solve.expm import exponential_factors_of_lanes, has_lane_factors
from rig.solve.forces import STRIBECK, inputs, law_force, stribeck, write_sines
from rig.solve.segment_output import quartic_coefficients

PART = 5
"""Number of places of a step, or of a part of it, at which outputs are read: the first lanes."""


@inlined
def row_times(row, X):
    """The products row . x in each lane, summed in index order; X [length of the row, LANE]."""
    s = alike(0.0)
    for j in range(row.shape[0]):
        s = s + row[j] * lanes(X[j])
    return s


@inlined
def states_at(d, degree, places, X):
    """Write the states at `places` (lanes) of the polynomial d, of `degree`, to X [n, LANE]."""
    for i in range(X.shape[0]):
        value = alike(d[degree, i])
        for c in range(degree - 1, -1, -1):
            value = d[c, i] + places * value
        write(value, X[i])


@inlined
def fill_at(p, begin, end, T):
    """T of the products `begin` to `end` - 1 in each lane; as in rig.solve.forces."""
    for j in range(begin, end):
        value = lanes(p.values_at[p.place[0, j]])
        for f in range(1, p.place.shape[0]):
            value = value * lanes(p.values_at[p.place[f, j]])
        write(value, T[p.patches[0] + j])


@inlined
def early_products_at(t, mode_set, X, T, first, end):
    """As rig.solve.forces.early_products, at the states X; in lanes `first` to `end` - 1, numbers in the others."""
    p, V = t.products, t.products.values_at
    for j in range(X.shape[0]):
        write(lanes(X[j]), V[j])
    sine, versine = X.shape[0], X.shape[0] + p.sine.shape[0]
    normal = versine + p.versine.shape[0]
    for a in range(p.angles.shape[0]):
        angle = row_times(p.angles[a], X)
        write_sines(angle, first, end, V[sine + a])
        write_sines(0.5 * angle, first, end, V[versine + a])
        half = lanes(V[versine + a])
        write(-2.0 * half * half, V[versine + a])
    for a in range(p.presses.shape[0]):
        press = row_times(p.presses[a], X)
        for q in range(LANE):
            V[normal + p.normal.shape[0] + p.friction.shape[0] + a, q] = max(lane(press, q), 0.0)
    fill_at(p, 0, p.upto[0], T)
    if p.upto[2] > p.upto[0]:
        for k in range(p.normal.shape[0]):
            write(row_times(t.press[mode_set, k], X) + row_times(t.press_t[mode_set, k], T), V[normal + k])
        fill_at(p, p.upto[0], p.upto[1], T)


@inlined
def late_products_at(t, mode_set, X, T):
    """As rig.solve.forces.late_products, at the states X."""
    p = t.products
    if p.upto[2] > p.upto[1]:
        first = X.shape[0] + p.sine.shape[0] + p.versine.shape[0] + p.normal.shape[0]
        for q in range(p.friction.shape[0]):
            force = row_times(t.friction[mode_set, q], X) + row_times(t.friction_t[mode_set, q], T)
            write(force, p.values_at[first + q])
        fill_at(p, p.upto[1], p.upto[2], T)


@inlined
def friction_forces_at(t, mode_set, p, X, T):
    """Write the friction forces of patch p at the states X to T[p]; as rig.solve.forces.friction_force.

    For a patch whose load depends on the state and on the products in T alone.
    """
    forces = T[p]
    code, numbers, last = t.code[mode_set, p], t.numbers[mode_set, p], X.shape[0] - 1
    speed, load = t.law_speed[mode_set, p], t.law_load[mode_set, p]
    if t.sigma[mode_set, p] == 0.0 or code == 0:
        write(alike(0.0), forces)
        return
    N = alike(0.0)
    for j in range(t.sigma.shape[1], T.shape[0]):
        N = N + t.law_load_t[mode_set, p, j] * lanes(T[j])
    for j in range(last, -1, -1):
        N = N + load[j] * lanes(X[j])
    if code == STRIBECK:
        u = (-(numbers[2] * speed[last])) * lanes(X[last])
        for j in range(last):
            u = u - (numbers[2] * speed[j]) * lanes(X[j])
        if has_lane_factors(u):
            coarse, fine = exponential_factors_of_lanes(u)
            write(stribeck(N, numbers, coarse, fine), forces)
            return
    else:
        u = alike(0.0)
        for j in range(last, -1, -1):
            u = u + speed[j] * lanes(X[j])
    for q in range(LANE):
        forces[q] = law_force(code, numbers, lane(u, q), lane(N, q))


@inner
def inputs_at(t, mode_set, w, first, end):
    """Write the inputs at the states w.x_at to w.T_at; w.y2, w.T and w.scratch are overwritten.

    Only lanes `first` to `end` - 1 have to be right. What is evaluated one after the other, as coupled friction forces,
    laws with memory and sines are, would cost time in the others. There they are 0 or numbers, since what is no number
    is not removed by a weight of 0.
    """
    X, T, patches = w.x_at, w.T_at, t.sigma.shape[1]
    for k in range(T.shape[0]):
        write(alike(0.0), T[k])
    if t.coupled[mode_set] or t.memory.mu.shape[0] > 0:
        for q in range(first, end):
            for i in range(X.shape[0]):
                w.y2[i] = X[i, q]
            inputs(t, mode_set, w.y2, w.T, w.scratch)
            for k in range(T.shape[0]):
                T[k, q] = w.T[k]
    else:
        if T.shape[0] > patches:
            early_products_at(t, mode_set, X, T, first, end)
        for p in range(patches):
            friction_forces_at(t, mode_set, p, X, T)
        if T.shape[0] > patches:
            late_products_at(t, mode_set, X, T)


@inlined
def write_quartic(y, coef):
    """Write the quartic through the first five lanes of y to `coef` [degree]."""
    coef[0], coef[1], coef[2], coef[3], coef[4] = quartic_coefficients(
        lane(y, 0), lane(y, 1), lane(y, 2), lane(y, 3), lane(y, 4)
    )


@inner
def write_output_quartic(t, mode_set, s, X, T, coef):
    """Write the quartic through the first five lanes of output s to `coef` [degree]."""
    write_quartic(row_times(t.signals[mode_set, s], X) + row_times(t.signals_t[mode_set, s], T), coef)


@inner
def write_outputs(t, mode_set, w, states, values, first):
    """Write every output at `states` [LANE, n] of one mode set to values[output, first ...]."""
    X, needed = w.x_at, False
    for j in range(X.shape[0]):
        for q in range(LANE):
            X[j, q] = states[q, j]
    for k in range(values.shape[0]):
        needed = needed or t.output_needs_inputs[mode_set, k] != 0
    if needed:
        inputs_at(t, mode_set, w, 0, LANE)
    for k in range(values.shape[0]):
        y = row_times(t.signals[mode_set, k], X)
        if t.output_needs_inputs[mode_set, k]:
            y = y + row_times(t.signals_t[mode_set, k], w.T_at)
        write(y, values[k, first : first + LANE])


@inner
def add_powers(t, mode_set, X, T, weights, scale, energy):
    """Add the powers at the states X, weighted by `scale` times `weights` [LANE], to the energy terms."""
    nq, patches = t.damping.shape[1], t.slip.shape[0]
    share = lanes(weights) * scale
    for p in range(patches):
        force = share * (row_times(t.friction[mode_set, p], X) + row_times(t.friction_t[mode_set, p], T))
        energy[0] += total(force * row_times(t.surface[p], X))
        energy[1] += total(force * row_times(t.slip[p], X))
    for i in range(nq):
        v = share * lanes(X[nq + i])
        energy[2] += total(v * row_times(t.damping[mode_set, i], X[nq : 2 * nq]))
        if not (is_zero(t.force[i]) and is_zero(t.force_t[i])):
            energy[3] += total(v * (row_times(t.force[i], X) + row_times(t.force_t[i], T[patches:])))
    for k in range(t.lift.shape[0]):
        if not is_zero(t.lift[k]):
            press = row_times(t.press[mode_set, k], X) + row_times(t.press_t[mode_set, k], T)
            energy[4] += total((share * press) * row_times(t.lift[k], X))
    for r in range(t.conductance.shape[0]):
        loss = row_times(t.loss[mode_set, r], X)
        energy[RESISTOR] += total((share * t.conductance[r]) * (loss * loss))
