"""The process of `rig web`: one address on loopback, the browser, and an orderly end on Ctrl-C.

It admits only the pages of its user: host, origin and token of every request and web socket are checked. The Host
header stops other names for this address (DNS rebinding), the Origin header stops the pages of other servers, the token
stops other users of this machine. The token is in the address that is printed; the first visit moves it to a cookie
that scripts cannot read. A cookie is sent to every port, so its name contains the port.
"""

from __future__ import annotations

import asyncio
import hmac
import secrets
import socket
import sys
import threading
import webbrowser
from collections.abc import Callable, Mapping
from contextlib import suppress
from pathlib import Path
from typing import Any
from urllib.parse import parse_qs

import uvicorn
import websockets  # noqa: F401 (uvicorn imports it in the thread of the server, where a lack would go unseen)
from starlette.responses import PlainTextResponse, RedirectResponse

from rig.errors import UsageError
from rig.machine.process import MORE_FILES, NO_FILES, told_to_stop
from rig.machine.scheduling import stand_back
from rig.web.app import Bench, app

HOST = "127.0.0.1"
"""Address of every server: this machine only."""
REFUSED = 1008
"""Code with which a web socket is closed that is not admitted: policy violation."""
FORBIDDEN = (
    "This page belongs to the user who started rig web. Open the address that rig web printed, with its token; "
    "after a new start of rig web the old address is no longer valid."
)
LARGEST_MESSAGE = 1 << 12
"""Largest message of a page on a web socket [bytes]; those of our page have 30."""
OPEN_FILES = 64
"""Open files that the server of a page needs beside those of a run. # chosen"""
_NICE = 5
"""Nice value of the thread of the server: it leaves the processor to the run. # chosen"""
_CLOSE_S = 5.0
"""Longest wait for the end of that thread [s]: open connections have two seconds (uvicorn). # chosen"""


class Gate:
    """The checks of a server at `port`, whose users know `token`."""

    def __init__(self, port: int, token: str) -> None:
        self.hosts = {f"127.0.0.1:{port}", f"localhost:{port}"}
        self._origins = {f"http://{host}" for host in self.hosts}
        self._token = token

    def local(self, host: str | None, origin: str | None = None, *, of_a_page: bool = False) -> bool:
        """Whether a request asks for this address, from no page or from a page of it; `of_a_page`: from such a page."""
        from_here = origin in self._origins
        from_no_page = origin is None and not of_a_page
        return host in self.hosts and (from_here or from_no_page)

    def same(self, token: str) -> bool:
        """Whether this is the token."""
        return hmac.compare_digest(token.encode(), self._token.encode())

    def in_query(self, query: str) -> bool:
        """Whether the query of an address has the token."""
        return self.same(parse_qs(query).get("token", [""])[0])


class Guard:
    """An ASGI application that passes admitted requests on to `app`. `port`: that of the server, on loopback."""

    def __init__(self, app: Any, port: int, token: str) -> None:
        self._app = app
        self._token = token
        self._gate = Gate(port, token)
        self._cookie = f"bench-{port}"
        sources = " ".join(f"ws://{host}" for host in sorted(self._gate.hosts))
        policy = f"default-src 'self'; img-src 'self' data: blob:; connect-src 'self' {sources}; frame-ancestors 'none'"
        self._headers = [
            (b"content-security-policy", policy.encode()),
            (b"referrer-policy", b"no-referrer"),
            (b"cross-origin-resource-policy", b"same-origin"),
            (b"x-content-type-options", b"nosniff"),
            (b"cache-control", b"no-store"),
        ]

    async def __call__(self, scope: Any, receive: Any, send: Any) -> None:
        """Answer, redirect or pass on one request."""
        if scope["type"] == "lifespan":
            await self._app(scope, receive, send)
            return
        head = {name.decode("latin1"): value.decode("latin1") for name, value in scope["headers"]}
        is_socket = scope["type"] == "websocket"
        local = self._gate.local(head.get("host"), head.get("origin"), of_a_page=is_socket)
        if local and any(map(self._gate.same, self._cookies(head))):
            await self._app(scope, receive, self._with_headers(send))
        elif is_socket:
            await receive()
            await send({"type": "websocket.close", "code": REFUSED})
        elif local and scope["method"] == "GET" and self._gate.in_query(scope["query_string"].decode("latin1")):
            answer = RedirectResponse("/" + scope["path"].lstrip("/\\"), 303)  # //host/ would be another server
            answer.set_cookie(self._cookie, self._token, httponly=True, samesite="strict")
            await answer(scope, receive, self._with_headers(send))
        else:
            await PlainTextResponse(FORBIDDEN, 403)(scope, receive, self._with_headers(send))

    def _cookies(self, head: Mapping[str, str]) -> list[str]:
        # other servers on this machine may set cookies too: http.cookies gives up at one that it cannot read
        pairs = (part.strip().partition("=") for part in head.get("cookie", "").split(";"))
        return [value for name, _, value in pairs if name == self._cookie]

    def _with_headers(self, send: Any) -> Any:
        async def wrapped(message: Any) -> None:
            if message["type"] == "http.response.start":
                headers = message.get("headers", ())  # a file of the user may have rules of its own
                names = {name for name, _ in headers}
                added = [(name, rule) for name, rule in self._headers if name not in names]
                message = {**message, "headers": [*headers, *added]}
            await send(message)

        return wrapped


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
    """The server of one bench; `port` 0: any free port. Use it in a `with` block. Raises UsageError for a used port."""

    def __init__(self, port: int = 0, folder: Path = Path(), say: Callable[[str], object] = print) -> None:
        self._socket = listening(port)
        self.port: int = self._socket.getsockname()[1]
        self.token = secrets.token_urlsafe(24)
        self.bench = Bench(folder, say)
        self._say = say
        config = uvicorn.Config(
            Guard(app(self.bench), self.port, self.token),
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


def serve(
    port: int = 0, browser: bool = True, say: Callable[[str], object] = print, ticket: Path | None = None
) -> None:
    """Serve the page until Ctrl-C; with `browser` open it there. The scene files are those of the working directory.

    The first Ctrl-C ends the present run in order, a second one ends its processes at once. `ticket`: that of an
    operator of a run on another host, which the page shows. Raises UsageError, BusError.
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

        if ticket is not None:
            server.bench.control.follow_ticket(ticket)
        with told_to_stop(stop):
            say(f"the bench is at {server.address}\nonly this address, with its token, opens it; Ctrl-C ends it")
            if browser:
                with suppress(webbrowser.Error):
                    webbrowser.open(server.address)
            asked.wait()
            if server.bench.control.active:
                say("ending the run; press Ctrl-C again to end at once")
            server.bench.control.end()
