"""The units of a map: each is a pure function of the job."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Self

from rig.analysis import kernel_shapes
from rig.analysis.map.dither import boundary
from rig.analysis.map.job import Job
from rig.analysis.map.row import Row
from rig.analysis.map.track import Track
from rig.analysis.pool import Arrays
from rig.analysis.regions import along
from rig.errors import NumericsError, SceneError, Singular, WorkerError


@dataclass(frozen=True)
class MapUnits:
    """The units of `job` as a work (rig.analysis.pool)."""

    job: Job

    @property
    def name(self) -> str:
        """The scene."""
        return self.job.scene.name

    @property
    def digest(self) -> str:
        """Hash of everything that the numbers depend on."""
        return self.job.digest

    @property
    def total(self) -> int:
        """Number of units."""
        return len(self.job.units)

    def prepare(self) -> None:
        """Compile the kernels of the runs."""
        if not self.job.settings.eigenvalues:
            track = Track(self.job.at(0), self.job.x, self.job.settings)
            shape = kernel_shapes.shape_of(track.system(track.value), self.job.scene.clock.method)
            if shape not in kernel_shapes.ready():
                track.compile()
                kernel_shapes.note(shape)

    def compute(self, number: int) -> Arrays:
        """Compute a unit. Raises SceneError if the equations of the whole row have no solution."""
        job, unit = self.job, self.job.units[number]
        if job.settings.eigenvalues:
            return along(job.at(unit.row), job.x)
        if job.dithered:
            return boundary(job, unit.first)
        try:
            return Row(Track(job.at(unit.row), job.x, job.settings), unit).run()
        except (NumericsError, Singular) as error:
            raise SceneError(job.text(unit), [str(error)]) from None

    def failed(self, number: int, why: str) -> Arrays:
        """Return a row whose runs had to stop. Raises WorkerError for eigenvalues and for dither."""
        job, unit = self.job, self.job.units[number]
        if job.settings.eigenvalues or job.dithered:
            raise WorkerError(f"{job.text(unit)}: {why}")
        return Row(Track(job.at(unit.row), job.x, job.settings), unit).stopped(why)

    def to_json(self) -> str:
        """Return the job as JSON text."""
        return self.job.to_json()

    @classmethod
    def from_json(cls, text: str) -> Self:
        """Return the units of a job."""
        return cls(Job.from_json(text))
