"""Commands that learn something from a rig without running its protocol."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from rig.cli import tell
from rig.cli.options import Changes, Json, SceneName, changes
from rig.errors import UsageError

Along = Annotated[
    str | None,
    typer.Option(
        "--sweep",
        metavar="KEY=A:B:N",
        help='Follow the eigenvalues over a parameter and find the critical values: "drive.speed=0.05 m/s:0.4 m/s:50".',
    ),
]
Picture = Annotated[Path | None, typer.Option("--figure", metavar="FILE", help="Draw the sweep (PNG).")]


def modes(
    scene: SceneName, p: Changes = None, along: Along = None, figure: Picture = None, as_json: Json = False
) -> None:
    """Eigenvalues at the sliding equilibrium: growth rate, frequency, damping ratio; along a parameter with --sweep."""
    from rig.scenes import load
    from rig.study.axis import axes
    from rig.study.modes import modes as solve

    if figure is not None and along is None:
        raise UsageError("--figure: draws a sweep; say over what, e.g. --sweep drive.speed=0.05:0.4:50")
    loaded = load(scene, changes(p))
    if along is None:
        single = solve(loaded)
        if as_json:
            tell.report(single.to_json())
        else:
            tell.line(single.text())
        return
    from rig.study.sweep import sweep

    [axis] = axes(loaded, {"--sweep": along})
    found = sweep(loaded, axis)
    if figure is not None:
        from rig.study.locus import draw

        draw(found, figure)
    if as_json:
        tell.report(found.to_json())
    else:
        tell.line(found.text())


def cycle(scene: SceneName, p: Changes = None, as_json: Json = False) -> None:
    """The limit cycle: period, time in stick, extremes of displacement and velocity."""
    from rig.scenes import load
    from rig.study.cycle import limit_cycle

    found = limit_cycle(load(scene, changes(p)))
    if as_json:
        tell.report(found.to_json())
        return
    tell.line(found.text())


COMMANDS = {
    "modes": (modes, 'rig modes belt --sweep "drive.speed=0.05 m/s:0.4 m/s:50" --figure locus.png'),
    "cycle": (cycle, "rig cycle belt_b --json"),
}
