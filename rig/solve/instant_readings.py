"""Powers for the energy balance and outputs for the sensors at one instant."""

from __future__ import annotations

from rig.kernel import inner
from rig.solve.energy_balance import RESISTOR
from rig.solve.rows import dot


@inner
def add_power(t, mode_set, T, x, scale, energy):
    """Add `scale` times the powers at x, where the inputs are T, to the energy terms."""
    nq, patches = t.damping.shape[1], t.slip.shape[0]
    for p in range(patches):
        force = scale * (dot(t.friction[mode_set, p], x) + dot(t.friction_t[mode_set, p], T))
        energy[0] += force * dot(t.surface[p], x)
        energy[1] += force * dot(t.slip[p], x)
    for i in range(nq):
        v = scale * x[nq + i]
        energy[2] += v * dot(t.damping[mode_set, i], x[nq : 2 * nq])
        energy[3] += v * (dot(t.force[i], x) + dot(t.force_t[i], T[patches:]))
    for k in range(t.lift.shape[0]):
        energy[4] += scale * (dot(t.press[mode_set, k], x) + dot(t.press_t[mode_set, k], T)) * dot(t.lift[k], x)
    for r in range(t.conductance.shape[0]):
        energy[RESISTOR] += scale * t.conductance[r] * dot(t.loss[mode_set, r], x) ** 2


@inner
def outputs_at(t, mode_set, T, x, values):
    """values[output] = the outputs that sensors read at x, where the inputs are T."""
    for s in range(values.shape[0]):
        values[s] = dot(t.signals[mode_set, s], x) + dot(t.signals_t[mode_set, s], T)
