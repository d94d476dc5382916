"""The decay of a loop at small motions, read off an ensemble of simulations with the links of a scene.

Each run begins at steady sliding, moved along the least stable mode of the closed loop by a thousandth of the rig's own
deflection, and has a network seed of its own; sensors have neither noise nor limits. The mean square of the output that
the sensor reads, over all runs and over each period of the vibration, is fitted by an exponential: its rate is twice
the growth rate of the mean square.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from itertools import pairwise
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rig import design
from rig.analysis.linear.control_loop import ends, plant
from rig.analysis.linear.jump_linear import Growth
from rig.bench.run.experiment import Experiment
from rig.bench.run.simulate import begun, carry_on
from rig.controllers import restored
from rig.errors import NumericsError, SceneError
from rig.scenes.network import Network
from rig.scenes.scene import Scene
from rig.sensors.chain.front_end import FrontEnd

Array = NDArray[np.float64]
RUNS = 8
"""Runs of an ensemble. # chosen"""
_SHARE = 1e-3  # of the rig's own deflection: the displacement at the begin
_DECADES = 8.0  # change of ln(amplitude) that a run should reach. [chosen]
_PERIODS = (12, 400)  # fewest and most periods of a run. [chosen]


@dataclass(frozen=True)
class Checked:
    """Growth rate of the mean square [1/s] in `runs` simulations of `seconds` each."""

    growth: float
    runs: int
    seconds: float


def simulated(scene: Scene, name: str, network: Network, expected: float, of: Growth) -> Checked:
    """Simulate the loop of controller `name` over the links of `network`, from the shape that grows as computed.

    `expected`: computed growth rate [1/s]; it and the frequency decide on the length of the runs. Raises SceneError if
    the vibration is not small (a contact sticks or opens) or the integration stops.
    """
    hertz = of.hertz
    section = scene.controllers[name]
    if "enable_at" in type(section).model_fields:
        section = section.model_copy(update={"enable_at": 0})
    sensors: dict[str, Any] = {key: _Linear(sensor) for key, sensor in scene.sensors.items()}
    described = design.described(replace(scene, controllers={name: section}))[name]  # with the noise of its sensor
    alone = replace(scene, controllers={name: section}, sensors=sensors, believed={}, protocol=(), faults={}, limits={})
    long = min(max(_DECADES / max(abs(expected), 1e-9), _PERIODS[0] / hertz), _PERIODS[1] / hertz)
    if expected > 0.0:
        long = min(long, 3.0 / expected)
    sensor, _ = ends(scene, name)
    output = scene.sensors[sensor].reads
    ensemble = []
    for seed in range(1, RUNS + 1):
        seeded = replace(alone, network=network.model_copy(update={"seed": seed}))
        ensemble.append(_run(seeded, name, described, output, long, of.shape))
    runs = np.array(ensemble)
    steps = 1e9 / hertz / alone.step_ns
    ends_of_periods = np.rint(np.arange(int(runs.shape[1] / steps) + 1) * steps).astype(int)
    square = np.array([runs[:, a:b].var(axis=1).mean() for a, b in pairwise(ends_of_periods.tolist())])
    kept = square > 1e-20 * square.max()
    bins = np.flatnonzero(kept)[1:]  # after the first period: the links are still empty at the beginning
    if len(bins) < 3:
        raise SceneError(scene.name, [f"the vibration has too few periods of {1 / hertz:.3g} s to fit a decay"])
    rate = float(np.polyfit(bins / hertz, np.log(square[bins]), 1)[0])
    return Checked(0.5 * rate, RUNS, long)


class _Linear:
    """An instrument without noise, resolution and limits: only its linear response, so that small motions are seen."""

    def __init__(self, instrument: Any) -> None:
        self._instrument = instrument

    def __getattr__(self, name: str) -> Any:
        return getattr(self._instrument, name)

    def front_end(self) -> FrontEnd:
        """Its front end."""
        end: FrontEnd = self._instrument.front_end()
        unlimited = replace(end, low=-math.inf, high=math.inf, slew=math.inf)
        return replace(unlimited, offset=0.0, slope=0.0, warmth=0.0, noise=0.0, resolution=0.0, dropout_rate=0.0)


def _run(scene: Scene, name: str, described: dict[str, Any], output: str, seconds: float, shape: Array) -> Array:
    """The values of `output` at every sample step, from a small motion along `shape`.

    `described`: the description of controller `name`.
    """
    at = plant(scene)
    # by displacements: a fast mode has much larger velocities
    places = [i for i, state in enumerate(at.states) if not state.endswith("'")]
    shape = shape * _SHARE * (np.abs(at.equilibrium[places]).max() or 1e-3) / np.abs(shape[places]).max()

    def move(experiment: Experiment) -> None:
        motion = experiment.runner.motion
        for state, value in zip(at.states, at.equilibrium + shape):
            motion.write(motion.system.names.index(state), float(value))

    ticks = round(seconds * 1e9) // scene.frame_ns
    experiment, working = begun(scene, {name: restored(described)}, ticks * scene.frame_ns, before=move)
    runner = experiment.runner
    try:
        while experiment.begin():
            carry_on(experiment, working, experiment.until())
    except NumericsError as fault:
        raise SceneError(scene.name, [f"the simulation stopped: {fault.what}"]) from None
    if runner.statistics()["events"]:
        raise SceneError(scene.name, ["a contact sticks or opens even at a small vibration: its decay is not defined"])
    assert runner.truth is not None
    runner.hand_over(runner.truth)
    values, _ = runner.truth.outputs()
    return np.asarray(values[runner.outputs.index(output)])
