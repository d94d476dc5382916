"""Commands that run a scene."""

from __future__ import annotations

import time
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from rig.cli import printing
from rig.cli.options import (
    Accuracy,
    Budget,
    Changes,
    Duration,
    Force,
    Json,
    Lockstep,
    Out,
    Pace,
    SceneName,
    accuracy,
    changes,
    pace,
    seconds,
    share,
    the_scene,
)
from rig.cli.outputs import new
from rig.errors import Interrupted, NumericsError, UsageError
from rig.process import told_to_stop

if TYPE_CHECKING:
    from rig.record.run import Run
    from rig.scenes.scene import Scene

View = Annotated[bool, typer.Option("--view", help="Show the run live in rerun.")]
Web = Annotated[bool, typer.Option("--web", help="Show the run live on a page in the browser.")]
Figure = Annotated[
    Path | None, typer.Option(metavar="FILE", callback=new, help="Draw a figure of the run (PNG, SVG, PDF).")
]
Repeat = Annotated[
    int | None,
    typer.Option(min=2, max=10_000, metavar="N", help="Simulate with N seeds on all cores and report the spread."),
]

DIALS = ("clock.method", "clock.tolerance", "clock.rk4_step")


def demo(view: View = False, web: Web = False) -> None:
    """Run the pendulum with its controller. Write a recording, a figure and a summary."""
    from rig.bench.supervise import run as supervise
    from rig.scenes import load

    scene = load("pendulum")
    printing.note(f"{scene.title}\n\n{scene.about}\n")
    outcome = supervise(scene, view=view, web=web)
    printing.line(outcome.text())
    if outcome.log:
        _draw(outcome.log, Path(outcome.log).with_suffix(".png"))
    raise typer.Exit(outcome.exit_code)


def run(
    scene: SceneName,
    p: Changes = None,
    speed: Pace = None,
    lockstep: Lockstep = False,
    duration: Duration = None,
    view: View = False,
    web: Web = False,
    out: Out = None,
    figure: Figure = None,
    force: Force = False,
    budget: Budget = None,
    precision: Accuracy = None,
    as_json: Json = False,
) -> None:
    """Run a scene in real time, with plant, controllers and recorder as processes."""
    factor, length, overrides = pace(speed, lockstep), seconds(duration), changes(p)
    from rig.bench.job import keeps_up
    from rig.bench.supervise import run as supervise

    loaded = the_scene(scene, overrides)
    keeps_up(loaded, factor)
    loaded = _set(loaded, overrides, precision, budget)
    printing.run_warnings(loaded, length)
    outcome = supervise(
        loaded,
        pace=factor,
        lockstep=lockstep,
        duration=length,
        view=view,
        web=web,
        out=out,
        replace=force,
    )
    if as_json:
        printing.report(outcome.to_json())
    else:
        printing.line(outcome.text())
    if figure is not None and outcome.log:
        _draw(outcome.log, figure)
    raise typer.Exit(outcome.exit_code)


def _set(scene: Scene, overrides: Mapping[str, object], precision: float | None, budget: str | None) -> Scene:
    """The scene with the method and step for the target error or the budget."""
    wanted, most = accuracy(precision, "--accuracy"), share(budget)
    if wanted is None and most is None:
        return scene
    if given := [key for key in DIALS if key in overrides]:
        raise UsageError(f"{', '.join(given)}: --accuracy and --budget select this value; give one or the other")
    from rig.qualify.cost import chosen

    with printing.bar("settings") as progress:
        return chosen(scene, wanted, most, printing.note, report=progress)


def _draw(log: str, figure: Path) -> None:
    """Draw a recording."""
    from rig.cli.logs import opened
    from rig.view.run_figure import draw

    run = opened(Path(log))
    if not run.time.size:
        printing.note(f"no figure: {log} ends before its first sample")
        return
    draw(run, figure)
    printing.note(f"figure {figure}")


