"""The command `rig torture`: hard cases."""

from __future__ import annotations

import contextlib
from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from rig.cli import printing
from rig.cli.options import Force, Json, at
from rig.cli.outputs import refuse
from rig.errors import ExitCode, UsageError

if TYPE_CHECKING:
    from rig.qualify.torture import Cell

CaseName = Annotated[
    list[str] | None,
    typer.Option(
        "--case",
        metavar="ID",
        help="Run only this case (a name as in the table that is printed), or the case in this file. Repeatable.",
    ),
]
Folder = Annotated[Path, typer.Option(metavar="FOLDER", help="Folder for the figure, JSON and JUnit files.")]


def torture(
    quick: Annotated[bool, typer.Option("--quick", help="Short runs, about a minute. The default.")] = False,
    full: Annotated[bool, typer.Option("--full", help="Every step and every case, over the whole duration.")] = False,
    case: CaseName = None,
    search: Annotated[
        bool,
        typer.Option("--search", help="Search random values within the bounds of each case; keep values that fail."),
    ] = False,
    out: Folder = Path("torture"),
    force: Force = False,
    as_json: Json = False,
) -> None:
    """Run hard cases by methods by steps. Each cell is green, amber or red with one reason.

    Exit code 1: a default method is not green. The other methods are for
    comparison, and some of them fail.
    """
    if quick and full:
        raise UsageError("--quick or --full, not both")
    at(out)
    from rig.qualify import torture as hard_cases
    from rig.qualify.torture import report
    from rig.qualify.torture.case import load, names

    wanted = case or [name for name in names() if full or load(name).quick]
    if search:
        _search(wanted, as_json)
        return
    refuse(out, ("matrix.png", "matrix.svg", "matrix.json", "junit.xml"), force)
    status = printing.Status()
    with contextlib.ExitStack() as stack:
        shown: list[Callable[[int, int], object]] = []

        def progress(done: int, total: int) -> None:
            if not shown:  # the kernels are compiled
                status.done()
                shown.append(stack.enter_context(printing.bar("cases")))
            shown[0](done, total)

        cells = hard_cases.matrix(wanted, not full, status.show, progress)
    report.keep(cells, out, not full)
    if as_json:
        printing.report([cell.to_json() for cell in cells])
    else:
        _table(cells)
        printing.line(f"\n{out}/matrix.png, matrix.svg, matrix.json, junit.xml")
    if not all(cell.good for cell in cells):
        raise typer.Exit(ExitCode.FAILED)


def _table(cells: list[Cell]) -> None:
    """A row for each case and method, its steps side by side; then what decided where it is not green."""
    rows = []
    for cell in cells:
        v = cell.result
        name = f"{cell.method} (default)" if cell.default else cell.method
        rows.append((cell.case, name, f"{cell.step:g} s", v.colour, v.reason, v.detail, f"{cell.seconds:.2f} s"))
    printing.table("", ("case", "method", "step", "result", "reason", "detail", "time"), rows)
    counts = {colour: sum(cell.result.colour == colour for cell in cells) for colour in ("green", "amber", "red")}
    bad = sum(not cell.good for cell in cells)
    counted = ", ".join(f"{count} {colour}" for colour, count in counts.items())
    printing.line(f"{len(cells)} cells: {counted}; default methods that are not green: {bad or 'none'}")


def _search(wanted: list[str], as_json: bool) -> None:
    from rig.qualify.torture.case import load
    from rig.qualify.torture.search import search

    found = {}
    for name in wanted:
        case = load(name)
        if not case.box:
            continue
        hit = search(case)
        found[name] = None if hit is None else {"file": str(hit[0]), **hit[1].to_json()}
        if not as_json:
            what = "no failure found" if hit is None else f"{hit[1].result.detail}; kept as {hit[0]}"
            printing.line(f"{name}: {what}")
    if as_json:
        printing.report(found)
    if any(found.values()):
        raise typer.Exit(ExitCode.FAILED)


COMMANDS = {"torture": (torture, "rig torture --case grazing")}
