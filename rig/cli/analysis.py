"""Commands that analyse a rig without running its protocol: modes, cycle, identify."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from rig.cli import printing
from rig.cli.options import Changes, Force, Json, SceneName, added, changes, loop_option, named, seconds, the_scene
from rig.cli.outputs import draw, new
from rig.errors import ExitCode, SceneError

if TYPE_CHECKING:
    from rig.analysis.control_loop import Loop
    from rig.analysis.modes_report import Modes
    from rig.analysis.sweep import Sweep
    from rig.scenes.scene import Scene

Along = Annotated[
    str | None,
    typer.Option(
        "--sweep",
        metavar="KEY=A:B:N",
        help='Compute eigenvalues over a parameter, and critical values: "drive.speed=0.05 m/s:0.4 m/s:50".',
    ),
]
Controller = Annotated[
    str | None, loop_option("Close the loop of this controller: eigenvalues, gain, phase and delay margins.")
]
Picture = Annotated[
    Path | None, typer.Option("--figure", metavar="FILE", callback=new, help="Draw the result (PNG, SVG, PDF).")
]
Drawn = Annotated[
    Path | None,
    typer.Option("--figure", metavar="FILE", callback=new, help="Draw measurements and fit (PNG, SVG, PDF)."),
]
Drawing = Annotated[
    Path | None, typer.Option("--figure", metavar="FILE", callback=new, help="Draw the cycle (PNG, SVG, PDF).")
]
Settling = Annotated[
    str | None,
    typer.Option(
        "--longest", metavar="TIME", help="Simulated time within which the motion must settle. Default: 120 s."
    ),
]


def modes(
    scene: SceneName,
    p: Changes = None,
    along: Along = None,
    controller: Controller = None,
    figure: Picture = None,
    force: Force = False,
    as_json: Json = False,
) -> None:
    """Compute eigenvalues and eigenmodes at steady sliding, open or closed loop, also over a parameter (--sweep)."""
    asked = [] if controller is None else [controller]
    loaded = the_scene(scene, changes(p), {"--controller": added(asked)})
    controller = next(iter(named(asked)), None)
    if along is not None or controller is not None:
        printing.warnings(loaded)
    faults = list[str]()
    found: Modes | Loop | Sweep | None = None
    try:
        if along is not None:
            found = _swept(loaded, along, controller)
        elif controller is not None:
            from rig.analysis.control_loop import loop

            found = loop(loaded, controller)
        else:
            from rig.analysis.modes import modes as solve

            found = solve(loaded)
    except SceneError as error:
        faults += error.faults
    if faults or found is None:
        raise SceneError(loaded.name, faults)
    if as_json:
        printing.report(found.to_json())
    else:
        printing.line(found.text())
    draw(found, figure)
    _refused(loaded, found)


def _refused(scene: Scene, found: Modes | Loop | Sweep) -> None:
    """Report if a run of the scene would be refused because nothing limits its growth."""
    from rig.analysis.modes_report import Modes

    errors = [one for one in found.findings if one.level == "error"] if isinstance(found, Modes) else []
    if not errors or scene.clock.unstable == "run":
        return
    more = f" (and {len(errors) - 1} more)" if len(errors) > 1 else ""
    printing.note(f"{scene.name}: a run is refused{more}: {errors[0].what}\n  {errors[0].remedy}\n"
              '  clock.unstable = "run" runs it nevertheless, up to clock.limit')  # fmt: skip
    raise typer.Exit(ExitCode.STOPPED)


def _swept(scene: Scene, along: str, controller: str | None) -> Sweep:
    from rig.analysis.axis import axes
    from rig.analysis.control_loop import loop, sweep_loop
    from rig.analysis.modes import dithers
    from rig.analysis.sweep import sweep

    faults: list[str] = []
    if controller is not None:
        try:
            loop(scene, controller)
        except SceneError as error:
            faults += error.faults
    try:
        [axis] = axes(scene, {"--sweep": along}, controller or "")
    except SceneError as error:
        faults += error.faults
    if faults:
        raise SceneError(scene.name, faults)
    averaged = controller is None and dithers(scene, axis.key)
    if (why := axis.idle(scene)) and not averaged:
        printing.note(f"warning: {why}")
    return sweep(scene, axis) if controller is None else sweep_loop(scene, axis, controller)


def cycle(
    scene: SceneName,
    p: Changes = None,
    longest: Settling = None,
    figure: Drawing = None,
    force: Force = False,
    as_json: Json = False,
) -> None:
    """Find the limit cycle: period, time in stick, extremes, energy per period, Floquet multipliers.

    The plant runs alone: actuators are held, no controller acts, no sensor
    measures.

    Exit code 1: undecided within the longest time.
    """
    from rig.analysis.cycle import limit_cycle

    most, loaded = seconds(longest, "--longest"), the_scene(scene, changes(p))
    printing.warnings(loaded)
    status = printing.Status()
    try:
        found = limit_cycle(
            loaded,
            longest=most,
            watch=lambda now, drift: status.show(
                f"{now:.3g} s simulated, successive periods agree to {drift:.0e} of a period"
            ),
        )
    finally:
        status.done()
    if as_json:
        printing.report(found.to_json())
    else:
        printing.line(found.text())
        if loaded.controllers or loaded.sensors:
            printing.line(f"  plant alone: without {_left_out(loaded)}")
    draw(found, figure)
    if not found.decided:
        raise typer.Exit(ExitCode.FAILED)


def _left_out(scene: Scene) -> str:
    """The controllers and sensors of a scene, in words."""
    parts = ("controller", scene.controllers), ("sensor", scene.sensors)
    return " and ".join(f"{what}{'s' * (len(names) > 1)} {', '.join(names)}" for what, names in parts if names)


def identify(
    scene: SceneName, p: Changes = None, figure: Drawn = None, force: Force = False, as_json: Json = False
) -> None:
    """Identify parameters of the lever rig: run an experiment and evaluate its measurements.

    Scenes with an experiment: lever_free_cylinder, lever_free_lever,
    lever_static_friction, lever_kinetic_friction.
    """
    from rig.analysis.identify import identify as run

    found = run(the_scene(scene, changes(p)))
    if as_json:
        printing.report(found.to_json() | {"figure": figure})
    else:
        printing.line(found.text())
    draw(found, figure)


COMMANDS = {
    "modes": (modes, 'rig modes belt --sweep "drive.speed=0.05 m/s:0.4 m/s:50" --figure locus.png'),
    "cycle": (cycle, 'rig cycle two_dof -p friction.mu=0.45 --longest "10 min"'),
    "identify": (identify, "rig identify lever_kinetic_friction --figure friction.png"),
}
