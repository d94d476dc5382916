"""The command `rig optimise`: a global search for the smallest or largest value of a measure."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from rig.cli import printing
from rig.cli.maps import Workers, idle
from rig.cli.options import Changes, Duration, Force, Json, SceneName, at, changes, seconds, the_scene
from rig.cli.outputs import draw, refuse
from rig.cli.study import ClusterName, DryRun, scripted, values
from rig.errors import ExitCode, UsageError

Ranges = Annotated[
    list[str] | None,
    typer.Option("--over", metavar="KEY=FROM:TO", help='Range of a parameter: "load.force=10 N:30 N". Repeatable.'),
]
Minimise = Annotated[
    str | None,
    typer.Option(metavar="MEASURE", help="Measure to minimise: a name as for rig study, or FILE.py:FUNCTION."),
]
Maximise = Annotated[str | None, typer.Option(metavar="MEASURE", help="Measure to maximise instead.")]
Evaluations = Annotated[int, typer.Option(min=1, max=1_000_000, metavar="N", help="Largest number of points.")]
Seed = Annotated[int | None, typer.Option(min=0, metavar="N", help="Seed of search and runs. Default: the scene's.")]
Folder = Annotated[
    Path, typer.Option(metavar="FOLDER", help="Folder for the results; each search has a folder of its own in it.")
]


def optimise(
    scene: SceneName,
    over: Ranges = None,
    minimise: Minimise = None,
    maximise: Maximise = None,
    p: Changes = None,
    evaluations: Evaluations = 600,
    seed: Seed = None,
    duration: Duration = None,
    workers: Workers = None,
    cluster: ClusterName = "",
    dry_run: DryRun = False,
    out: Folder = Path("searches"),
    force: Force = False,
    as_json: Json = False,
) -> None:
    """Search for the parameters with the smallest or largest value of a measure (differential evolution).

    Values are kept: after an interruption the same command continues.

    Exit code 1: no point has a value.
    """
    from rig.analysis.pool import Store
    from rig.analysis.studies.search import prepared, search
    from rig.user_files import write_file

    if (minimise is None) == (maximise is None):
        raise UsageError("state one measure: --minimise cycle.amplitude, or --maximise")
    loaded = the_scene(scene, changes(p))
    measure, ranges = minimise or maximise or "", values(over, "--over", changes(p))
    work = prepared(loaded, ranges, measure, maximise is not None, evaluations, seed, seconds(duration))
    printing.warnings(loaded)
    if not work.measure.of_run:
        idle(loaded, *(one.axis for one in work.factors))
    if scripted(cluster, dry_run, workers):
        return
    store = Store.of(work.work, at(out))
    refuse(store.folder, ("search.csv",), force)
    with printing.kept(store, "points"), printing.bar("points") as progress:
        found = search(work, out, workers, progress, cluster)
    if as_json:
        printing.report(found.to_json())
    else:
        printing.line(found.text())
        printing.line(f"\n{store.folder}/search.csv, search.png")
    draw(found, store.folder / "search.png")
    write_file(store.folder / "search.csv", found.csv().encode())
    if found.best is None:
        raise typer.Exit(ExitCode.FAILED)


COMMANDS = {
    "optimise": (
        optimise,
        'rig optimise belt --over "drive.speed=0.05 m/s:0.3 m/s" --over "load.force=10 N:30 N" --minimise '
        "cycle.amplitude",
    )
}
