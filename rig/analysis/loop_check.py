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
from rig.analysis.control_loop import ends, loop
from rig.analysis.plant import plant
from rig.bench.experiment import Experiment
from rig.bench.simulate import begun, carry_on
from rig.controllers import restored
from rig.errors import NumericsError, SceneError
from rig.scenes.network import Network
from rig.scenes.scene import Scene
from rig.sensors.chain.front_end import FrontEnd

Array = NDArray[np.float64]
RUNS = 8
"""Runs of an ensemble. # chosen"""
_SHARE = 1e-3
_DECADES = 8.0
"""Change of ln(amplitude) that a run should reach, and the least number of periods that it has. # chosen"""
_PERIODS = (12, 400)


@dataclass(frozen=True)
class Checked:
    """Growth rate of the mean square [1/s] in `runs` simulations of `seconds` each."""

    growth: float
    runs: int
    seconds: float


def simulated(scene: Scene, name: str, network: Network, expected: float, hertz: float) -> Checked:
    """Simulate the loop of controller `name` over the links of `network`.

    `expected`: computed growth rate [1/s], `hertz`: frequency [Hz]; they decide on the length of the runs. Raises
    SceneError if the vibration is not small (a contact sticks or opens) or the integration stops.
    """
    section = scene.controllers[name]
    if "enable_at" in type(section).model_fields:
        section = section.model_copy(update={"enable_at": 0})
    sensors: dict[str, Any] = {key: _Linear(one) for key, one in scene.sensors.items()}
    alone = replace(scene, controllers={name: section}, sensors=sensors, protocol=(), faults={}, limits={})
    long = min(max(_DECADES / max(abs(expected), 1e-9), _PERIODS[0] / hertz), _PERIODS[1] / hertz)
    if expected > 0.0:
        long = min(long, 3.0 / expected)
    output = scene.sensors[ends(scene, name)[0]].reads
    runs = [
        _run(replace(alone, network=network.model_copy(update={"seed": seed})), name, output, long)
        for seed in range(1, RUNS + 1)
    ]
    square = np.mean([_by_periods(one, 1e9 / hertz / alone.step_ns) for one in runs], axis=0)
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


def _run(scene: Scene, name: str, output: str, seconds: float) -> Array:
    """The values of `output` at every sample step."""
    shape, states, rest = _start(scene, name)
    described = design.described(scene)

    def move(experiment: Experiment) -> None:
        motion = experiment.runner.motion
        for state, value, by in zip(states, rest, shape):
            motion.write(motion.system.names.index(state), float(value + by))

    ticks = round(seconds * 1e9) // scene.frame_ns
    experiment, working = begun(scene, {name: restored(described[name])}, ticks * scene.frame_ns, before=move)
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


def _start(scene: Scene, name: str) -> tuple[Array, tuple[str, ...], Array]:
    """A small deflection along the least stable mode, the states that it moves, and their values at steady sliding."""
    at = plant(scene)
    found = loop(scene, name)
    shape = np.real(found.spectrum.right[: found.model.own, 0])
    size = np.abs(at.equilibrium).max() or 1e-3
    return _SHARE * size * shape / np.abs(shape).max(), at.states, at.equilibrium


def _by_periods(values: Array, steps: float) -> Array:
    """The variance of `values` in each whole period of `steps` rows."""
    count = int(len(values) / steps)
    ends = np.rint(np.arange(count + 1) * steps).astype(int)
    return np.array([np.var(values[a:b]) for a, b in pairwise(ends.tolist())])
