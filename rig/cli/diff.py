"""The command that compares two recordings."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from rig.cli import printing
from rig.cli.evaluation import Faults, First, Last, Picture, span
from rig.cli.logs import opened, recording
from rig.cli.options import Force, Json, Trust
from rig.cli.outputs import draw
from rig.errors import ExitCode

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


COMMANDS = {"diff": (diff, "rig diff first.mcap second.mcap --tolerance 1e-6 --figure difference.png")}
