"""The rig as a control engineer sees it: small motions about steady sliding, from actuators to outputs.

    dx' = A dx + B du        dy = C dx + D du        u: commands of the actuators, y: outputs of the rig

The same matrices as in the simulation, linearised at the sliding equilibrium of the scene's own values. Limits of the
actuators are left out, dither is off, and what nothing commands and nothing moves is not a state.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from rig.analysis.modes import at_rest, energy_form, missing
from rig.errors import SceneError
from rig.model.assembly import Assembly
from rig.model.output_rows import signal_rows
from rig.scenes.rooms import assembled
from rig.scenes.scene import Scene
from rig.stability.linearisation import Steady, inputs, own_law

if TYPE_CHECKING:
    from control import StateSpace

Array = NDArray[np.float64]
ORDER = 8


@dataclass(frozen=True)
class Plant:
    """Matrices, the names of their rows and columns, and the `equilibrium` [state] that the x are counted from.

    `energy`: the form of rig.analysis.modes.energy_form over the states.
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


def plant(scene: Scene) -> Plant:
    """The rig of `scene`, linearised; its inputs are the actuators whose command is a value (not a generator's).

    Raises SceneError where nothing slides steadily.
    """
    actuators = assembled(scene.parameters, scene.frame_ns, random=False).inputs
    assembly, at = at_rest(scene, dict.fromkeys(actuators, "held"))
    if not at.exists:
        why = f"nothing slides steadily at these values ({missing(at)}): there is nothing to linearise about"
        raise SceneError(scene.name, [why])
    return linear(assembly, at)


def linear(assembly: Assembly, at: Steady) -> Plant:
    """The rig about the equilibrium `at`; actuators that are no states of this assembly are left out."""
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


def state_space(scene: Scene, delay: float = 0.0, order: int = ORDER) -> StateSpace:
    """The linearised rig as python-control's StateSpace, continuous in time; its inputs are the actuators, in their
    units (drive.speed is named drive_speed there: python-control takes no dots).

    `delay`: of a loop [s], the same for every command, as a Pade approximation of `order`: exact to 1e-8 up to a
    frequency at which the delay turns the phase by half the order in radians. A sampled loop with sample and hold has
    half a period more; rig.analysis.control_loop has it exactly. Raises SceneError where nothing slides steadily.
    """
    import control

    p = plant(scene)
    A, B, D = p.A, p.B, p.D
    if delay > 0.0:
        num, den = control.pade(1.0, order)
        one = control.tf2ss(control.tf(num, den))
        each = np.eye(len(p.inputs))
        late, into, out, through = (np.kron(each, m) for m in (one.A / delay, one.B / delay, one.C, one.D))
        zero = np.zeros((len(late), len(A)))
        A = np.block([[A, B @ out], [zero, late]])
        C = np.hstack([p.C, D @ out])
        B, D = np.vstack([B @ through, into]), D @ through
    else:
        C = p.C
    inputs = [name.replace(".", "_") for name in p.inputs]
    return control.ss(A, B, C, D, inputs=inputs, outputs=list(p.outputs), name=scene.name)
