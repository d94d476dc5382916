"""A rig whose actuators are driven from outside, and which can begin again at any time: for agents and co-simulation.

Controllers of the scene that would drive the same actuators are left out. Beginning again returns the plant runner to
tick 0, which takes 0.5 ms and gives the bits of a new rig with the same seed.
"""

from __future__ import annotations

from collections.abc import Collection, Iterable, Mapping, Sequence
from dataclasses import replace
from typing import Any

from rig import design
from rig.bench.run.checkpoint import KeptState
from rig.bench.run.experiment import Experiment
from rig.bench.run.local_controllers import ControllerInProcess
from rig.bench.run.runner import PlantRunner
from rig.controllers import controller_drives, restored
from rig.controllers.runtime.loop import Loop
from rig.scenes.protocol import Connect, Disconnect, Repeat
from rig.scenes.scene import Scene


class RestartableRig:
    """The rig of `scene` with command states for the actuators `drives`.

    `working`: the controllers of the scene that stay, while an experiment runs.
    """

    def __init__(self, scene: Scene, drives: Collection[str]) -> None:
        out = {name for name, section in scene.controllers.items() if {*controller_drives(section)} & {*drives}}
        self.scene = replace(
            scene,
            controllers={name: section for name, section in scene.controllers.items() if name not in out},
            driven=scene.driven | {*drives},
            protocol=tuple(_without(scene.protocol, out)),
        )
        self._described = design.described(self.scene)
        self._loops: dict[str, Loop] = {}
        self.working: list[ControllerInProcess] = []
        self._make()

    def _make(self) -> None:
        self.runner = PlantRunner(self.scene)
        kick = self.runner.motion.integration.method == "kick"  # its tables have a memory: a new runner each time
        self._kept: KeptState | None = None if kick else self.runner.keep()

    def begin(self, seed: int, length_ns: int) -> Experiment:
        """Begin at tick 0 with this seed of all noise; the experiment is not yet open, so that others can be admitted.

        The runner may be another one than before.
        """
        if self._kept is None or self._kept.scene is not self.runner.scene:
            self.scene = replace(self.scene, seed=seed)
            self._make()
        else:
            self.runner.back(self._kept, seed)
        experiment = Experiment(self.scene, self.runner, length_ns, self._retune)
        self._loops = {name: Loop(restored(one)) for name, one in self._described.items()}
        self.working = [ControllerInProcess(name, loop, experiment) for name, loop in sorted(self._loops.items())]
        return experiment

    def _retune(self, name: str, changes: Mapping[str, Any]) -> None:
        self._loops[name].retune(changes)


def _without(protocol: Sequence[Any], controllers: set[str]) -> Iterable[Any]:
    """The steps of a protocol, without those that connect or disconnect these controllers."""
    for step in protocol:
        if isinstance(step, Connect | Disconnect) and step.controller in controllers:
            continue
        if isinstance(step, Repeat):
            yield step.model_copy(update={"steps": tuple(_without(step.steps, controllers))})
        else:
            yield step
