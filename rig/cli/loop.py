"""The command that reports on a control loop: its delays, its margins, and its decay over poor links."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from rig.cli import printing
from rig.cli.options import Changes, Force, Json, Net, SceneName, added, changes, linked, loop_option, named, the_scene
from rig.cli.outputs import draw, new
from rig.errors import UsageError

Controller = Annotated[str | None, loop_option("Controller of the loop. Default: the only one of the scene.")]
Measure = Annotated[
    bool, typer.Option("--measure", help="Measure the time over the bus on this machine, as rig doctor does (1 s).")
]
Picture = Annotated[
    Path | None, typer.Option("--figure", metavar="FILE", callback=new, help="Draw the report (PNG, SVG, PDF).")
]


def loop(
    scene: SceneName,
    p: Changes = None,
    net: Net = None,
    controller: Controller = None,
    measure: Measure = False,
    figure: Picture = None,
    force: Force = False,
    as_json: Json = False,
) -> None:
    """Report on a control loop: delay budget, margins, and decay rate over delay, jitter and loss of its link.

    The loop is linearised about steady sliding. One point is checked by
    simulations: that of the scene's own links, or one that is chosen.
    """
    from rig.analysis.loop_report import report

    given = changes(p)
    asked = [] if controller is None else [controller]
    loaded = the_scene(scene, given, {"--controller": added(asked), "--net": linked(net, given)})
    name = next(iter([*named(asked), *loaded.controllers]), "")
    if controller is None and len(loaded.controllers) != 1:
        known = ", ".join(loaded.controllers) or "none"
        raise UsageError(f"{loaded.name}: name the controller of the loop with --controller; there are: {known}")
    printing.warnings(loaded)
    bus = None
    if measure:
        from rig.qualify.round_trip import round_trips

        trips, _, fault = round_trips(1.0)
        if fault or not len(trips):
            printing.note(f"the bus was not measured: {fault or 'no answer arrived'}")
        else:
            import numpy as np

            bus = float(np.quantile(trips, 0.99)) * 1e-9
    with printing.bar("points") as progress:
        found = report(loaded, name, bus, progress)
    if as_json:
        printing.report(found.to_json())
    else:
        printing.line(found.text())
    draw(found, figure)


COMMANDS = {"loop": (loop, "rig loop belt_normal_force --figure loop.png")}
