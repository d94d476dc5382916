"""The processes of a run one by one, each in a terminal of its own."""

from __future__ import annotations

import sys
from pathlib import Path
from typing import Annotated

import typer

from rig.cli import printing
from rig.cli.options import (
    After,
    Before,
    Changes,
    Duration,
    Force,
    Lockstep,
    Most,
    NewName,
    Out,
    Pace,
    RunName,
    SceneName,
    Trust,
    Untold,
    Wait,
    When,
    changes,
    live_pace,
    refuse_all,
    seconds,
    the_scene,
    trigger,
)
from rig.cli.printing import new
from rig.cli.recordings import opened, recording
from rig.extras import check
from rig.printable import printable

ControllersWait = Annotated[
    str,
    typer.Option(metavar="TIME", help="Longest wait for the controllers, in seconds or with a unit; 0: do not wait."),
]
ControllerName = Annotated[str, typer.Argument(metavar="NAME|FILE", help="A controller of the scene, or a file.")]
ShownLog = Annotated[
    Path | None,
    typer.Argument(metavar="[LOG]", help="A recording (MCAP). Default: a live run.", callback=recording),
]
Web = Annotated[bool, typer.Option("--web", help="Show the run on a page in the browser.")]
RerunFile = Annotated[
    Path | None,
    typer.Option(metavar="FILE", callback=new, help="Write a rerun file (.rrd) instead of showing the run."),
]


def plant(
    scene: SceneName,
    p: Changes = None,
    untold: Untold = None,
    speed: Pace = None,
    lockstep: Lockstep = False,
    duration: Duration = None,
    name: NewName = None,
    wait: ControllersWait = "30",
) -> None:
    """Start the plant with its sensors. Controllers, recorder and viewer may join at any time."""
    factor = live_pace(speed, lockstep)
    length = seconds(duration)
    overrides = changes(p)
    patience = seconds(wait, "--wait", low=0.0) or 0.0
    from rig.bench.live.outcome import Job, Outcome
    from rig.bench.live.plant_process import carry_out
    from rig.bench.live.status import Live

    loaded = the_scene(scene, overrides, untold=untold)
    printing.run_warnings(loaded, length)
    awaited: list[tuple[str, str]] = []
    if patience:
        awaited = [("controller", key) for key in loaded.controllers if key not in loaded.in_plant]
    job = Job.at(
        factor,
        loaded,
        run=name,
        lockstep=lockstep,
        duration=length,
        expect=tuple(awaited),
        wait=patience,
        command=tuple(sys.argv),
    )
    live = Live()
    try:
        outcome = Outcome(carry_out(job, live.say, live.show))
    finally:
        live.done()
    printing.line(outcome.text())
    raise typer.Exit(outcome.exit_code)


def control(
    name: ControllerName,
    run: RunName = None,
    p: Changes = None,
    trust: Trust = False,
    wait: Wait = "10",
) -> None:
    """Start one controller as a process: a controller of the scene, or your own from a file."""
    overrides = changes(p)
    patience = seconds(wait, "--wait", low=0.0) or 0.0
    from rig.controllers.runtime.process import run as serve

    serve(name, run, changes=overrides, wait=patience, trust=trust, say=printing.note)


def record(
    run: RunName = None,
    out: Out = None,
    when: When = None,
    before: Before = None,
    after: After = None,
    most: Most = None,
    force: Force = False,
    wait: Wait = "10",
) -> None:
    """Record a live run until it ends; with --trigger only windows around the instants at which a condition holds."""
    patience = seconds(wait, "--wait", low=0.0) or 0.0
    chosen = trigger(when, before, after, most)
    from rig.record.recorder import record as write

    recorded = write(run, out, wait=patience, replace=force, trigger=chosen, say=printing.note)
    printing.line(recorded.text())
    printing.passed(recorded.complete)


def view(
    log: ShownLog = None,
    run: RunName = None,
    web: Web = False,
    save: RerunFile = None,
    force: Force = False,
    trust: Trust = False,
    wait: Wait = "10",
) -> None:
    """Show a recording or a live run in rerun: the rig, its curves, events, commands and protocol."""
    patience = seconds(wait, "--wait", low=0.0) or 0.0
    refuse_all(
        (log and run is not None, f"{log} and --run {run}: name a recording or a live run, not both"),
        (save and save.suffix != ".rrd", f"--save {save}: is written in rerun's format, so its name must end in .rrd"),
    )
    check("rerun", "view", "rig view")
    if log is None:
        from rig.view.process import view as show

        show(run, web=web, save=save, wait=patience, trust=trust, say=printing.note)
        return
    from rig.view.recording import view_run

    view_run(opened(log, trust), printable(log.stem), web=web, save=save, say=printing.note)


COMMANDS = {
    "plant": (plant, "rig live plant pendulum --run mine"),
    "control": (control, "rig live control nf --run mine"),
    "record": (
        record,
        "rig live record --run mine   |   rig live record --trigger 'vibrometer > 0.1 m/s' --before 2 --after 5",
    ),
    "view": (view, "rig view mine.mcap   |   rig view --run mine"),
}
