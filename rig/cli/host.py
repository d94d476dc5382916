"""Commands about this machine."""

from __future__ import annotations

from typing import Annotated

import typer

from rig.cli import tell
from rig.cli.options import Json


def doctor(as_json: Json = False) -> None:
    """Measure pacing and kernel on this machine and say which scenes would run VALID."""
    from rig.bench.doctor import examine

    found = examine(tell.note)
    if as_json:
        tell.report(found.to_json())
    else:
        tell.line(found.text())


def warmup(
    scene: Annotated[list[str] | None, typer.Argument(metavar="[SCENE]...", help="Scenes; all by default.")] = None,
) -> None:
    """Compile the kernels of the shipped scenes, so that the first run starts at once."""
    from rig.bench.simulate import warm
    from rig.scenes import load, names

    for name in scene or names():
        tell.note(f"{name}: {warm(load(name)):.1f} s")


COMMANDS = {"doctor": (doctor, "rig doctor"), "warmup": (warmup, "rig warmup pendulum")}
