"""Common parts of the figures: colours, scenes with changes, runs without a protocol."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray

    from rig.model.friction_law import Law
    from rig.record.run import Run
    from rig.scenes.scene import Scene


def load(name: str, **changes: Any) -> Scene:
    """Return a scene with changes; two underscores replace the dot: body__damping=2.0, in SI."""
    import rig

    return rig.load(name, {key.replace("__", "."): value for key, value in changes.items()})


def run(scene: Scene, seconds: float | None = None) -> Run:
    """Run the scene in this process."""
    import rig

    return rig.simulate(scene, seconds)


def quiet(scene: Scene) -> Scene:
    """Return the scene without protocol, controllers and limits, held at its initial values."""
    return replace(scene, protocol=(), controllers={}, limits={})


def value(scene: Scene, key: str) -> float:
    """Return a value of a scene in SI."""
    return float(scene.values()[key][0])


def law_of(scene: Scene) -> Law:
    """Return the friction law of the scene's first contact."""
    return scene.assemble().system().patches[0].law  # type: ignore[no-any-return]


def dither_boundary(scene: Scene, rate: float, fast: float, shares: NDArray[np.float64]) -> tuple[float, float, float]:
    """Return the largest dither that loses sliding, relative to the one that gives the slider of mass one the speed
    `fast` [m/s].

    To leading order, averaged, simulated. `rate` of the dither [rad/s]; `shares`: amplitudes to try, in the same
    measure.
    """
    from rig.analysis.axis import Axis
    from rig.analysis.map.dither import boundary
    from rig.analysis.map.job import Job, Settings

    frequencies = Axis.of("dither.frequency", [rate / (2.0 * math.pi), rate], scene)
    amplitudes = Axis.of("dither.amplitude", shares * fast * rate, scene)
    found = boundary(Job(scene, frequencies, amplitudes, Settings("displacement")), 0)
    leading, averaged, simulated = (float(found[name].mean()) for name in ("leading", "averaged", "simulated"))
    return leading / (fast * rate), averaged / (fast * rate), simulated / (fast * rate)
