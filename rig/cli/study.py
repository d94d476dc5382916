"""Commands over many parameters: measures of a scene (study), and a search for the best value of one (optimise)."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Annotated

import typer

from rig.cli import printing
from rig.cli.analysis import Workers, idle, written
from rig.cli.options import (
    Changes,
    Duration,
    Force,
    Json,
    Redesign,
    Results,
    SceneName,
    Untold,
    at,
    changes,
    seconds,
    the_scene,
)
from rig.cli.printing import named, refuse, writable
from rig.errors import UsageError
from rig.printable import counted

Samples = Annotated[
    int | None, typer.Option(min=1, metavar="N", help="Samples of the distributions. Default: 64.", show_default=False)
]
Seed = Annotated[int | None, typer.Option(min=0, metavar="N", help="Seed of samples and runs. Default: the scene's.")]
Keep = Annotated[
    str | None,
    typer.Option(metavar="CONDITION", help='Keep recordings of the runs for which it holds: "cycle.amplitude > 5 mm".'),
]
ClusterName = Annotated[
    str,
    typer.Option(
        "--cluster",
        metavar="WHERE",
        show_default=False,
        help="Compute on a dask cluster: the address of its scheduler, tcp://HOST:PORT.",
    ),
]
Varied = Annotated[
    list[str] | None,
    typer.Option(
        "--over",
        metavar="KEY=VALUES",
        help='Vary a parameter: "load.force=10 N:30 N:5", "load.force=10, 20 N", '
        '"friction.mu_static=normal(0.4, 0.02)". Repeatable.',
    ),
]
Measures = Annotated[
    list[str] | None,
    typer.Option(
        "--measure",
        metavar="NAME",
        help="Measure: cycle.amplitude, motion.period, run.rms, ..., or FILE.py:FUNCTION of a Run. Repeatable.",
    ),
]
Sampling = Annotated[
    str | None, typer.Option(metavar="HOW", help="random (default), latin, sobol; saltelli for Sobol indices.")
]
Repetitions = Annotated[int | None, typer.Option(min=1, metavar="N", help="Runs of each point, with different seeds.")]
NetCDF = Annotated[Path | None, typer.Option("--to", metavar="FILE", help="Write the results as NetCDF (.nc) as well.")]
Ranges = Annotated[
    list[str] | None,
    typer.Option("--over", metavar="KEY=FROM:TO", help='Range of a parameter: "load.force=10 N:30 N". Repeatable.'),
]
Minimised = Annotated[
    str | None,
    typer.Option(metavar="MEASURE", help="Measure to minimise: a name as for rig study, or FILE.py:FUNCTION."),
]
Maximised = Annotated[str | None, typer.Option(metavar="MEASURE", help="Measure to maximise instead.")]
Evaluations = Annotated[int, typer.Option(min=1, max=1_000_000, metavar="N", help="Largest number of points.")]


def study(
    context: typer.Context,
    scene: SceneName,
    over: Varied = None,
    measure: Measures = None,
    p: Changes = None,
    untold: Untold = None,
    redesign: Redesign = False,
    samples: Samples = None,
    sampling: Sampling = None,
    repeat: Repetitions = None,
    seed: Seed = None,
    duration: Duration = None,
    keep: Keep = None,
    to: NetCDF = None,
    workers: Workers = None,
    cluster: ClusterName = "",
    out: Results = Path("studies"),
    force: Force = False,
    as_json: Json = False,
) -> None:
    """Run a scene over parameters and evaluate measures: grids, samples of distributions, repeated runs.

    Results are kept: after an interruption the same command continues. Exit code 1: no point has a value.
    --force writes the files of a finished study again.
    """
    import numpy as np

    from rig.analysis.pool import Store
    from rig.analysis.studies import prepared
    from rig.analysis.studies import study as carry_out
    from rig.machine.files import write_file

    loaded = the_scene(scene, changes(p), untold=untold, redesign=redesign)
    _target(context, to)
    varied = values(over, "--over", _set(p, untold))
    work = prepared(
        loaded, varied, measure or [], samples, sampling or "random", repeat or 1, seed, seconds(duration), keep
    )
    printing.warnings(loaded)
    if not work.of_run:
        axes = [factor.axis for factor in work.plan.factors]
        idle(loaded, *axes)
    store = Store.of(work.work, at(out))
    refuse(store.folder, ("study.csv",), force)
    with printing.kept(store, "points", len(work.items)), printing.bar("points") as progress:
        result = carry_out(work, out, workers, progress, keep, cluster)
    printing.result(result, as_json)
    figures = result.draw(store.folder)
    write_file(store.folder / "study.csv", result.csv().encode())
    if to is not None:
        result.save(to)
    if not as_json:
        files = ["study.csv", *(path.name for path in figures)]
        printing.line(f"\n{store.folder}/{', '.join(files)}")
        if result.recordings:
            printing.line(f"{counted(len(result.recordings), 'recording')} in {store.folder / 'runs'}")
        if to is not None:
            printing.line(str(to))
    printing.passed(not np.isnan(result.values).all())


def _set(p: list[str] | None, untold: list[str] | None) -> dict[str, dict[str, str]]:
    """Option -> the keys that it sets."""
    return {"-p": changes(p), "--untold": changes(untold, "--untold")}


def values(given: list[str] | None, option: str, changed: Mapping[str, Mapping[str, object]]) -> dict[str, str]:
    """Dotted key -> values as text, of all options of this name.

    `changed`: other option -> its keys, which cannot be varied too.
    """
    texts: dict[str, str] = {}
    for assignment in given or []:
        key, _, text = (part.strip() for part in assignment.partition("="))
        if not key or not text:
            raise UsageError(f'{option} {assignment}: expected KEY=VALUES, such as {option} "load.force=10 N:30 N:5"')
        if key in texts:
            raise UsageError(f"{option} {assignment}: {key} is given twice")
        for other, keys in changed.items():
            if key in keys:
                raise UsageError(f"{option} {assignment}: {key} is set with {other}; leave one of the two out")
        texts[key] = text
    return texts


def _target(context: typer.Context, to: Path | None) -> None:
    """Refuse a file of the results that could not be written in the end."""
    if to is not None:
        from rig.analysis.studies.result import check_path

        check_path(to)
        named("--to", to)
        writable(context, "--to", to)


def optimise(
    scene: SceneName,
    over: Ranges = None,
    minimise: Minimised = None,
    maximise: Maximised = None,
    p: Changes = None,
    untold: Untold = None,
    redesign: Redesign = False,
    evaluations: Evaluations = 600,
    seed: Seed = None,
    duration: Duration = None,
    workers: Workers = None,
    cluster: ClusterName = "",
    out: Results = Path("searches"),
    force: Force = False,
    as_json: Json = False,
) -> None:
    """Search for the parameters with the smallest or largest value of a measure (differential evolution).

    Values are kept: after an interruption the same command continues.

    Exit code 1: no point has a value.
    """
    from rig.analysis.pool import Store
    from rig.analysis.studies.search import prepared, search

    if (minimise is None) == (maximise is None):
        raise UsageError("state one measure: --minimise cycle.amplitude, or --maximise")
    loaded = the_scene(scene, changes(p), untold=untold, redesign=redesign)
    measure = minimise or maximise or ""
    ranges = values(over, "--over", _set(p, untold))
    work = prepared(loaded, ranges, measure, maximise is not None, evaluations, seed, seconds(duration))
    printing.warnings(loaded)
    if not work.of_run:
        axes = [factor.axis for factor in work.plan.factors]
        idle(loaded, *axes)
    store = Store.of(work.work, at(out))
    refuse(store.folder, ("search.csv",), force)
    with printing.kept(store, "points"), printing.bar("points") as progress:
        result = search(work, out, workers, progress, cluster)
    written(result, store.folder, "search", as_json)
    printing.passed(result.best is not None)


COMMANDS = {
    "study": (
        study,
        'rig study belt --over "load.force=10 N:30 N:5" --over "friction.mu_static=normal(0.4, 0.02)" --measure '
        "cycle.amplitude",
    ),
    "optimise": (
        optimise,
        'rig optimise belt --over "drive.speed=0.05 m/s:0.3 m/s" --over "load.force=10 N:30 N" --minimise '
        "cycle.amplitude",
    ),
}
