"""Commands about this machine."""

from __future__ import annotations

import time
from typing import Annotated

import typer

from rig.cli import printing
from rig.cli.options import Json


def doctor(
    scene: Annotated[
        list[str] | None, typer.Argument(metavar="[SCENE]...", help="Names of scenes. Default: all shipped scenes.")
    ] = None,
    as_json: Json = False,
) -> None:
    """Measure this machine and predict which scenes run in real time with the timing verdict VALID."""
    from rig.qualify.doctor import doctor as examine

    found = examine(report=printing.note, names=scene or ())
    if as_json:
        printing.report(found.to_json())
    else:
        printing.line(found.text())
    if not found.ok:
        raise typer.Exit(1)


def warmup(
    scene: Annotated[
        list[str] | None, typer.Argument(metavar="[SCENE]...", help="Names of scenes. Default: all shipped scenes.")
    ] = None,
) -> None:
    """Compile the kernels of the shipped scenes, so that their first run starts without delay."""
    from rig.qualify.warmup import warmup as compile_all
    from rig.scheduling import cores

    begin = time.perf_counter()
    spent = compile_all(printing.note, scene or None, cores())
    printing.line(
        f"ready: {sum(spent.values()):.0f} s of compiling in {time.perf_counter() - begin:.0f} s of wall time"
    )


COMMANDS = {"doctor": (doctor, "rig doctor"), "warmup": (warmup, "rig warmup pendulum")}