def simulate(
    scene: SceneName,
    p: Changes = None,
    duration: Duration = None,
    method: Annotated[
        str | None,
        typer.Option(
            metavar="METHOD",
            help="Integration method, as clock.method: auto (default), exact, dopri5, rk4, kick, smooth.",
        ),
    ] = None,
    out: Out = None,
    figure: Figure = None,
    force: Force = False,
    budget: Budget = None,
    precision: Accuracy = None,
    repeat: Repeat = None,
    as_json: Json = False,
) -> None:
    """Simulate a scene with its controllers in one process, as fast as possible.

    With --repeat: simulate with several seeds on all cores and report the
    spread of onset, RMS, spectrum and other results. Ctrl-C reports the runs
    that are finished.
    """
    length, overrides = seconds(duration), changes(p)
    if method is not None:
        overrides["clock.method"] = method
    if repeat is not None and out is not None:
        raise UsageError("--out: --repeat writes no recordings; leave out one of the two")
    import rig

    loaded = _set(the_scene(scene, overrides), overrides, precision, budget)
    printing.run_warnings(loaded, length)
    if repeat is not None:
        _repeated(loaded, repeat, length, figure, as_json)
        return
    begin = time.perf_counter()
    with _asked_to_stop() as asked:
        found = rig.simulate(loaded, length, stop=lambda: f"interrupted by {asked[0]}" if asked else "")
    wall = time.perf_counter() - begin
    if out is not None:
        _save(found, loaded, out, force)
    if as_json:
        printing.report({**found.summary, "energy": found.energy, "events": found.events, "fault": found.fault})
    else:
        from rig.analysis.text_table import columns

        for line in columns(_told(found, wall, out, figure), "<<"):
            printing.line(line)
    for text in (event["text"] for event in found.told if event["kind"] == "warning"):
        printing.note(f"warning: {text}")
    if found.fault:
        printing.note(found.fault)
    if figure is not None:
        from rig.view.run_figure import draw

        draw(found, figure)
    if found.fault or any(event["kind"] == "limit" for event in found.told):
        raise typer.Exit(NumericsError.exit_code)
    if asked:
        raise typer.Exit(Interrupted.exit_code)


@contextmanager
def _asked_to_stop() -> Iterator[list[str]]:
    """Signals that asked this process to end; the second one ends it at once."""
    asked: list[str] = []

    def heard(name: str) -> None:
        if asked:
            raise KeyboardInterrupt
        asked.append(name)
        printing.note("ending the run; press Ctrl-C again to end at once")

    with told_to_stop(heard):
        yield asked


def _repeated(scene: Scene, count: int, length: float | None, figure: Path | None, as_json: bool) -> None:
    from rig.analysis.repeat import repeat

    with _asked_to_stop() as asked, printing.bar("runs") as progress:
        found = repeat(
            scene, count, length, progress=progress, stop=lambda: f"interrupted by {asked[0]}" if asked else ""
        )
    if as_json:
        printing.report(found.to_json())
    else:
        printing.line(found.text())
    if figure is not None and found.seen:
        from rig.analysis.repeat.figure import draw

        draw(found, figure)
    if asked:
        raise typer.Exit(Interrupted.exit_code)
    if any(one.fault for one in found.seen):
        raise typer.Exit(NumericsError.exit_code)


def _save(run: Run, scene: Scene, out: Path, replace: bool) -> None:
    """Write a run of this process, with what a replay into its controllers needs."""
    from rig.record.provenance import provenance
    from rig.record.save_run import save

    run.provenance = provenance(scene.seed)
    save(run, out, replace=replace)  # another command may have written it since this one began


def _told(run: Run, wall: float, out: Path | None, figure: Path | None) -> Iterator[tuple[str, str]]:
    """The summary of a run in this process, as labelled lines."""
    from rig.bench import status
    from rig.record.statistics import contact

    plant, length = run.summary["plant"], float(run.time[-1])
    yield "run", f"{length:g} s simulated in {wall:.2f} s, compiling included; ended: {run.summary['ended']}"
    yield "plant", status.plant(plant, plant["energy_error"])
    for name in ("displacement", "velocity"):
        if name in run.signals:
            v = run.signals[name]
            yield name, f"{v.min():.6g} .. {v.max():.6g} {run.units[name]}"
    if told := contact(run):
        yield "contact", told
    for name, counts in run.summary["controllers"].items():
        yield name, ", ".join(f"{count} {what}" for what, count in counts.items() if count)
    for one in run.summary["audit"]:
        if one["noted"]:
            yield "audit", one["text"]
    for label, path in (("log", out), ("figure", figure)):
        if path is not None:
            yield label, str(path)
    yield "next", f"rig verify {out} | rig replay {out}" if out else "rig simulate ... --out FILE --figure FILE"


COMMANDS = {
    "demo": (demo, "rig demo --view"),
    "run": (run, 'rig run pendulum --view -p drive.speed="2 rpm"'),
    "simulate": (simulate, "rig simulate pendulum --duration 10 --out pendulum.mcap --figure pendulum.png"),
}
