"""Maps of the steady-state behaviour of a rig over one or two parameters: sliding, stick-slip, or both.

job            scene, axes, settings; the units of work
row            runs along a row, carried up and down, from near and far starts; the rig of a row is started anywhere,
               moved along the x axis and simulated until it settles; the units as a work (rig.analysis.pool)
steady_state   the states in which a motion settles, and its measures
dither         the boundary of dither over frequency and amplitude: averaged and simulated
result         the finished map
figure         its picture
"""

from __future__ import annotations

from pathlib import Path

from rig.analysis.cycles.repetition import refuse
from rig.analysis.linear.regions import Regions
from rig.analysis.linear.regions import put_together as put_rows_together
from rig.analysis.map.dither import Boundary, put_together
from rig.analysis.map.job import PERIODS, RUNS, Job, Settings, checked
from rig.analysis.map.result import Map, gathered
from rig.analysis.map.row import units
from rig.analysis.pool import Progress, Store, carry_out
from rig.errors import UsageError
from rig.scenes.axis import axes
from rig.scenes.scene import Scene

__all__ = ["PERIODS", "RUNS", "Boundary", "Job", "Map", "Settings", "chart", "job", "regions_job", "store_of"]
ROOT = Path("maps")
_SECTION = 24  # local maxima kept of each point of a bifurcation diagram


def job(
    scene: Scene,
    x: str,
    y: str | None = None,
    output: str | None = None,
    runs: tuple[str, ...] = RUNS,
    longest: float | None = None,
) -> Job:
    """Describe a map: `x`, `y` as rig.scenes.axis.Axis parses them, `output` a plant output (the first by default).

    Raises SceneError, UsageError with every fault.
    """
    refuse(scene, "a map of steady states")
    if not scene.assemble().patches:
        raise UsageError(
            f"{scene.name}: the rig has no contact that can slide, and a map shows steady sliding. "
            f"Eigenvalues over a parameter: rig modes {scene.name} --sweep KEY=A:B:N"
        )
    both = axes(scene, {"x": x, "y": y})
    watched = next(iter(scene.assemble().outputs)) if output is None else output
    settings = Settings(watched, tuple(runs), longest=longest, section=0 if y else _SECTION)
    return checked(Job(scene, both[0], both[1] if y else None, settings))


def regions_job(scene: Scene, x: str, y: str | None) -> Job:
    """Describe a map of the eigenvalues over two axes, without runs. Raises SceneError, UsageError."""
    if y is None:
        raise UsageError("--eigenvalues: needs --y as well; over one parameter: rig modes SCENE --sweep KEY=A:B:N")
    over, up = axes(scene, {"--x": x, "--y": y})
    return Job(scene, over, up, Settings("", eigenvalues=True))


def chart(
    job: Job, root: Path = ROOT, workers: int | None = None, progress: Progress | None = None
) -> Map | Boundary | Regions:
    """Compute the map of `job`; over frequency and amplitude of a dither its boundary, of eigenvalues the regions.

    `workers` processes (one per core by default) compute what the job's folder under `root` does not contain yet.
    Raises UsageError if the folder cannot be used, WorkerError if a worker is lost. Finished results stay after an
    error or an interruption, and the same call continues from there.
    """
    work = units(job)
    store = store_of(job, root)
    with store.open(work):
        rows = carry_out(work, store, workers, progress)
    if job.settings.eigenvalues:
        assert job.y is not None
        return put_rows_together(job.scene, job.x, job.y, rows)
    return (put_together if job.dithered else gathered)(job, rows, store.folder)


def store_of(job: Job, root: Path = ROOT) -> Store:
    """Return the store of a map under `root`."""
    return Store.of(units(job), root)
