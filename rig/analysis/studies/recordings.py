"""Recordings of chosen points of a study: these are simulated again, since a run repeats to the last bit."""

from __future__ import annotations

from collections.abc import Sequence
from functools import partial
from pathlib import Path

import numpy as np

from rig.analysis.pool import Arrays, Progress, Work, carry_out, temporary
from rig.analysis.studies.runs import StudyRuns
from rig.bench.simulate import simulate
from rig.errors import OutputError, RigError, WorkerError
from rig.quantities import run_length_ns
from rig.record.provenance import provenance
from rig.record.save_run import save
from rig.user_files import draft_of


def keep(
    study: StudyRuns, points: Sequence[int], folder: Path, workers: int | None, progress: Progress | None = None
) -> dict[int, Path]:
    """Record the runs of `points` into `folder`; return point -> file. Existing recordings are not made again.

    A run that the scene refuses has none.
    """
    found = {point: folder / f"{point:06d}.mcap" for point in points}
    missing = tuple(point for point, path in found.items() if not path.exists())
    if missing:
        folder.mkdir(parents=True, exist_ok=True)
        work = Work(partial(_record, study, folder), missing)
        try:
            with temporary(work) as store:
                carry_out(work, store, workers if study.portable else 1, progress)
        except (OutputError, WorkerError) as fault:
            raise type(fault)(
                f"{fault}. The values of the study are kept in {folder.parent}; the same command continues"
            ) from None
    return {point: path for point, path in found.items() if path.exists()}


def _record(study: StudyRuns, folder: Path, point: int) -> Arrays:
    """Simulate a point and record it. Raises OutputError; a run that the scene refuses is not recorded."""
    scene = study.scene_of(point)
    try:
        run = simulate(scene, duration_ns=run_length_ns(study.duration))
    except RigError:
        return {"recorded": np.array(False)}
    run.provenance = provenance(scene.seed)
    path = folder / f"{point:06d}.mcap"
    try:
        with draft_of(path) as draft:
            save(run, draft)
    except OutputError as fault:
        why = str(fault).partition("cannot be written: ")[2].partition(";")[0]
        raise OutputError(f"{path} cannot be written: {why or fault}") from None
    return {"recorded": np.array(True)}
