"""The command `rig reproduce`: figures of papers made again, with their numbers compared."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from rig.cli import printing
from rig.cli.options import Force, Json
from rig.cli.outputs import refuse
from rig.errors import ExitCode
from rig.user_files import write_file


def reproduce(
    figure: Annotated[str, typer.Argument(metavar="FIGURE", help='Name of a figure, of a paper, or "all".')] = "",
    out: Annotated[Path, typer.Option(metavar="FOLDER", help="Folder for the pictures and their page.")] = Path(
        "gallery"
    ),
    force: Force = False,
    as_json: Json = False,
) -> None:
    """Make a figure of a paper again from a scene, and compare its numbers with published or reference values.

    Without FIGURE: list the figures. Exit code 1: a number does not agree that should.
    Other figures in the folder are kept.
    """
    from rig import papers as again
    from rig.record.provenance import provenance

    if not figure:
        entries = again.pick("all")
        if as_json:
            printing.report([{"name": e.name, "title": e.title, "scenes": list(e.scenes)} for e in entries])
        else:
            rows = [(e.name, e.number, e.title, ", ".join(e.scenes)) for e in entries]
            printing.table("", ("figure", "in the paper", "what it shows", "scenes"), rows)
        return
    wanted = again.pick(figure)
    page = [] if (out / "numbers.json").exists() else ["README.md"]  # else it is the page of figures made before
    refuse(out, [*(f"{entry.name}{suffix}" for entry in wanted for suffix in (".png", ".svg")), *page], force)
    with printing.bar("figures") as progress:
        results = again.make_all(wanted, out, progress)
    machine = provenance(0, ())
    host = f"{machine['processor']}, {machine['cores']} cores, Python {machine['python']}, numba {machine['numba']}"
    write_file(out / "README.md", again.page(again.keep(results, out), host).encode())
    if as_json:
        printing.report([result.to_json() for result in results])
    else:
        for result in results:
            numbers = [
                (c.what, f"{c.ours:.7g}", f"{c.expected:.7g}" if c.compared else "", c.unit, c.source, c.bound,
                 "" if c.agrees else c.result)
                for c in result.comparisons
            ]  # fmt: skip
            columns = ("number", "ours", "expected", "", "source", "bound", "")
            printing.table(f"{result.entry.name}: {result.entry.title} ({result.picture})", columns, numbers)
    if not all(result.agrees for result in results):
        raise typer.Exit(ExitCode.FAILED)


COMMANDS = {"reproduce": (reproduce, "rig reproduce kroeger-3")}
