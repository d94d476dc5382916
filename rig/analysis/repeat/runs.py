"""The runs of one scene with many seeds, as a work (rig.analysis.pool): each unit is the run of one seed."""

from __future__ import annotations

import json
from dataclasses import dataclass, replace
from typing import Self

from rig.analysis.kernel_shapes import prepare
from rig.analysis.pool import Arrays, packed
from rig.analysis.repeat.measure import Seen, measure
from rig.bench.simulate import simulate
from rig.quantities import run_length_ns
from rig.scenes.scene import Scene


@dataclass(frozen=True)
class SeedRuns:
    """`scene` with each of `seeds`, for `duration` [s] or the length of its protocol."""

    scene: Scene
    seeds: tuple[int, ...]
    duration: float | None

    @property
    def name(self) -> str:
        """The scene."""
        return self.scene.name

    @property
    def digest(self) -> str:
        """Hash of the scene."""
        return self.scene.digest

    @property
    def total(self) -> int:
        """Number of seeds."""
        return len(self.seeds)

    def prepare(self) -> None:
        """Compile the kernels. Raises SceneError as a run does."""
        prepare([self.scene])
        simulate(self.scene, duration_ns=self.scene.frame_ns)

    def compute(self, unit: int) -> Arrays:
        """Simulate with one seed and measure."""
        seed = self.seeds[unit]
        duration_ns = run_length_ns(self.duration)
        run = simulate(replace(self.scene, seed=seed), duration_ns=duration_ns, audited=False)
        return packed(measure(run, seed).to_json())

    def failed(self, unit: int, why: str) -> Arrays:
        """Return a run without numbers."""
        return packed(Seen(self.seeds[unit], 0.0, {}, fault=why).to_json())

    def to_json(self) -> str:
        """Return the work as JSON text."""
        return json.dumps({"scene": self.scene.to_json(), "seeds": self.seeds, "duration": self.duration})

    @classmethod
    def from_json(cls, text: str) -> Self:
        """Return the work of a text by `to_json`."""
        raw = json.loads(text)
        return cls(Scene.from_json(raw["scene"]), tuple(raw["seeds"]), raw["duration"])
