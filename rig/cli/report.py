"""The command that writes a recording as a page to read."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from rig.cli import printing
from rig.cli.logs import Log, opened
from rig.cli.options import Force, Json, Trust
from rig.cli.outputs import hold, named
from rig.errors import UsageError


def report(
    context: typer.Context,
    log: Log,
    out: Annotated[
        Path | None, typer.Option(metavar="FILE", help="File to write (HTML). Default: NAME.html beside the recording.")
    ] = None,
    trust: Trust = False,
    force: Force = False,
    as_json: Json = False,
) -> None:
    """Write one page about a recording that any browser opens: figures, timing verdict, measures, provenance.

    The page is one file and loads no other files.
    """
    path = out or log.with_suffix(".html")
    named("--out", path)
    if path.suffix.lower() not in (".html", ".htm"):
        raise UsageError(f"--out {path}: the name of a page ends in .html")
    hold(context, "--out", path)
    run = opened(log, trust)
    from rig.analysis.report import write

    status = printing.Status()
    status.show(f"writing {path}")
    try:
        size = write(run, log, path)
    finally:
        status.done()
    if as_json:
        printing.report({"path": path, "bytes": size, "damage": run.notes})
    else:
        printing.line(str(path))


COMMANDS = {"report": (report, "rig report recordings/golden/pendulum.mcap --out pendulum.html")}
