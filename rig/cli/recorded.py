"""Commands that analyse what a recording holds.

What the commands that analyse a recording share: options, faults reported at once, a result printed and written.

Commands that relate channels of a recording to each other.

The command that compares two recordings.
"""

from __future__ import annotations

import io
from collections.abc import Iterable
from csv import writer as writes
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from rig.cli import printing
from rig.cli.options import Force, Json, Trust, seconds
from rig.cli.printing import draw, new
from rig.cli.recordings import Log, opened, recording, without_outputs
from rig.errors import ExitCode, Faults, LogError

if TYPE_CHECKING:
    from rig.record.run import Run


First = Annotated[str | None, typer.Option("--from", metavar="TIME", help="Start of the evaluated time span.")]
Last = Annotated[str | None, typer.Option("--to", metavar="TIME", help="End of the evaluated time span.")]
Picture = Annotated[
    Path | None, typer.Option("--figure", metavar="FILE", callback=new, help="Draw the result (PNG, SVG, PDF).")
]
Table = Annotated[Path | None, typer.Option("--csv", metavar="FILE", callback=new, help="Write all numbers as CSV.")]


def show(values: dict[str, Any], text: str, figure: Path | None, csv: Path | None, as_json: bool) -> None:
    """Print the result of an analysis: as JSON with the files written, or as text."""
    if as_json:
        printing.report(values | {"figure": figure, "csv": csv})
    else:
        printing.line(text)


def write(csv: Path, head: list[str], rows: Iterable[Iterable[str | float]]) -> None:
    """Write a table as CSV, numbers with nine digits. Raises OutputError."""
    from rig.machine.files import write_file

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
Times = Annotated[
    str,
    typer.Option(
        "--at",
        metavar="TIMES",
        help='Instants, separated by commas: "0.5, 0.56 s, 600 ms". Default: chosen from the run.',
    ),
]


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
    from rig.machine.files import write_file

    faults = Faults()
    run, length, begin, end = opened_span(faults, log, window, first, last, trust)
    found = faults(lambda: find(run, signal, over, length, begin, end), None)
    faults.raise_found()
    assert found is not None
    show(found.to_json(), found.text(), figure, csv, as_json)
    if csv is not None:
        write_file(csv, found.csv().encode())
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

    faults = Faults()
    run, length, begin, end = opened_span(faults, log, window, first, last, trust)
    found = faults(lambda: find(run, signal, length, begin, end), None)
    turned = None
    if over:  # an unknown signal was reported before
        turned = faults(lambda: orders(run, signal if found else "", over, begin, end), None)
    faults.raise_found()
    assert found is not None
    values = found.to_json() | {"orders": turned.to_json() if turned else None}
    show(values, found.text() + (f"\n\n{turned.text()}" if turned else ""), figure, csv, as_json)
    if csv is not None:
        rows = (*found.csv(), *(turned.csv() if turned else ()))
        write(csv, ["axis", "at", "unit", "density", "unit of density"], rows)
    if figure is not None:
        from rig.analysis.recorded.figures import spectrum_figure
        from rig.view.palette import put

        put(spectrum_figure(found, turned), figure)


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

    faults = Faults()
    times = [faults(partial(seconds, one, "--at", 0.0), None) for one in at.split(",") if one.strip()]
    faults.raise_found()
    run = opened(log, trust)
    if nothing := without_outputs(run, log):
        raise LogError(nothing)
    found = find(run, [one for one in times if one is not None])
    show(found.to_json(), found.text(), figure, csv, as_json)
    if csv is not None:
        write(csv, ["time [s]", "x [m]", "y [m]", "pressure [Pa]"], found.csv())
    draw(found, figure)


Source = Annotated[
    str,
    typer.Option("--input", metavar="NAME", help="Channel that excites: a sensor, a plant output, or an actuator."),
]
Answer = Annotated[str, typer.Option("--output", metavar="NAME", help="Channel that responds.")]
AveragedWindows = Annotated[
    str | None,
    typer.Option(
        "--window",
        metavar="TIME",
        help="Length of the windows. Default: 1/16 of the time span; for pulses, until the next one.",
    ),
]
Across = Annotated[str, typer.Option("--x", metavar="NAME", help="Horizontal axis. Default: displacement.")]
Up = Annotated[str, typer.Option("--y", metavar="NAME", help="Vertical axis. Default: velocity.")]
Cut = Annotated[
    str,
    typer.Option(
        "--section",
        metavar="NAME=VALUE",
        help='Poincare section: points where a channel crosses a value upwards: "velocity = 10 mm/s".',
    ),
]


