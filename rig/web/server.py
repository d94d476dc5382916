"""The process of `rig web`: one address on loopback, the browser, and an orderly end on Ctrl-C.

It admits only the pages of its user (`rig.web.guard`). With `--share` a second server shows a class the run
(`rig.web.share`).
"""

from __future__ import annotations

import asyncio
import secrets
import socket
import sys
import threading
import webbrowser
from collections.abc import Callable
from contextlib import suppress
from pathlib import Path
from typing import Any

import uvicorn
import websockets  # noqa: F401 (uvicorn imports it in the thread of the server, where a lack would go unseen)

from rig.errors import UsageError
from rig.machine.process import MORE_FILES, NO_FILES, told_to_stop
from rig.machine.scheduling import stand_back
from rig.web.app import Bench, app
from rig.web.guard import Gate, Guard, hosts_of
from rig.web.share import CONNECTIONS, Share

HOST = "127.0.0.1"
"""Address of every server: this machine only."""
LARGEST_MESSAGE = 1 << 12
"""Largest message of a page on a web socket [bytes]; those of our page have 30."""
OPEN_FILES = 64
"""Open files that the server of a page needs beside those of a run. # chosen"""
_NICE = 5
"""Nice value of the thread of the server: it leaves the processor to the run. # chosen"""
_CLOSE_S = 5.0
"""Longest wait for the end of that thread [s]: open connections have two seconds (uvicorn). # chosen"""


def listening(port: int) -> socket.socket:
    """A socket that listens on loopback; `port` 0: any free port. Raises UsageError for a used port."""
    # Only with its protocol named does asyncio send the body of an answer before the browser acknowledges its head.
    opened = socket.socket(socket.AF_INET, socket.SOCK_STREAM, socket.IPPROTO_TCP)
    opened.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
    try:
        opened.bind((HOST, port))
        opened.listen(128)  # from here on nobody else can bind it, and a browser that is early waits
    except OSError as fault:
        opened.close()
        what = f"--port {port}: cannot be used ({fault.strerror}); choose another one, or leave it out"
        raise UsageError(what) from None
    return opened


class Server:
    """The server of one bench; `port` 0: any free port; `share` (HOST:PORT): where a class watches, if it does.

    Use it in a `with` block. Raises UsageError for a used port or place.
    """

    def __init__(
        self,
        port: int = 0,
        folder: Path = Path(),
        say: Callable[[str], object] = print,
        share: str | None = None,
    ) -> None:
        self._socket = listening(port)
        self.port: int = self._socket.getsockname()[1]
        self.token = secrets.token_urlsafe(24)
        self.bench = Bench(folder, say)
        self._say = say
        try:
            self.share = Share(share, self.bench) if share is not None else None
        except UsageError:
            self._socket.close()
            raise
        config = uvicorn.Config(
            Guard(app(self.bench), Gate(hosts_of(self.port), "http", self.token), f"bench-{self.port}"),
            access_log=False,
            log_level="warning",
            lifespan="off",
            timeout_graceful_shutdown=2,
            ws_max_size=LARGEST_MESSAGE,
            ws="websockets-sansio",
        )
        self._server = uvicorn.Server(config)
        self._thread = threading.Thread(target=self._serve, name="server", daemon=True)

    @property
    def address(self) -> str:
        """The address of the page, with the token of this start."""
        return f"http://{HOST}:{self.port}/?token={self.token}"

    def __enter__(self) -> Server:
        self._thread.start()
        return self

    def __exit__(self, *_: object) -> None:
        """End the present run in order, then the server."""
        self.bench.close()
        self._server.should_exit = True
        if self.share is not None:
            self.share.stop()
        self._thread.join(_CLOSE_S)
        self._socket.close()

    def _serve(self) -> None:
        stand_back(_NICE)

        def failed(loop: asyncio.AbstractEventLoop, context: dict[str, Any]) -> None:
            if getattr(context.get("exception"), "errno", None) in NO_FILES:
                if not told:  # too many connections: the server accepts more when some have closed
                    told.append(True)
                    self._say(MORE_FILES)
            elif not (told and "_start_serving" in context["message"]):  # it tries again after it has ended
                loop.default_exception_handler(context)

        told: list[bool] = []

        async def serve() -> None:
            asyncio.get_running_loop().set_exception_handler(failed)
            self.bench.attach()
            own = self._server.serve(sockets=[self._socket])
            if self.share is None:
                await own
            else:
                await asyncio.gather(own, self.share.serve())

        asyncio.run(serve())


def serve(
    port: int = 0,
    browser: bool = True,
    say: Callable[[str], object] = print,
    ticket: Path | None = None,
    share: str | None = None,
) -> None:
    """Serve the page until Ctrl-C; with `browser` open it there. The scene files are those of the working directory.

    The first Ctrl-C ends the present run in order, a second one ends its processes at once. `ticket`: that of an
    operator of a run on another host, which the page shows. `share` (HOST:PORT): where a class watches. Raises
    UsageError, BusError.
    """
    if sys.platform != "win32":
        import resource

        allowed = resource.getrlimit(resource.RLIMIT_NOFILE)[0]
        least = OPEN_FILES + (CONNECTIONS if share is not None else 0)
        if 0 <= allowed < least:
            raise UsageError(f"rig web needs {least} open files; {MORE_FILES} (the limit is {allowed})")
    asked = threading.Event()
    with Server(port, Path(), say, share) as server:

        def stop(_: str) -> None:
            if asked.is_set():
                server.bench.control.kill()
            # set from another thread: the main thread may hold the lock of the event
            threading.Thread(target=asked.set).start()

        if ticket is not None:
            server.bench.control.follow_ticket(ticket)
        with told_to_stop(stop):
            say(f"the bench is at {server.address}\nonly this address, with its token, opens it; Ctrl-C ends it")
            if server.share is not None:
                say(f"a class watches at {server.share.address}\nfingerprint (SHA-256): {server.share.fingerprint}")
            if browser:
                with suppress(webbrowser.Error):
                    webbrowser.open(server.address)
            asked.wait()
            if server.bench.control.active:
                say("ending the run; press Ctrl-C again to end at once")
            server.bench.control.end()
