"""The process of `rig web`: one address on loopback, the browser, and an orderly end on Ctrl-C."""

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
from rig.process import MORE_FILES, NO_FILES, told_to_stop
from rig.scheduling import stand_back
from rig.web.app import Bench, app
from rig.web.guard import Guard

HOST = "127.0.0.1"
LARGEST_MESSAGE = 1 << 12
"""Largest message of a page on a web socket [bytes]; those of our page have 30."""
OPEN_FILES = 64
"""Open files that the server of a page needs beside those of a run. # chosen"""
_NICE, _CLOSE_S = 5, 5.0


class Server:
    """The server of one bench; `port` 0: any free port. Use it in a `with` block. Raises UsageError for a used port."""

    def __init__(self, port: int = 0, folder: Path = Path(), say: Callable[[str], object] = print) -> None:
        # Only with its protocol named does asyncio send the body of an answer before the browser acknowledges its head.
        self._socket = socket.socket(socket.AF_INET, socket.SOCK_STREAM, socket.IPPROTO_TCP)
        self._socket.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        try:
            self._socket.bind((HOST, port))
            self._socket.listen(128)  # from here on nobody else can bind it, and a browser that is early waits
        except OSError as fault:
            self._socket.close()
            raise UsageError(
                f"--port {port}: cannot be used ({fault.strerror}); choose another one, or leave it out"
            ) from None
        self.port: int = self._socket.getsockname()[1]
        self.token = secrets.token_urlsafe(24)
        self.bench, self._say = Bench(folder, say), say
        guarded = Guard(app(self.bench), self.port, self.token)
        config = uvicorn.Config(
            guarded,
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
            await self._server.serve(sockets=[self._socket])

        asyncio.run(serve())


def serve(port: int = 0, browser: bool = True, say: Callable[[str], object] = print) -> None:
    """Serve the page until Ctrl-C; with `browser` open it there. The scene files are those of the working directory.

    The first Ctrl-C ends the present run in order, a second one ends its processes at once. Raises UsageError.
    """
    if sys.platform != "win32":
        import resource

        allowed = resource.getrlimit(resource.RLIMIT_NOFILE)[0]
        if 0 <= allowed < OPEN_FILES:
            raise UsageError(f"rig web needs {OPEN_FILES} open files; {MORE_FILES} (the limit is {allowed})")
    asked = threading.Event()
    with Server(port, Path(), say) as server:

        def stop(_: str) -> None:
            if asked.is_set():
                server.bench.control.kill()
            # set from another thread: the main thread may hold the lock of the event
            threading.Thread(target=asked.set).start()

        with told_to_stop(stop):
            say(f"the bench is at {server.address}\nonly this address, with its token, opens it; Ctrl-C ends it")
            if browser:
                with suppress(webbrowser.Error):
                    webbrowser.open(server.address)
            asked.wait()
            if server.bench.control.active:
                say("ending the run; press Ctrl-C again to end at once")
            server.bench.control.end()
