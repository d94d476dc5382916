"""State, inputs and readings at several places of a step at once: one lane for each place.

Energy terms and outputs need them at three and five places of every step. Evaluated one after the other they took half
of the time of a run with sensors.
"""

from __future__ import annotations

from rig.compiled.kernel import inlined, inner
from rig.solve.column_blocks import LANE, alike, is_zero, lane, lanes, total, write
from rig.solve.energy_balance import RESISTOR
from rig.solve.expm import exponential_factors_of_lanes, has_lane_factors
from rig.solve.forces import STRIBECK, inputs, law_force, stribeck
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
def friction_forces_at(t, mode_set, p, X, forces):
    """Write the friction forces of patch p at the states X to `forces` [LANE]; as rig.solve.forces.friction_force.

    For a patch whose load depends on the state alone.
    """
    code, numbers, last = t.code[mode_set, p], t.numbers[mode_set, p], X.shape[0] - 1
    speed, load = t.law_speed[mode_set, p], t.law_load[mode_set, p]
    if t.sigma[mode_set, p] == 0.0 or code == 0:
        write(alike(0.0), forces)
        return
    N = alike(0.0)
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

    Only lanes `first` to `end` - 1 have to be right. Evaluated one after the other, the others would cost time: there
    they are 0, since what an earlier call left may be no number, which a weight of 0 does not remove.
    """
    X, T, patches = w.x_at, w.T_at, t.sigma.shape[1]
    if t.coupled[mode_set] or T.shape[0] > patches:
        for k in range(T.shape[0]):
            write(alike(0.0), T[k])
        for q in range(first, end):
            for i in range(X.shape[0]):
                w.y2[i] = X[i, q]
            inputs(t, mode_set, w.y2, w.T, w.scratch)
            for k in range(T.shape[0]):
                T[k, q] = w.T[k]
    else:
        for p in range(patches):
            friction_forces_at(t, mode_set, p, X, T[p])


@inner
def write_output_quartic(t, mode_set, s, X, T, coef):
    """Write the quartic through the first five lanes of output s to `coef` [degree]."""
    y = row_times(t.signals[mode_set, s], X) + row_times(t.signals_t[mode_set, s], T)
    coef[0], coef[1], coef[2], coef[3], coef[4] = quartic_coefficients(
        lane(y, 0), lane(y, 1), lane(y, 2), lane(y, 3), lane(y, 4)
    )


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
