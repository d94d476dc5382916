"""Commands about this machine."""

from __future__ import annotations

import time
from pathlib import Path
from typing import Annotated

import typer

from rig.cli import printing
from rig.cli.options import Force, Json
from rig.cli.outputs import new
from rig.errors import ExitCode


def doctor(
    scene: Annotated[
        list[str] | None, typer.Argument(metavar="SCENE...", help="Names of scenes. Default: all shipped scenes.")
    ] = None,
    bundle: Annotated[
        Path | None,
        typer.Option(
            metavar="FILE",
            callback=new,
            help="Write a zip file for a bug report: versions, this report, messages of the last run.",
        ),
    ] = None,
    force: Force = False,
    as_json: Json = False,
) -> None:
    """Measure this machine and predict which scenes run in real time with the timing verdict VALID."""
    from rig.qualify.doctor import doctor as examine

    found = examine(report=printing.note, names=scene or ())
    if as_json:
        printing.report(found.to_json())
    else:
        printing.line(found.text())
    if bundle is not None:
        from rig.qualify.bug_report import bundle as packed
        from rig.user_files import write_file

        content, names = packed(found)
        write_file(bundle, content)
        printing.note(f"{bundle}: {', '.join(names)}; look into it before you send it")
    if not found.ok:
        raise typer.Exit(ExitCode.FAILED)


def warmup(
    scene: Annotated[
        list[str] | None, typer.Argument(metavar="SCENE...", help="Names of scenes. Default: all shipped scenes.")
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


def clean() -> None:
    """Delete what friction-rig has stored for this user: compiled kernels, models of plates, messages of the last run.

    The next start compiles again. Recordings and scenes are not touched.
    Folders that RIG_KERNELS and RIG_MODELS name are yours, and stay.
    """
    import shutil

    import platformdirs

    folders = {platformdirs.user_cache_path("friction-rig"), platformdirs.user_state_path("friction-rig")}
    there = sorted(folder for folder in folders if folder.is_dir())
    for folder in there:
        size = sum(path.lstat().st_size for path in folder.rglob("*") if not path.is_dir())
        shutil.rmtree(folder)
        printing.line(f"deleted {folder}: {size / 1e6:.1f} MB")
    if not there:
        printing.line("nothing is stored")


COMMANDS = {
    "clean": (clean, "rig clean"),
    "doctor": (doctor, "rig doctor --bundle report.zip"),
    "warmup": (warmup, "rig warmup pendulum"),
}
