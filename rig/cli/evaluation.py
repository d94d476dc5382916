"""What the commands that analyse a recording share: options, faults reported at once, a result printed and written."""

from __future__ import annotations

import io
from collections.abc import Callable, Iterable
from csv import writer as writes
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, TypeVar

import typer

from rig.cli import printing
from rig.cli.logs import opened, without_outputs
from rig.cli.options import seconds
from rig.cli.outputs import new
from rig.errors import LogError, UsageError

if TYPE_CHECKING:
    from rig.record.run import Run

First = Annotated[str | None, typer.Option("--from", metavar="TIME", help="Start of the evaluated time span.")]
Last = Annotated[str | None, typer.Option("--to", metavar="TIME", help="End of the evaluated time span.")]
Picture = Annotated[
    Path | None, typer.Option("--figure", metavar="FILE", callback=new, help="Draw the result (PNG, SVG, PDF).")
]
Table = Annotated[Path | None, typer.Option("--csv", metavar="FILE", callback=new, help="Write all numbers as CSV.")]
T = TypeVar("T")


class Faults:
    """Collects what is wrong with the options of a command, so that all of it is reported at once."""

    def __init__(self) -> None:
        self.found: list[str] = []

    def __call__(self, read: Callable[[], T], otherwise: T) -> T:
        """Return what `read` returns; `otherwise` if it raises UsageError, which is kept."""
        try:
            return read()
        except UsageError as error:
            self.found.append(str(error))
            return otherwise

    def raise_found(self) -> None:
        """Raise UsageError if something is wrong."""
        if self.found:
            raise UsageError("\n".join(self.found))


def show(values: dict[str, Any], text: str, figure: Path | None, csv: Path | None, as_json: bool) -> None:
    """Print the result of an analysis: as JSON with the files written, or as text."""
    if as_json:
        printing.report(values | {"figure": figure, "csv": csv})
    else:
        printing.line(text)


def write(csv: Path, head: list[str], rows: Iterable[Iterable[str | float]]) -> None:
    """Write a table as CSV, numbers with nine digits. Raises OutputError."""
    from rig.user_files import write_file

    text = io.StringIO()
    writer = writes(text, lineterminator="\n")
    writer.writerow(head)
    writer.writerows([one if isinstance(one, str) else f"{one:.9g}" for one in row] for row in rows)
    write_file(csv, text.getvalue().encode())


def opened_span(
    faults: Faults, log: Path, window: str | None, first: str | None, last: str | None, trust: bool
) -> tuple[Run, float | None, float, float]:
    """A recording that has something to analyse, the window [s], the stretch of time [s]."""
    length = faults(lambda: seconds(window, "--window"), None)
    begin, end = span(faults, first, last)
    run = opened(log, trust)
    if nothing := without_outputs(run, log):
        raise LogError(nothing)
    return run, length, begin, end


def span(faults: Faults, first: str | None, last: str | None) -> tuple[float, float]:
    """The stretch of time that --from and --to name [s]."""
    begin = faults(lambda: seconds(first, "--from", low=0.0), None) or 0.0
    end = faults(lambda: seconds(last, "--to"), None)
    if end is not None and begin >= end:
        faults.found.append(f"--from {begin:g} s to {end:g} s: the time span is empty; --to must be later")
        return 0.0, float("inf")
    return begin, float("inf") if end is None else end
