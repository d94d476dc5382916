"""Commands that analyse what a recording holds."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from csv import writer as writes
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, TypeVar

import typer

from rig.cli import printing
from rig.cli.logs import Log, opened
from rig.cli.options import Force, Json, Trust, seconds
from rig.cli.outputs import new
from rig.errors import LogError, UsageError

if TYPE_CHECKING:
    from rig.record.run import Run

Signal = Annotated[
    str,
    typer.Option(metavar="NAME", help="Sensor or plant output to analyse. Default: a sensor that measures vibration."),
]
Over = Annotated[
    str,
    typer.Option(
        "--over", metavar="NAME", help="Sensor or plant output that rises and falls. Default: the speed of the drive."
    ),
]
Window = Annotated[
    str | None,
    typer.Option("--window", metavar="TIME", help="Length of the centred window. Default: about five periods."),
]
Windows = Annotated[
    str | None,
    typer.Option(
        "--window",
        metavar="TIME",
        help="Length of the windows. Default: 1/8 of the time span; for the spectrogram 1/80.",
    ),
]
Turn = Annotated[
    str,
    typer.Option(
        "--orders", metavar="NAME", help='Compute orders over this speed, angle or travel; "drive": speed of the drive.'
    ),
]
First = Annotated[str | None, typer.Option("--from", metavar="TIME", help="Start of the evaluated time span.")]
Last = Annotated[str | None, typer.Option("--to", metavar="TIME", help="End of the evaluated time span.")]
Picture = Annotated[
    Path | None, typer.Option("--figure", metavar="FILE", callback=new, help="Draw the result (PNG, SVG, PDF).")
]
Times = Annotated[
    str,
    typer.Option(
        "--at",
        metavar="TIMES",
        help='Instants, separated by commas: "0.5, 0.56 s, 600 ms". Default: chosen from the run.',
    ),
]
Table = Annotated[Path | None, typer.Option("--csv", metavar="FILE", callback=new, help="Write all numbers as CSV.")]
T = TypeVar("T")


class _Faults:
    """Collects what is wrong with the options of a command, so that all of it is told at once."""

    def __init__(self) -> None:
        self.found: list[str] = []

    def __call__(self, read: Callable[[], T], otherwise: T) -> T:
        try:
            return read()
        except UsageError as error:
            self.found.append(str(error))
            return otherwise

    def tell(self) -> None:
        if self.found:
            raise UsageError("\n".join(self.found))


def hysteresis(
    log: Log,
    signal: Signal = "",
    over: Over = "",
    window: Window = None,
    first: First = None,
    last: Last = None,
    figure: Picture = None,
    csv: Table = None,
    trust: Trust = False,
    force: Force = False,
    as_json: Json = False,
) -> None:
    """Compute the RMS of a vibration over rising and falling drive speed, and the speeds at which the contact stuck."""
    from rig.analysis.recorded import hysteresis as find
    from rig.analysis.recorded.figure import draw_hysteresis as draw

    faults = _Faults()
    run, length, begin, end = asked(faults, log, window, first, last, trust)
    found = faults(lambda: find(run, signal, over, length, begin, end), None)
    faults.tell()
    assert found is not None
    _print(found.to_json(), found.text(), figure, csv, as_json)
    if csv is not None:
        csv.write_text(found.csv())
    if figure is not None:
        draw(found, figure)


def spectrum(
    log: Log,
    signal: Signal = "",
    window: Windows = None,
    over: Turn = "",
    first: First = None,
    last: Last = None,
    figure: Picture = None,
    csv: Table = None,
    trust: Trust = False,
    force: Force = False,
    as_json: Json = False,
) -> None:
    """Compute power spectral density and spectrogram of a measurement or output; with --orders, its orders too."""
    from rig.analysis.recorded import orders
    from rig.analysis.recorded import spectrum as find
    from rig.analysis.recorded.figure import draw_spectrum as draw

    faults = _Faults()
    run, length, begin, end = asked(faults, log, window, first, last, trust)
    found = faults(lambda: find(run, signal, length, begin, end), None)
    turned = None
    if over:  # a signal that is not there has been told
        turned = faults(lambda: orders(run, signal if found else "", over, begin, end), None)
    faults.tell()
    assert found is not None
    values = found.to_json() | {"orders": turned.to_json() if turned else None}
    _print(values, found.text() + (f"\n\n{turned.text()}" if turned else ""), figure, csv, as_json)
    if csv is not None:
        rows = (*found.csv(), *(turned.csv() if turned else ()))
        _write(csv, ["axis", "at", "unit", "density", "unit of density"], rows)
    if figure is not None:
        draw(found, turned, figure)


def pressure(
    log: Log,
    at: Times = "",
    figure: Picture = None,
    csv: Table = None,
    trust: Trust = False,
    force: Force = False,
    as_json: Json = False,
) -> None:
    """Draw maps of the contact pressure under a slider at chosen instants."""
    from rig.analysis.recorded import pressure as find
    from rig.analysis.recorded.figure import draw_pressure as draw

    faults = _Faults()
    times = [faults(partial(seconds, one, "--at", 0.0), None) for one in at.split(",") if one.strip()]
    faults.tell()
    run = opened(log, trust)
    if not run.time.size:
        raise LogError(f"{log}: the recording ends before its first sample")
    found = find(run, [one for one in times if one is not None])
    _print(found.to_json(), found.text(), figure, csv, as_json)
    if csv is not None:
        _write(csv, ["time [s]", "x [m]", "y [m]", "pressure [Pa]"], found.csv())
    if figure is not None:
        draw(found, figure)


def _print(values: dict[str, Any], text: str, figure: Path | None, csv: Path | None, as_json: bool) -> None:
    """Print the result of an analysis: as JSON with the files written, or as text."""
    if as_json:
        printing.report(values | {"figure": figure, "csv": csv})
    else:
        printing.line(text)


def _write(csv: Path, head: list[str], rows: Iterable[Iterable[str | float]]) -> None:
    """Write a table as CSV, numbers with nine digits."""
    with csv.open("w", newline="") as file:
        writer = writes(file, lineterminator="\n")
        writer.writerow(head)
        writer.writerows([one if isinstance(one, str) else f"{one:.9g}" for one in row] for row in rows)


def asked(
    faults: _Faults, log: Path, window: str | None, first: str | None, last: str | None, trust: bool
) -> tuple[Run, float | None, float, float]:
    """A recording that has something to analyse, the window [s], the stretch of time [s]."""
    length = faults(lambda: seconds(window, "--window"), None)
    begin, end = span(faults, first, last)
    run = opened(log, trust)
    if not run.time.size:
        raise LogError(f"{log}: the recording ends before its first sample")
    return run, length, begin, end


def span(faults: _Faults, first: str | None, last: str | None) -> tuple[float, float]:
    """The stretch of time that --from and --to name [s]."""
    begin = faults(lambda: seconds(first, "--from", low=0.0), None) or 0.0
    end = faults(lambda: seconds(last, "--to"), None)
    if end is not None and begin >= end:
        faults.found.append(f"--from {begin:g} s to {end:g} s: the time span is empty; --to must be later")
        return 0.0, float("inf")
    return begin, float("inf") if end is None else end


COMMANDS = {
    "spectrum": (spectrum, "rig spectrum recordings/golden/pendulum.mcap --orders drive --figure spectrum.png"),
    "pressure": (pressure, "rig pressure plate.mcap --at '0.5 s, 0.56 s, 0.6 s' --figure pressure.png"),
    "hysteresis": (hysteresis, "rig hysteresis recordings/runs/belt_hysteresis-20260101-120000.mcap --window '1 s'"),
}
