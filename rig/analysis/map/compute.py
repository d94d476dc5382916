"""Computation of the units of a map, in batches: each is a pure function of the job."""

from __future__ import annotations

from collections.abc import Callable, Sequence

from rig.analysis.map.dither import boundary
from rig.analysis.map.job import Arrays, Job
from rig.analysis.map.row import Row
from rig.analysis.map.track import Track
from rig.analysis.regions import along
from rig.errors import NumericsError, SceneError, Singular


def compute(job: Job, units: Sequence[int], finished: Callable[[int], object] | None = None) -> dict[int, Arrays]:
    """Compute the units of one batch, by number: a pure function of the job. `said` gets the number of each finished
    unit.
    """
    found: dict[int, Arrays] = {}
    for number in units:
        unit = job.units[number]
        if job.settings.eigenvalues:
            found[number] = along(job.at(unit.row), job.x)
        elif job.dithered:
            found[number] = boundary(job, unit.first)
        else:
            try:
                found[number] = Row(Track(job.at(unit.row), job.x, job.settings), unit.first, unit.last).run()
            except (NumericsError, Singular) as error:
                raise SceneError(job.text(unit), [str(error)]) from None
        if finished is not None:
            finished(number)
    return found
