"""The commands that serve a browser, and programs that use WebSocket."""

from __future__ import annotations

import sys
from typing import Annotated

import typer

from rig.cli import printing
from rig.cli.options import Json, RunName
from rig.extras import check


def web(
    port: Annotated[int, typer.Option(min=0, max=65535, metavar="PORT", help="Port on loopback. 0: any free one.")] = 0,
    no_open: Annotated[
        bool, typer.Option("--no-open", help="Print the address only; do not open the browser.")
    ] = False,
) -> None:
    """Serve the bench as a page in the browser: choose and start scenes, watch them live, change values.

    The page is reachable from this machine only, under the printed address.
    Ctrl-C ends the active run and the server.
    """
    from rig.bus.address import directory  # slow to import: only where a page is served

    directory()  # where no run can be live, the page would be of no use
    for name in ("starlette", "uvicorn", "websockets"):
        check(name, "web", "rig web")
    from rig.web.server import serve

    def say(text: str) -> None:
        printing.line(text)
        sys.stdout.flush()  # whoever reads a pipe waits for the address

    serve(port, not no_open, say)


def bridge(
    run: RunName = None,
    port: Annotated[int, typer.Option(min=0, max=65535, metavar="PORT", help="Port on loopback. 0: any free one.")] = 0,
    as_json: Json = False,
) -> None:
    """Offer the bus of a live run over WebSocket, for controllers and tools in other languages.

    Only this machine can reach it, under the printed address with its token.
    It ends with the run or on Ctrl-C. docs/wire.md describes the messages.
    """
    from rig.web import bridge as server

    def say(made: server.Bridge) -> None:
        if as_json:
            printing.report({"run": made.run, "address": made.address})
        else:
            printing.line(f"run {made.run} is at {made.address}\nit ends with the run; Ctrl-C ends it before")
        sys.stdout.flush()  # whoever reads a pipe waits for the address

    server.serve(run, port, say)


COMMANDS = {
    "web": (web, "rig web --no-open --port 8765"),
    "bridge": (bridge, "rig bridge --run mine"),
}
