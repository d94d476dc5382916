"""Commands about this machine."""

from __future__ import annotations

import time
from typing import Annotated

import typer

from rig.cli import tell
from rig.cli.options import Json


def doctor(
    scene: Annotated[list[str] | None, typer.Argument(metavar="[SCENE]...", help="Scenes; all by default.")] = None,
    as_json: Json = False,
) -> None:
    """Measure pacing and kernels on this machine and say which scenes would run VALID."""
    from rig.study.doctor import doctor as examine

    found = examine(report=tell.note, names=scene or ())
    if as_json:
        tell.report(found.to_json())
    else:
        tell.line(found.text())
    if not found.ok:
        raise typer.Exit(1)


def warmup(
    scene: Annotated[list[str] | None, typer.Argument(metavar="[SCENE]...", help="Scenes; all by default.")] = None,
) -> None:
    """Compile the kernels of the shipped scenes, so that the first run starts at once."""
    from rig.scheduling import cores
    from rig.study.warmup import warmup as compile_all

    begin = time.perf_counter()
    spent = compile_all(tell.note, scene or None, cores())
    tell.line(f"ready; {sum(spent.values()):.0f} s of compiling in {time.perf_counter() - begin:.0f} s")


COMMANDS = {"doctor": (doctor, "rig doctor"), "warmup": (warmup, "rig warmup pendulum")}
