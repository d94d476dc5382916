"""Commands that relate channels of a recording to each other."""

from __future__ import annotations

from typing import TYPE_CHECKING, Annotated

import typer

from rig.cli.evaluation import Faults, First, Last, Picture, Table, opened_span, show, write
from rig.cli.logs import Log
from rig.cli.options import Force, Json, Trust, number
from rig.cli.outputs import draw
from rig.errors import UsageError

if TYPE_CHECKING:
    from rig.record.run import Run

Source = Annotated[
    str,
    typer.Option("--input", metavar="NAME", help="Channel that excites: a sensor, a plant output, or an actuator."),
]
Answer = Annotated[str, typer.Option("--output", metavar="NAME", help="Channel that responds.")]
Windows = Annotated[
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

_LARGEST = 1e300


def response(
    log: Log,
    source: Source,
    answer: Answer,
    window: Windows = None,
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

    if not given:
        return None
    name, equals, value = (part.strip() for part in given.partition("="))
    if not (name and equals and value):
        raise UsageError(f'--section {given}: expected NAME=VALUE, such as "velocity = 10 mm/s"')
    return name, number(value, f"--section {name} =", series(run, name).unit, -_LARGEST, _LARGEST)


COMMANDS = {
    "response": (response, "rig response knock.mcap --input knock_force --output accelerometer --figure response.png"),
    "portrait": (
        portrait,
        "rig portrait recordings/golden/pendulum.mcap --section 'velocity = 0' --figure portrait.png",
    ),
}
