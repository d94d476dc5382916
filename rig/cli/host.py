"""Commands about this machine."""

from __future__ import annotations

import time
from typing import Annotated

import typer

from rig.cli import tell
from rig.cli.options import Json

WARM_S = 0.5  # simulated: every kernel of the scene has been called by then


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
    import rig
    from rig.scenes import names

    for name in scene or names():
        begin = time.perf_counter()
        rig.simulate(name, WARM_S)
        tell.line(f"{name}: ready after {time.perf_counter() - begin:.1f} s")


COMMANDS = {"doctor": (doctor, "rig doctor"), "warmup": (warmup, "rig warmup pendulum")}
