"""Commands over many parameters: measures of a scene (study), and a search for the best value of one (optimise)."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

import rig
from rig.cli import printing
from rig.cli.analysis import idle, in_folder
from rig.cli.build import Answer, Made
from rig.cli.options import at
from rig.cli.printing import named, new, refuse, writable
from rig.errors import UsageError
from rig.parameters import Option
from rig.printable import counted

if TYPE_CHECKING:
    from rig.analysis.pool import Store
    from rig.analysis.robust import Job
    from rig.scenes.scene import Scene

Given = Mapping[str, object]


def study(
    context: typer.Context,
    scene: Scene,
    over: Given,
    measure: Sequence[str],
    overrides: Given,
    untold: Given,
    duration: float | None,
    keep: str | None,
    workers: int | None,
    cluster: str,
    out: Path,
    force: bool,
    to: Annotated[Path | None, Option("FILE", "Write the results as NetCDF (.nc) as well.")] = None,
    **plan: Any,
) -> Answer:
    """Run a scene over parameters and evaluate measures: grids, samples of distributions, repeated runs.

    Results are kept: after an interruption the same command continues. Exit code 1: no point has a value.
    --force writes the files of a finished study again.
    """
    import numpy as np

    from rig.analysis.studies import prepared
    from rig.analysis.studies import study as carry_out
    from rig.analysis.studies.factors import check_once
    from rig.machine.files import write_file

    _target(context, to)
    check_once(over, overrides, untold)
    work = prepared(scene, over, measure, duration=duration, keep=keep, **plan)
    store = _store(scene, work, out)
    refuse(store.folder, ("study.csv",), force)
    with printing.kept(store, "points", len(work.items)), printing.bar("points") as progress:
        result = carry_out(work, out, workers, progress, keep, cluster)

    def then() -> Iterator[str]:
        files = ["study.csv", *(path.name for path in result.draw(store.folder))]
        write_file(store.folder / "study.csv", result.csv().encode())
        yield f"\n{store.folder}/{', '.join(files)}"
        if result.recordings:
            yield f"{counted(len(result.recordings), 'recording')} in {store.folder / 'runs'}"
        if to is not None:
            result.save(to)
            yield str(to)

    return Answer(result, not np.isnan(result.values).all(), then=then)


def _store(scene: Scene, work: Any, out: Path) -> Store:
    """The store of what is computed; warnings of the scene and of its varied parameters are printed."""
    from rig.analysis.pool import Store

    printing.warnings(scene)
    if not work.of_run:
        axes = [factor.axis for factor in work.plan.factors]
        idle(scene, *axes)
    return Store.of(work.work, at(out))


def _target(context: typer.Context, to: Path | None) -> None:
    """Refuse a file of the results that could not be written in the end."""
    if to is not None:
        from rig.analysis.studies.result import check_path

        check_path(to)
        named("--to", to)
        writable(context, "--to", to)


def optimise(
    context: typer.Context,
    scene: Scene,
    scene_name: str,
    over: Given,
    against: Given,
    band: str | None,
    limit: Sequence[str],
    decay: str | None,
    series: str | None,
    prove: bool,
    overrides: Given,
    untold: Given,
    workers: int | None,
    cluster: str,
    out: Path,
    force: bool,
    write: Annotated[Path | None, Option("FILE", "Write the designed scene (TOML), with --against.", check=new)] = None,
    **search: Any,
) -> Answer:
    """Search for the parameters with the smallest or largest value of a measure (differential evolution).

    With --against the worst rig of a box counts, and the report compares the design
    with the nominal optimum; without --over it is the worst rig of the scene.

    Values are kept: after an interruption the same command continues.

    Exit code 1: no point has a value, or no tolerance can be held.
    """
    from rig.analysis import robust
    from rig.analysis.studies.factors import check_once
    from rig.analysis.studies.search import prepared
    from rig.analysis.studies.search import search as carry_out

    check_once(over, overrides, untold)
    if against or prove or limit or any(given is not None for given in (band, decay, series)):
        unused = [name for name in ("evaluations", "duration") if _typed(context, name)]
        if unused:
            raise UsageError(f"--{unused[0]}: belongs to a search without --against; leave it out")
        asked = {name: search[name] for name in ("minimise", "maximise", "seed")}
        job = robust.prepared(scene, over, against, band=band, limit=limit, decay=decay, series=series, **asked)
        return _robust(scene, scene_name, job, workers, cluster, out, force, write, prove)
    if write is not None:
        raise UsageError("--write: writes a scene that was designed against something; add --against")
    work = prepared(scene, over, **search)
    store = _store(scene, work, out)
    refuse(store.folder, ("search.csv",), force)
    with printing.kept(store, "points"), printing.bar("points") as progress:
        result = carry_out(work, out, workers, progress, cluster)
    return in_folder(result, store.folder, "search", good=result.best is not None)


def _typed(context: typer.Context, name: str) -> bool:
    """Whether an option was given, not its default."""
    source = context.get_parameter_source(name)
    return source is not None and source.name == "COMMANDLINE"


def _robust(
    scene: Scene,
    scene_name: str,
    job: Job,
    workers: int | None,
    cluster: str,
    out: Path,
    force: bool,
    file: Path | None,
    prove: bool,
) -> Answer:
    """Design against uncertain values."""
    from rig.analysis import robust
    from rig.analysis.pool import Store
    from rig.analysis.robust.in_time import envelopes
    from rig.analysis.robust.result import NOTHING_DESIGNED, write
    from rig.machine.files import write_file

    if file is not None and not job.box.free:
        raise UsageError(f"--write: {NOTHING_DESIGNED}")
    printing.warnings(scene)
    store = Store.of(job.work, at(out))
    refuse(store.folder, ("robust.csv",), force)
    with printing.kept(store, "batches of rigs"):
        result = robust.designed(job, at(out), workers, printing.bar, cluster, prove, printing.note)
    written = [] if file is None else [f"{write(result, file, scene_name)}: the designed scene"]
    if result.timed:
        name = store.folder / "in_time.csv"
        write_file(name, envelopes(result.timed).csv().encode())
        written.append(f"{name}: envelopes of the runs")
    return in_folder(result, store.folder, "robust", below=written, good=result.held)


COMMANDS = {
    "study": Made(
        study,
        'rig study belt --over "load.force=10 N:30 N:5" --over "friction.mu_static=normal(0.4, 0.02)" --measure '
        "cycle.amplitude",
        rig.study,
    ),
    "optimise": Made(
        optimise,
        'rig optimise belt --over "drive.speed=0.05 m/s:0.3 m/s" --over "load.force=10 N:30 N" --minimise '
        "cycle.amplitude",
        rig.optimise,
    ),
}
