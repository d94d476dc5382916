"""The rig as a linear plant for control design: linearised about steady sliding, from actuators to outputs.

    dx' = A dx + B du        dy = C dx + D du        u: commands of the actuators, y: outputs of the rig

The matrices are those of the simulation. A quantity that is neither commanded nor moving is not a state. The linear
form of a controller (rig.controllers.blocks.design.Linear) is checked, and becomes matrices too:

    xi+ = A xi + b y,   u = c xi + d y              y: the measurement, u: the command
"""

from __future__ import annotations

import sys
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from rig.controllers.blocks.design import Feedback, Linear
from rig.errors import PartError
from rig.model import film
from rig.model.assembly import Assembly
from rig.model.energy_forms import store
from rig.model.formulation import signal_rows
from rig.model.named_rows import Row
from rig.parts import calling, file_of
from rig.stability.linearisation import Steady, inputs, own_law
from rig.units import brief

Array = NDArray[np.float64]


def linear_form(controller: Feedback) -> Linear:
    """The linear form of a controller. Raises PartError if it fails, or is not one; ValueError unless the controller
    reads one sensor and drives one actuator.
    """
    for word, names in (("reads", controller.reads), ("drives", controller.drives)):
        if len(names) != 1:
            given = ", ".join(names) or "nothing"
            raise ValueError(f"{word}: {given}; a linear form needs one sensor and one actuator")
    module = sys.modules[type(controller).__module__]
    with calling(module):
        form = controller.linear()
    if not isinstance(form, Linear):
        expected = "a rig.controllers.blocks.design.Linear"
        raise PartError(f"{file_of(module)}: linear gives {brief(form)}; expected {expected}")
    parameters = getattr(type(getattr(controller, "section", None)), "model_fields", {})
    if form.gain and form.gain not in parameters:
        known = ", ".join(parameters) or "there are none"
        raise PartError(f"{file_of(module)}: linear names the gain {brief(form.gain)}; its parameters: {known}")
    return form


def arithmetic(controller: Feedback) -> tuple[Array, Array, Array, float]:
    """The matrices A, b, c, d of a controller, from its own linear update. Raises as `linear_form`."""
    form = linear_form(controller)
    module = sys.modules[type(controller).__module__]

    def step(xi: Array, y: float) -> tuple[Array, float]:
        with calling(module):
            after, u = form.step(xi.tolist(), y)
            stepped = np.array(after, dtype=float), float(u)
        if stepped[0].shape != (form.states,) or not np.isfinite([*stepped[0], stepped[1]]).all():
            expected = f"({form.states} states, command), all finite"
            raise PartError(f"{file_of(module)}: the step of linear gives {brief((after, u))}; expected {expected}")
        return stepped

    count = form.states
    b, d = step(np.zeros(count), 1.0)
    A = np.zeros((count, count))
    c = np.zeros(count)
    for i, unit in enumerate(np.eye(count)):
        A[:, i], c[i] = step(unit, 0.0)
    seen = c != 0.0
    for _ in range(count):  # drop states without influence on commands, e.g. the copy for a prediction over zero time
        seen |= np.any(A[seen] != 0.0, axis=0)
    return A[np.ix_(seen, seen)], b[seen], c[seen], d


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
    driven = {name: actuator.state for name, actuator in assembly.inputs.items() if actuator.state}
    given = np.array([system.names.index(state) for state in driven.values()], dtype=np.int64)
    kept = np.zeros(system.n, dtype=bool)
    kept[at.moving] = kept[given] = True
    for _ in range(system.n):
        kept |= np.any(at.A[:, kept] != 0.0, axis=1)
    kept[given] = kept[system.one] = False
    if assembly.film is not None and not assembly.film.travel:  # nothing depends on how far the surface has slid
        kept[system.names.index(assembly.film.slid)] = False
    x = np.flatnonzero(kept)
    closed = _closed(assembly)
    rows = [_over(output.row, closed) for output in assembly.outputs.values()]
    over_x, over_t = signal_rows(system, at.modes, rows)
    _, slopes = inputs(system, at.modes, at.x, own_law(system, at.modes))
    out = over_x + over_t @ slopes
    return Plant(
        A=at.A[np.ix_(x, x)],
        B=at.A[np.ix_(x, given)],
        C=out[:, x],
        D=out[:, given],
        states=tuple(system.names[i] for i in x),
        inputs=tuple(driven),
        outputs=tuple(assembly.outputs),
        equilibrium=at.x[x],
        energy=energy_form(at)[np.ix_(x, x)],
    )


def _closed(assembly: Assembly) -> dict[str, Row]:
    """The states of a film as rows over its contacts while every point is closed and slips; counts do not change."""
    if assembly.film is None:
        return {}
    normals = {name: patch for name, patch, *_ in assembly.normals}
    rows: dict[str, Row] = {state: {} for state in assembly.film.states(list(assembly.coordinates))}
    rows |= {film.at("P", i): {f"N:{name}": 1.0} for i, name in enumerate(normals)}
    rows |= {film.at("w", i): {f"w:{patch}": 1.0} for i, patch in enumerate(normals.values())}
    rows[film.over("normal")] = {f"N:{name}": 1.0 for name in normals}
    rows[film.over("friction")] = {f"T:{patch}": 1.0 for patch in normals.values()}
    return rows


def _over(row: Row, closed: dict[str, Row]) -> Row:
    """A row with the states of a film replaced."""
    out: Row = {}
    for name, value in row.items():
        for part, factor in closed.get(name, {name: 1.0}).items():
            out[part] = out.get(part, 0.0) + value * factor
    return out


def energy_form(at: Steady) -> Array:
    """Return the energy as a quadratic form of x [n, n]: twice the structure's kinetic energy, and that of each network
    state.
    """
    system = at.system
    nq = len(system.coordinates)
    form = np.zeros((system.n, system.n))
    form[nq : 2 * nq, nq : 2 * nq] = system.mass
    network = range(2 * nq, system.one)
    form[network, network] = np.abs(store(system, at.modes.key)[network, network])
    return form
