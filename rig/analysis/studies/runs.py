"""The points of a study as a work (rig.analysis.pool): each unit is one point with its values and its seed."""

from __future__ import annotations

import hashlib
import json
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any, Self

import numpy as np

from rig import kernel
from rig.analysis.kernel_shapes import prepare
from rig.analysis.pool import Arrays
from rig.analysis.studies.factors import changed
from rig.analysis.studies.measures import Measure, Measured, evaluate
from rig.analysis.studies.plan import Plan
from rig.bench.simulate import simulate
from rig.errors import SceneError
from rig.scenes.scene import Scene

_ROOT = Path(__file__).resolve().parents[2]
_ROOMS = ("analysis", "bench", "controllers", "design", "effects", "model", "motion", "plants", "record",
          "sensors", "solve", "stability")  # fmt: skip


@dataclass(frozen=True)
class StudyRuns:
    """The points of `plan` of `scene`, with `measures`; each run takes `duration` [s] or as long as its protocol."""

    scene: Scene
    plan: Plan
    measures: tuple[Measure, ...]
    duration: float | None

    @property
    def name(self) -> str:
        """The scene."""
        return self.scene.name

    @property
    def total(self) -> int:
        """Number of points."""
        return self.plan.total

    @property
    def portable(self) -> bool:
        """Whether other processes can compute it: every function of a measure is in a file."""
        return all(one.function is None or one.function.portable for one in self.measures)

    @cached_property
    def digest(self) -> str:
        """Hash (12 hex digits) of everything that the numbers depend on, sources included."""
        return digest(self.scene, self.to_json())

    def prepare(self) -> None:
        """Compile the kernels. Raises SceneError for a scene whose controllers cannot be designed."""
        scene = self.scene_of(0)
        prepare([scene])
        if any(one.of_run for one in self.measures):
            simulate(scene, duration_ns=scene.frame_ns)

    def scene_of(self, unit: int) -> Scene:
        """Return the scene of a point. Raises SceneError if it refuses the values together."""
        return changed(self.scene, self.plan.values(unit), self.plan.seed_of(unit))

    def compute(self, unit: int) -> Arrays:
        """Compute the measures of a point; a fault of it becomes the reason of missing values."""
        try:
            return as_arrays(evaluate(self.scene_of(unit), self.measures, self.duration))
        except SceneError as fault:
            return self.failed(unit, "; ".join(fault.faults))

    def failed(self, unit: int, why: str) -> Arrays:
        """Return a point without values."""
        units = tuple(one.unit for one in self.measures)
        return as_arrays(Measured((float("nan"),) * len(units), units, why))

    def to_json(self) -> str:
        """Return the work as JSON text."""
        raw = {"scene": json.loads(self.scene.to_json()), "plan": self.plan.to_json(), "duration": self.duration}
        return json.dumps(raw | {"measures": [one.to_json() for one in self.measures]})

    @classmethod
    def from_json(cls, text: str) -> Self:
        """Return the work of a text by `to_json`."""
        raw: dict[str, Any] = json.loads(text)
        scene = Scene.from_json(json.dumps(raw["scene"]))
        measures = tuple(map(Measure.from_json, raw["measures"]))
        return cls(scene, Plan.from_json(raw["plan"]), measures, raw["duration"])


def as_arrays(found: Measured) -> Arrays:
    """Return the values of a point as the result of a unit."""
    return {"values": np.array(found.values), "units": np.array(found.units), "reason": np.array(found.reason)}


def digest(scene: Scene, text: str) -> str:
    """Return a hash (12 hex digits) of a scene, of a description, and of the sources that decide their numbers."""
    found = hashlib.sha256(f"{kernel.source_key()} {np.__version__} {scene.digest} {text}".encode())
    for path in sorted(path for room in _ROOMS for path in (_ROOT / room).rglob("*.py")):
        found.update(path.name.encode() + path.read_bytes())
    return found.hexdigest()[:12]
