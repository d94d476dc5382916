"""The growth of a rig with all its controllers closed together, about steady sliding.

Each controller works with the numbers that it has for what it believes of the rig (rig.scenes.belief). Limits of
actuators, impaired links and dither are left out, as in the loop of one controller.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rig import controllers
from rig.analysis.linear.control_loop import lasting, plant
from rig.design import numbers
from rig.design.linearised import Plant
from rig.design.sampled_loops import Closed, ControlLoop, closed
from rig.errors import PartError, SceneError
from rig.scenes.scene import Scene

Complex = NDArray[np.complex128]


def closed_rates(scene: Scene) -> Complex:
    """Return the eigenvalues ln(z)/L [1/s] of the rig of `scene` with all loops closed, least stable first.

    Those that decay within a period are left out. Raises SceneError for a scene without controllers, for one that is
    not a linear feedback, and without steady sliding.
    """
    loops = closed_plant(scene, plant(scene), numbers(scene))
    rates, _ = lasting(np.linalg.eigvals(loops.matrix).astype(np.complex128), loops.period)
    return rates


def closed_plant(scene: Scene, rig: Plant, values: Mapping[str, Any]) -> Closed:
    """Return a linearised `rig` of `scene` with all its loops closed; `values`: the numbers of each controller.

    Raises SceneError as `closed_rates`.
    """
    if not scene.controllers:
        raise SceneError(scene.name, ["has no controller that closes a loop; modes.growth is the growth of the rig"])
    loops = []
    faults = []
    for name, section in scene.controllers.items():
        feedback: Any = controllers.build(section, values[name])
        if not hasattr(feedback, "linear"):
            faults.append(
                f"controllers.{name}: {section.kind} is not a linear feedback, so that its loop has no growth"
            )
            continue
        sensor = scene.sensors[feedback.reads[0]]
        loops.append(ControlLoop(feedback, sensor.reads, sensor.front_end(), int(section.delay)))
    if faults:
        raise SceneError(scene.name, faults)
    try:
        return closed(rig, loops)
    except (PartError, ValueError) as fault:
        raise SceneError(scene.name, [f"controllers: {fault}"]) from None
