"""Commands that run a scene."""

from __future__ import annotations

import sys
from collections.abc import Collection, Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from rig.cli import printing
from rig.cli.options import (
    Accuracy,
    After,
    Before,
    Budget,
    Changes,
    Controllers,
    Duration,
    Force,
    Json,
    Lockstep,
    Most,
    Net,
    NewName,
    Out,
    Pace,
    SceneName,
    When,
    accuracy,
    added,
    changes,
    linked,
    pace,
    seconds,
    share,
    the_scene,
    there,
    trigger,
)
from rig.cli.outputs import draw, new
from rig.errors import UsageError

if TYPE_CHECKING:
    from rig.scenes.scene import Scene

View = Annotated[bool, typer.Option("--view", help="Show the run live in rerun.")]
Web = Annotated[bool, typer.Option("--web", help="Show the run live on a page in the browser.")]
Figure = Annotated[
    Path | None, typer.Option(metavar="FILE", callback=new, help="Draw a figure of the run (PNG, SVG, PDF).")
]
Only = Annotated[
    str | None,
    typer.Option(
        "--only", metavar="NAMES", help="Sensors and outputs that --figure draws over time, separated by commas."
    ),
]
DIALS = ("clock.method", "clock.tolerance", "clock.rk4_step")


def demo(view: View = False, web: Web = False) -> None:
    """Run the pendulum with its controller. Write a recording, a figure and a summary."""
    from rig.analysis.kernel_shapes import prepare
    from rig.bench.supervise import run as supervise
    from rig.kernel import compiled
    from rig.scenes import load

    scene = load("pendulum")
    printing.note(f"{scene.title}\n\n{scene.about}\n")
    sys.stderr.write("1 of 3, ")  # the kernels say themselves that they are compiled, and how far it is
    sys.stderr.flush()
    prepare([scene])
    if not compiled():
        printing.note("compile: all kernels are compiled already")
    seconds = 1e-9 * (scene.duration_ns or 0)
    printing.note(f"2 of 3, run: plant, controller and recorder as processes, {seconds:g} s in real time")
    outcome = supervise(scene, view=view, web=web)
    figure = Path(outcome.log).with_suffix(".png") if outcome.log else None
    if figure is not None:
        printing.note("3 of 3, draw: the figure of the run; a second or two")
        _draw(outcome.log, figure)
    printing.line(outcome.text())
    if figure is not None and figure.exists():
        printing.line(f" figure    {figure}\n           {figure.resolve().as_uri()}")
    raise typer.Exit(outcome.exit_code)


def run(
    scene: SceneName,
    p: Changes = None,
    controller: Controllers = None,
    net: Net = None,
    speed: Pace = None,
    lockstep: Lockstep = False,
    duration: Duration = None,
    view: View = False,
    web: Web = False,
    name: NewName = None,
    out: Out = None,
    figure: Figure = None,
    only: Only = None,
    when: When = None,
    before: Before = None,
    after: After = None,
    most: Most = None,
    force: Force = False,
    budget: Budget = None,
    precision: Accuracy = None,
    as_json: Json = False,
) -> None:
    """Run a scene in real time, with plant, controllers and recorder as processes."""
    factor, length, given = pace(speed, lockstep), seconds(duration), changes(p)
    names = listed(only, figure)
    links = linked(net, given)
    windows = trigger(when, before, after, most)
    if windows is not None and figure is not None:
        raise UsageError("--figure: draws the recording of a whole run; --trigger records windows only")
    from rig.bench.job import keeps_up
    from rig.bench.supervise import run as supervise

    loaded = the_scene(scene, given, {"--controller": added(controller), "--net": links})
    there(controller, loaded)
    drawable(names, loaded)
    keeps_up(loaded, factor)
    loaded = configured(loaded, given, precision, budget)
    if windows is not None:  # the recorder would find what is wrong only when the run has begun
        from rig.record.windows import replaceable

        outputs = {name: output.unit for name, output in loaded.assemble().outputs.items()}
        windows.condition.bound(outputs, {name: sensor.delivers for name, sensor in loaded.sensors.items()})
        if out is not None:
            replaceable(out, force)
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
        name=name,
        trigger=windows.options() if windows is not None else (),
    )
    if as_json:
        printing.report(outcome.to_json())
    else:
        printing.line(outcome.text())
    if figure is not None and outcome.log:
        _draw(outcome.log, figure, names)
    raise typer.Exit(outcome.exit_code)


def listed(only: str | None, figure: Path | None) -> list[str]:
    """The names that --only lists. Raises UsageError without a figure or without names."""
    names = [name.strip() for name in (only or "").split(",") if name.strip()]
    if only is not None and figure is None:
        raise UsageError("--only: chooses what --figure draws; add --figure FILE")
    if only is not None and not names:
        raise UsageError("--only: expected names of sensors or outputs, separated by commas")
    return names


def drawable(names: Collection[str], scene: Scene) -> None:
    """Raise UsageError for a name that a run of the scene will not have."""
    if not names:
        return
    from rig.record.names import listing, unknown

    outputs = {name: output.unit for name, output in scene.assemble().outputs.items()}
    known = listing({name: sensor.delivers for name, sensor in scene.sensors.items()}, outputs)
    for name in names:
        if name not in known and name not in outputs:
            raise unknown(name, known, "scene")


def configured(scene: Scene, overrides: Mapping[str, object], precision: float | None, budget: str | None) -> Scene:
    """The scene with the method and step for the target error or the budget."""
    wanted, most = accuracy(precision, "--accuracy"), share(budget)
    if wanted is None and most is None:
        return scene
    if given := [key for key in DIALS if key in overrides]:
        raise UsageError(f"{', '.join(given)}: --accuracy and --budget select this value; give one or the other")
    from rig.qualify.cost import chosen

    with printing.bar("settings") as progress:
        return chosen(scene, wanted, most, printing.note, report=progress)


def _draw(log: str, figure: Path, only: Collection[str] = ()) -> None:
    """Draw a recording."""
    from rig.cli.logs import opened, without_outputs

    run = opened(Path(log))
    if nothing := without_outputs(run, log):
        printing.note(f"no figure: {nothing}")
        return
    draw(run, figure, only)
    printing.note(f"figure {figure}")


COMMANDS = {
    "demo": (demo, "rig demo --view"),
    "run": (run, 'rig run pendulum --view -p drive.speed="2 rpm"'),
}
