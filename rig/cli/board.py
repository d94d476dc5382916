"""The command that measures the link to a board."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Annotated, Any, Literal

import typer

from rig.cli import printing
from rig.cli.options import Json


def device(
    port: Annotated[str, typer.Argument(metavar="PORT", help="serial:/dev/ttyACM0 or udp:HOST:PORT.")],
    baud: Annotated[int, typer.Option(metavar="RATE", help="Rate of a serial port.")] = 115200,
    values: Annotated[Literal["float64", "float32"], typer.Option(help="As in the scene.")] = "float64",
    count: Annotated[int, typer.Option(metavar="N", min=1, max=24, help="Values of a frame, each way.")] = 1,
    as_json: Json = False,
) -> None:
    """Measure the link to a board: round trips of echo frames, which drive nothing.

    At 100 Hz, 1 kHz and 5 kHz, with the shortest period of a controller
    that the link holds. Exit code 1: it holds none.
    """
    from rig.qualify.board_link import measure

    measured = measure(port, baud, values, count)
    printing.result(measured, as_json)
    printing.passed(measured.period_ms is not None)


COMMANDS: Mapping[str, tuple[Any, str]] = {"device": (device, "rig tool device udp:192.168.7.2:5005")}