def response(
    log: Log,
    source: Source,
    answer: Answer,
    window: AveragedWindows = None,
    first: First = None,
    last: Last = None,
    figure: Picture = None,
    csv: Table = None,
    trust: Trust = False,
    force: Force = False,
    as_json: Json = False,
) -> None:
    """Estimate the frequency response and coherence between two channels; natural frequencies and damping ratios."""
    from rig.analysis.recorded import response as find

    faults = Faults()
    run, length, begin, end = opened_span(faults, log, window, first, last, trust)
    found = faults(lambda: find(run, source, answer, length, begin, end), None)
    faults.raise_found()
    assert found is not None
    show(found.to_json(), found.text(), figure, csv, as_json)
    if csv is not None:
        head = ["frequency [Hz]", f"magnitude [{found.unit}]", "phase [degree]", "coherence", "random error"]
        write(csv, head, found.csv())
    draw(found, figure)


def portrait(
    log: Log,
    x: Across = "",
    y: Up = "",
    section: Cut = "",
    first: First = None,
    last: Last = None,
    figure: Picture = None,
    csv: Table = None,
    trust: Trust = False,
    force: Force = False,
    as_json: Json = False,
) -> None:
    """Draw a phase portrait; with --section, find the Poincare section and the period of the motion."""
    from rig.analysis.recorded import portrait as find

    faults = Faults()
    run, _, begin, end = opened_span(faults, log, None, first, last, trust)
    cut = faults(lambda: _cut(run, section), None)
    found = faults(lambda: find(run, x, y, cut, begin, end), None)
    faults.raise_found()
    assert found is not None
    show(found.to_json(), found.text(), figure, csv, as_json)
    if csv is not None:
        head = ["time [s]", f"{found.x_name} [{found.x_unit}]", f"{found.y_name} [{found.y_unit}]"]
        write(csv, head, found.csv())
    draw(found, figure)


def _cut(run: Run, given: str) -> tuple[str, float] | None:
    """The channel and the value [in its unit] of a section."""
    from rig.analysis.recorded import series
    from rig.quantities import Condition

    if not given:
        return None
    cut = Condition.read(given, "--section", "=", 'NAME = VALUE, such as "velocity = 10 mm/s"')
    return cut.name, cut.level_in(series(run, cut.name).unit)


Tolerance = Annotated[
    float,
    typer.Option(
        "--tolerance", metavar="REL", help="Allowed deviation, as a share of the range of each channel: 1e-6."
    ),
]


def diff(
    first: Annotated[Path, typer.Argument(metavar="A", help="A recording.", callback=recording)],
    second: Annotated[Path, typer.Argument(metavar="B", help="Another one.", callback=recording)],
    tolerance: Tolerance = 0.0,
    begin: First = None,
    end: Last = None,
    figure: Picture = None,
    trust: Trust = False,
    force: Force = False,
    as_json: Json = False,
) -> None:
    """Compare two recordings: scenes, channels, and measures such as period, amplitude and growth rate.

    Channels are compared at the instants that both recordings contain: equal bit
    by bit, within the tolerance, or different from an instant on. Exit code 0:
    equal or within the tolerance, 1: different. One recording may have
    additional samples between those of the other.
    """
    from rig.analysis.recorded.comparison import compare

    faults = Faults()
    low, high = span(faults, begin, end)
    faults.raise_found()
    runs = opened(first, trust), opened(second, trust)
    found = compare(*runs, low, high, tolerance)
    if as_json:
        printing.report(found.to_json() | {"figure": figure})
    else:
        printing.line(found.text())
    draw(found, figure)
    if not found.agree:
        raise typer.Exit(ExitCode.FAILED)


COMMANDS = {
    "spectrum": (spectrum, "rig spectrum recordings/golden/pendulum.mcap --orders drive --figure spectrum.png"),
    "pressure": (pressure, "rig pressure plate.mcap --at '0.5 s, 0.56 s, 0.6 s' --figure pressure.png"),
    "hysteresis": (hysteresis, "rig hysteresis recordings/runs/belt_hysteresis-20260101-120000.mcap --window '1 s'"),
    "response": (response, "rig response knock.mcap --input knock_force --output accelerometer --figure response.png"),
    "portrait": (
        portrait,
        "rig portrait recordings/golden/pendulum.mcap --section 'velocity = 0' --figure portrait.png",
    ),
    "diff": (diff, "rig diff first.mcap second.mcap --tolerance 1e-6 --figure difference.png"),
}
