"""Commands that serve a page in the browser, and programs in other languages over WebSocket."""

from __future__ import annotations

import json
import sys
from typing import Annotated

from rig.cli import printing
from rig.cli.build import JSON, Made
from rig.cli.options import RunName, Ticket
from rig.extras import check
from rig.parameters import Option

Port = Annotated[int, Option("PORT", "Port on loopback. 0: any free one.", low=0, high=65535)]


def web(
    port: Port = 0,
    no_open: Annotated[bool, Option("", "Print the address only; do not open the browser.")] = False,
    ticket: Ticket = None,
    share: Annotated[
        str | None,
        Option("HOST:PORT", "Let a class watch from this address of this host, by HTTPS: docs/class.md.", "--share"),
    ] = None,
) -> None:
    """Serve the bench as a page in the browser: choose and start scenes, watch them live, change values.

    The page is reachable from this machine only, under the printed address. With --share others can watch.
    With the ticket of an operator it shows the run on another host.
    Ctrl-C ends the active run and the server.
    """
    from rig.bus import given_ticket
    from rig.bus.address import directory  # slow to import: only where a page is served

    directory()  # where no run can be live, the page would be of no use
    _check_web("rig web")
    from rig.web.server import serve

    serve(port, not no_open, _say, given_ticket(ticket), share)


def _check_web(what: str) -> None:
    for name in ("starlette", "uvicorn", "websockets"):
        check(name, "web", what)


def _say(text: str) -> None:
    """Print an address at once: whoever reads a pipe waits for it."""
    printing.line(text)
    sys.stdout.flush()


def bridge(
    run: RunName = None,
    port: Port = 0,
    as_json: JSON = False,
) -> None:
    """Offer the bus of a live run over WebSocket, for controllers and tools in other languages.

    Only this machine can reach it, under the printed address with its token.
    It ends with the run or on Ctrl-C. docs/wire.md describes the messages.
    """
    _check_web("rig live bridge")
    from rig.web import bridge as server

    def say(made: server.Bridge) -> None:
        text = f"run {made.run} is at {made.address}\nit ends with the run; Ctrl-C ends it before"
        _say(json.dumps({"run": made.run, "address": made.address}, indent=2) if as_json else text)

    server.serve(run, port, say)


COMMANDS = {
    "web": Made(web, "rig web --no-open --port 8765"),
    "bridge": Made(bridge, "rig live bridge --run mine"),
}
