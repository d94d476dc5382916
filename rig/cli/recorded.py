"""Commands that analyse what a recording holds."""

from __future__ import annotations

from functools import partial
from typing import Annotated

import typer

from rig.cli.evaluation import Faults, First, Last, Picture, Table, opened_span, show, write
from rig.cli.logs import Log, opened, without_outputs
from rig.cli.options import Force, Json, Trust, seconds
from rig.cli.outputs import draw
from rig.errors import LogError

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
    from rig.user_files import write_file

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
        from rig.analysis.recorded.figure import spectrum_figure
        from rig.view.save_figure import put

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


COMMANDS = {
    "spectrum": (spectrum, "rig spectrum recordings/golden/pendulum.mcap --orders drive --figure spectrum.png"),
    "pressure": (pressure, "rig pressure plate.mcap --at '0.5 s, 0.56 s, 0.6 s' --figure pressure.png"),
    "hysteresis": (hysteresis, "rig hysteresis recordings/runs/belt_hysteresis-20260101-120000.mcap --window '1 s'"),
}
