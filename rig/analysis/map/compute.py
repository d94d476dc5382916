"""The units of a map: each is a pure function of the job."""

from __future__ import annotations

from functools import partial

from rig.analysis import kernel_shapes
from rig.analysis.map.dither import boundary
from rig.analysis.map.job import Job, Unit
from rig.analysis.map.row import Row
from rig.analysis.map.track import Track
from rig.analysis.pool import Arrays, Work
from rig.analysis.regions import along
from rig.errors import NumericsError, SceneError, Singular, WorkerError


def units(job: Job) -> Work:
    """Return the units of `job` as a work (rig.analysis.pool)."""
    functions = partial(compute, job), partial(_prepare, job), partial(failed, job)
    return Work(functions[0], job.units, job.scene.name, job.digest, *functions[1:], job.about)


def _prepare(job: Job) -> None:
    """Compile the kernels of the runs."""
    if not job.settings.eigenvalues:
        track = Track(job.at(0), job.x, job.settings)
        shape = kernel_shapes.shape_of(track.system(track.value), job.scene.clock.method)
        if shape not in kernel_shapes.ready():
            track.compile()
            kernel_shapes.note(shape)


def compute(job: Job, unit: Unit) -> Arrays:
    """Compute a unit. Raises SceneError if the equations of the whole row have no solution."""
    if job.settings.eigenvalues:
        return along(job.at(unit.row), job.x)
    if job.dithered:
        return boundary(job, unit.first)
    try:
        return Row(Track(job.at(unit.row), job.x, job.settings), unit).run()
    except (NumericsError, Singular) as error:
        raise SceneError(job.text(unit), [str(error)]) from None


def failed(job: Job, unit: Unit, why: str) -> Arrays:
    """Return a row whose runs had to stop. Raises WorkerError for eigenvalues and for dither."""
    if job.settings.eigenvalues or job.dithered:
        raise WorkerError(f"{job.text(unit)}: {why}")
    return Row(Track(job.at(unit.row), job.x, job.settings), unit).stopped(why)
