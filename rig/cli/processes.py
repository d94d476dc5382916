"""The processes of a run one by one, each in a terminal of its own."""

from __future__ import annotations

import sys
from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from rig.cli import printing
from rig.cli.build import Made
from rig.cli.options import (
    After,
    Before,
    Lockstep,
    Most,
    NewName,
    Out,
    Pace,
    RunName,
    Ticket,
    Wait,
    When,
    live_pace,
    recording,
    refuse_all,
    trigger,
)
from rig.cli.printing import new
from rig.cli.recordings import opened
from rig.errors import ExitCode
from rig.extras import check
from rig.parameters import Argument, Option
from rig.printable import printable

if TYPE_CHECKING:
    from rig.scenes.scene import Scene

ControllersWait = Annotated[
    float, Option("TIME", "Longest wait for the controllers, in seconds or with a unit; 0: do not wait.", low=0)
]
ControllerName = Annotated[str, Argument("NAME|FILE", "A controller of the scene, or a file.")]
ShownLog = Annotated[Path | None, Argument("[LOG]", "A recording (MCAP). Default: a live run.", check=recording)]
Web = Annotated[bool, Option("", "Show the run on a page in the browser.", "--web")]
RerunFile = Annotated[Path | None, Option("FILE", "Write a rerun file (.rrd) instead of showing the run.", check=new)]


def plant(
    scene: Scene,
    untold: Mapping[str, object],
    duration: float | None,
    speed: Pace = None,
    lockstep: Lockstep = False,
    name: NewName = None,
    wait: ControllersWait = 30.0,
) -> None:
    """Start the plant with its sensors. Controllers, recorder and viewer may join at any time."""
    factor = live_pace(speed, lockstep)
    from rig.bench.live.outcome import Job, Outcome
    from rig.bench.live.plant_process import carry_out
    from rig.bench.live.status import Live

    printing.run_warnings(scene, duration)
    awaited: list[tuple[str, str]] = []
    if wait:
        for key in scene.controllers:
            if key not in scene.in_plant:
                awaited.append(("controller", key))
    job = Job.at(
        factor,
        scene,
        run=name,
        lockstep=lockstep,
        duration=duration,
        expect=tuple(awaited),
        wait=wait,
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
    overrides: Mapping[str, object],
    trust: bool,
    run: RunName = None,
    ticket: Ticket = None,
    wait: Wait = 10.0,
) -> None:
    """Start one controller as a process: a controller of the scene, or your own from a file."""
    from rig.controllers.runtime.process import run as serve

    serve(name, run, changes=overrides, wait=wait, trust=trust, ticket=ticket, say=printing.note)


def record(
    run: RunName = None,
    ticket: Ticket = None,
    out: Out = None,
    when: When = None,
    before: Before = None,
    after: After = None,
    most: Most = None,
    wait: Wait = 10.0,
    *,
    force: bool,
) -> None:
    """Record a live run until it ends; with --trigger only windows around the instants at which a condition holds."""
    chosen = trigger(when, before, after, most)
    from rig.record.recorder import record as write

    recorded = write(run, out, wait=wait, replace=force, trigger=chosen, ticket=ticket, say=printing.note)
    printing.line(recorded.text())
    if not recorded.complete:
        raise typer.Exit(ExitCode.FAILED)


def view(
    log: ShownLog = None,
    run: RunName = None,
    ticket: Ticket = None,
    web: Web = False,
    save: RerunFile = None,
    wait: Wait = 10.0,
    *,
    trust: bool,
) -> None:
    """Show a recording or a live run in rerun: the rig, its curves, events, commands and protocol."""
    two_runs = log and run is not None
    two_tickets = log and ticket is not None
    other_format = save and save.suffix != ".rrd"
    refuse_all(
        (two_runs, f"{log} and --run {run}: name a recording or a live run, not both"),
        (two_tickets, f"{log} and --ticket {ticket}: name a recording or a live run, not both"),
        (other_format, f"--save {save}: is written in rerun's format, so its name must end in .rrd"),
    )
    check("rerun", "view", "rig view")
    if log is None:
        from rig.view.process import view as show

        show(run, web=web, save=save, wait=wait, trust=trust, ticket=ticket, say=printing.note)
        return
    from rig.view.recording import view_run

    view_run(opened(log, trust), printable(log.stem), web=web, save=save, say=printing.note)


COMMANDS = {
    "plant": Made(plant, "rig live plant pendulum --run mine"),
    "control": Made(control, "rig live control nf --run mine"),
    "record": Made(
        record,
        "rig live record --run mine   |   rig live record --trigger 'vibrometer > 0.1 m/s' --before 2 --after 5",
    ),
    "view": Made(view, "rig view mine.mcap   |   rig view --run mine"),
}
