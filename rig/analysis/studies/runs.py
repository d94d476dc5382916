"""The points of a study: each has its values and its seed, and is computed for itself."""

from __future__ import annotations

import hashlib
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from rig import kernel
from rig.analysis.kernel_shapes import prepare
from rig.analysis.pool import Arrays, Work
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

    @property
    def work(self) -> Work:
        """The study as a work (rig.analysis.pool): each unit is a point."""
        what = [self.plan, self.duration, *self.measures]
        hash_ = digest(self.scene, repr(what))
        return Work(self.compute, range(self.total), self.name, hash_, self.prepare, self.failed)

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


def as_arrays(found: Measured) -> Arrays:
    """Return the values of a point as the result of a unit."""
    return {"values": np.array(found.values), "units": np.array(found.units), "reason": np.array(found.reason)}


def digest(scene: Scene, text: str) -> str:
    """Return a hash (12 hex digits) of a scene, of a description, and of the sources that decide their numbers."""
    found = hashlib.sha256(f"{kernel.source_key()} {np.__version__} {scene.digest} {text}".encode())
    for path in sorted(path for room in _ROOMS for path in (_ROOT / room).rglob("*.py")):
        found.update(path.name.encode() + path.read_bytes())
    return found.hexdigest()[:12]
