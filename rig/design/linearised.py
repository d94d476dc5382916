"""The rig as a linear plant for control design: linearised about steady sliding, from actuators to outputs.

    dx' = A dx + B du        dy = C dx + D du        u: commands of the actuators, y: outputs of the rig

The matrices are those of the simulation. A quantity that is neither commanded nor moving is not a state.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from rig.model.assembly import Assembly
from rig.model.energy_forms import store
from rig.model.output_rows import signal_rows
from rig.stability.jacobian import inputs, own_law
from rig.stability.linearisation import Steady

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Plant:
    """A linear plant: matrices, names of their rows and columns, and the `equilibrium` [state] to which x is relative.

    `energy`: the form of `energy_form` over the states.
    """

    A: Array
    B: Array
    C: Array
    D: Array
    states: tuple[str, ...]
    inputs: tuple[str, ...]
    outputs: tuple[str, ...]
    equilibrium: Array
    energy: Array


def linear(assembly: Assembly, at: Steady) -> Plant:
    """Linearise the rig about the equilibrium `at`; actuators that are not states of this assembly are left out."""
    system = at.system
    commands = {name: system.names.index(one.state) for name, one in assembly.inputs.items() if one.state}
    given = np.array(list(commands.values()), dtype=np.int64)
    kept = np.zeros(system.n, dtype=bool)
    kept[at.moving] = kept[given] = True
    for _ in range(system.n):
        kept |= np.any(at.A[:, kept] != 0.0, axis=1)
    kept[given] = kept[system.one] = False
    x = np.flatnonzero(kept)
    over_x, over_t = signal_rows(system, at.modes, [output.row for output in assembly.outputs.values()])
    _, slopes = inputs(system, at.modes, at.x, own_law(system, at.modes))
    out = over_x + over_t @ slopes
    return Plant(
        A=at.A[np.ix_(x, x)],
        B=at.A[np.ix_(x, given)],
        C=out[:, x],
        D=out[:, given],
        states=tuple(system.names[i] for i in x),
        inputs=tuple(commands),
        outputs=tuple(assembly.outputs),
        equilibrium=at.x[x],
        energy=energy_form(at)[np.ix_(x, x)],
    )


def energy_form(at: Steady) -> Array:
    """Return the energy as a quadratic form of x [n, n]: twice the structure's kinetic energy, and that of each network
    state.
    """
    system = at.system
    nq, form = len(system.coordinates), np.zeros((system.n, system.n))
    form[nq : 2 * nq, nq : 2 * nq] = system.mass
    network = range(2 * nq, system.one)
    form[network, network] = np.abs(store(system, at.modes.key)[network, network])
    return form
