"""The rig as a linear plant for control design: small motions about steady sliding, from actuators to outputs.

The matrices are those of rig.design.linearised at the sliding equilibrium of the scene's own values. Limits of the
actuators are left out, and dither is off.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from rig.analysis.modes import at_rest, missing
from rig.design.linearised import Plant, linear
from rig.errors import SceneError
from rig.scenes.rooms import assembled
from rig.scenes.scene import Scene

if TYPE_CHECKING:
    from control import StateSpace

Array = NDArray[np.float64]
ORDER = 8


def plant(scene: Scene) -> Plant:
    """Linearise the rig of `scene`; inputs are the actuators whose command is a value (not a generator's).

    Raises SceneError without steady sliding.
    """
    actuators = assembled(scene.parameters, scene.frame_ns, random=False).inputs
    assembly, at = at_rest(scene, dict.fromkeys(actuators, "held"))
    if not at.exists:
        why = f"no steady sliding at these values ({missing(at)}), so the rig cannot be linearised"
        raise SceneError(scene.name, [why])
    return linear(assembly, at)


def state_space(scene: Scene, delay: float = 0.0, order: int = ORDER) -> StateSpace:
    """Return the linearised rig as python-control's StateSpace, continuous in time.

    Its inputs are the actuators, in their units (drive.speed is named drive_speed there: python-control takes no dots).
    `delay`: of a loop [s], the same for every command, as a Pade approximation of `order`: exact to 1e-8 up to a
    frequency at which the delay turns the phase by half the order in radians. A sampled loop with sample and hold has
    half a period more; rig.analysis.control_loop treats it exactly. Raises SceneError without steady sliding.
    """
    import control

    p = plant(scene)
    A, B, D = p.A, p.B, p.D
    if delay > 0.0:
        num, den = control.pade(1.0, order)
        pade = control.tf2ss(control.tf(num, den))
        each = np.eye(len(p.inputs))
        late, into, out, through = (np.kron(each, m) for m in (pade.A / delay, pade.B / delay, pade.C, pade.D))
        zero = np.zeros((len(late), len(A)))
        A = np.block([[A, B @ out], [zero, late]])
        C = np.hstack([p.C, D @ out])
        B, D = np.vstack([B @ through, into]), D @ through
    else:
        C = p.C
    inputs = [name.replace(".", "_") for name in p.inputs]
    return control.ss(A, B, C, D, inputs=inputs, outputs=list(p.outputs), name=scene.name)
