"""A class watches: a second server with pages for watching, by HTTPS at one address of this host.

    GET  /              the page for watching;  /page/...: its modules
    GET  /api/run       state of the run, and its latest events
    GET  /api/class     {"you"}: the name under which the pages know this watcher
    POST /api/class     {"do": "ask", "name"} or {"do": "back"}
    POST /api/run/command, /api/run/set     as in `rig.web.app`, for the watcher who operates (`rig.web.seat`)
    WS   /live          as in `rig.web.app`, about 10 pictures a second

There is no other route: no scenes, files, recordings, jobs or studies. One token opens the pages of a class. The first
visit moves it to a cookie, together with a secret of this watcher, to whom the operation can be handed over.

All that a watcher can ask for is bounded: connections, their rate, requests, their size, messages, and the time in
which it must read what it has got. The texts are made once for all watchers (`rig.web.broadcast`).
"""

from __future__ import annotations

import asyncio
import math
import secrets
import socket
import ssl
import tempfile
import time
from asyncio.sslproto import SSLProtocol
from collections import OrderedDict
from collections.abc import Callable
from contextlib import suppress
from pathlib import Path
from typing import Any

import uvicorn
from starlette.applications import Starlette
from starlette.middleware.gzip import GZipMiddleware
from starlette.requests import Request
from starlette.responses import PlainTextResponse, Response
from starlette.routing import Mount, Route, WebSocketRoute
from starlette.staticfiles import StaticFiles
from starlette.websockets import WebSocket, WebSocketDisconnect
from websockets.exceptions import InvalidState

from rig.bus.certificates import Authority
from rig.bus.place import check_place
from rig.errors import UsageError
from rig.extras import check
from rig.web.app import PAGE, Bench, body_of, guarded, look, stream
from rig.web.broadcast import Broadcast, Page
from rig.web.guard import Gate, Guard
from rig.web.plain_json import Answer
from rig.web.seat import of_a_class, public

OF_ONE = 440
"""Most connections from one address: thirty laptops behind one router, each with up to eight, and 200 of a disturber
among them. # chosen"""
CONNECTIONS = 640
"""Most connections of all watchers: one address cannot lock the others out. # chosen"""
ASKING_S = 10.0
"""Longest time in which a connection that is no web socket must get an answer [s]. # chosen"""
SPACED_S = 0.08
"""Time between two pictures [s]: a little less than that of 10 a second, because frames come every 0.045 s."""
HISTORY = 40
"""Frames for a page that connects: 2 s. # chosen"""
PINGED_S = 15.0
"""Time between two questions whether a page is still there, and longest wait for the answer [s]. # chosen"""
MESSAGES = 40
"""Most messages of a watcher in a second: an answer to each picture, twice as many allowed for. # chosen"""
LARGEST = 1 << 12
"""Largest body of a request [bytes]."""
WRONG_S = 1.0
"""Time until a wrong token is answered [s]. # chosen"""
ABSENT_S = 10.0
"""Time without a page after which who operates loses the operation [s]: a page that is loaded again keeps it."""
RECORD = 1 << 14
"""Buffer of each connection [bytes]: a record of TLS. Those of asyncio have 256 kB."""
FORBIDDEN = "This page needs the address that rig web --share printed, with the token of the class; ask who runs it."
TOO_MANY = "Too many requests from this address; wait ten seconds."
_REMEMBERED = 1024
"""Addresses whose rate is remembered. # chosen"""


class Rate:
    """Bounds what each address does: `burst` at once, and `per_s` a second for long."""

    def __init__(self, burst: int, per_s: float) -> None:
        self._room_s = burst / per_s
        self._each_s = 1.0 / per_s
        self._until: OrderedDict[str, float] = OrderedDict()

    def late_s(self, who: str) -> float:
        """Count one more; returns the time by which it comes too early [s], 0 within the bounds."""
        now = time.monotonic()
        until = max(self._until.pop(who, 0.0), now) + self._each_s
        late = max(until - now - self._room_s, 0.0)
        self._until[who] = until if late == 0.0 else until - self._each_s
        if len(self._until) > _REMEMBERED:
            self._until.popitem(last=False)
        return late


class Door(Guard):
    """The guard of a class: it slows a wrong token and who asks too often. `scope["watcher"]`: who."""

    def __init__(self, app: Any, gate: Gate, cookie: str, places: BoundedSocket) -> None:
        super().__init__(app, gate, cookie)
        self._places = places
        self._of_watcher = Rate(burst=200, per_s=10.0)
        self._of_address = Rate(burst=4000, per_s=100.0)

    async def __call__(self, scope: Any, receive: Any, send: Any) -> None:
        """Answer, slow or pass on one request."""
        client = tuple(scope["client"])
        if scope["type"] == "websocket":
            self._places.allow(client, math.inf)  # it has bounds of its own
        await super().__call__(scope, receive, send)
        self._places.allow(client, ASKING_S)

    async def admitted(self, scope: Any, receive: Any, send: Any) -> None:
        """Pass on a request of a watcher, unless there are too many."""
        late = self._of_watcher.late_s(scope["watcher"]) or self._of_address.late_s(scope["client"][0])
        if late and scope["type"] == "http":
            await asyncio.sleep(WRONG_S)
            await PlainTextResponse(TOO_MANY, 429)(scope, receive, send)
        else:
            await super().admitted(scope, receive, send)

    def admit(self, scope: Any, value: str) -> bool:
        """Whether the value of a cookie has the token of the class, and names a watcher."""
        token, _, watcher = value.partition(".")
        scope["watcher"] = watcher
        return bool(watcher) and super().admit(scope, token)

    def cookie(self) -> str:
        """The value of the cookie for a new watcher."""
        return f"{super().cookie()}.{secrets.token_urlsafe(12)}"

    async def refuse(self, scope: Any, receive: Any, send: Any) -> None:
        """Tell a stranger what is needed, slowly."""
        await asyncio.sleep(WRONG_S)
        await PlainTextResponse(FORBIDDEN, 403)(scope, receive, send)

    async def refuse_socket(self, receive: Any, send: Any) -> None:
        """Close the web socket of a stranger, slowly."""
        await asyncio.sleep(WRONG_S)
        await super().refuse_socket(receive, send)


class BoundedSocket(socket.socket):
    """A socket that listens. It closes at once what comes beyond the bounds, and who holds a place without asking.

    A connection that has had no answer for its time loses its place to the next one that comes: it has not finished its
    handshake or its request, or does not read.
    """

    def bounded(self) -> BoundedSocket:
        """The same socket with its bounds."""
        self._open: dict[Any, tuple[socket.socket, float]] = {}  # host and port -> connection, end of its time
        self._rate = Rate(burst=600, per_s=20.0)
        return self

    def accept(self) -> tuple[socket.socket, Any]:
        """The next connection. Raises BlockingIOError if there is none, ConnectionAbortedError beyond the bounds."""
        made, where = super().accept()
        if not self._rate.late_s(where[0]):
            self._clear()
            of_one = sum(host == where[0] for host, _ in self._open)
            if len(self._open) < CONNECTIONS and of_one < OF_ONE:
                self._open[where[:2]] = (made, time.monotonic() + ASKING_S)
                return made, where
        made.close()
        raise ConnectionAbortedError

    def allow(self, client: Any, seconds: float) -> None:
        """Give a connection (host and port) this time from now on."""
        if client in self._open:
            self._open[client] = (self._open[client][0], time.monotonic() + seconds)

    def _clear(self) -> None:
        """Forget connections that are closed, and close those whose time is over."""
        now = time.monotonic()
        for client, (connection, until) in [*self._open.items()]:
            if connection.fileno() == -1 or until < now:
                del self._open[client]
                with suppress(OSError):
                    connection.shutdown(socket.SHUT_RDWR)


class Share:
    """The server of a class at `place` (HOST:PORT) for the pages of `bench`. Raises UsageError if it cannot listen."""

    def __init__(self, place: str, bench: Bench) -> None:
        check("cryptography", "remote", "rig web --share")
        host, port = check_place(f"--share {place}", place)
        family, kind, protocol, _, address = socket.getaddrinfo(host, port, type=socket.SOCK_STREAM)[0]
        numeric = str(address[0])
        self._socket = BoundedSocket(family, kind, protocol).bounded()
        self._socket.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        self._socket.bind(address)
        self._socket.listen(128)
        self.token = secrets.token_urlsafe(12)
        place, numbers = (f"[{at}]:{port}" if ":" in at else f"{at}:{port}" for at in (host, numeric))
        self.address = f"https://{place}/?token={self.token}"
        own = Authority("friction-rig class").server(*dict.fromkeys((host, numeric)))
        self.fingerprint = own.fingerprint
        self.broadcast = Broadcast(HISTORY, SPACED_S)
        self.authority = own.certificate
        """The certificate in PEM, for a program that checks it."""
        gate = Gate({place, numbers}, "https", self.token)
        config = uvicorn.Config(
            Door(watching(bench, self.broadcast), gate, f"class-{port}", self._socket),
            access_log=False,
            log_level="critical",
            lifespan="off",
            timeout_graceful_shutdown=2,
            ws_max_size=LARGEST,
            ws_ping_interval=PINGED_S,
            ws_ping_timeout=PINGED_S,
            ws_per_message_deflate=False,  # it would compress each picture once for each watcher
            ws="websockets-sansio",
        )
        config.load()
        config.ssl = _context(own.certificate, own.key)
        SSLProtocol.max_size = RECORD
        self._server = uvicorn.Server(config)
        bench.share(self.broadcast)

    async def serve(self) -> None:
        """Serve until `stop` is called."""
        with suppress(InvalidState):  # uvicorn closes once more what closes already
            await self._server.serve(sockets=[self._socket])

    def stop(self) -> None:
        """End the server soon."""
        self._server.should_exit = True

    def close(self) -> None:
        """Close the socket."""
        self._socket.close()


def _context(certificate: str, key: str) -> ssl.SSLContext:
    context = ssl.SSLContext(ssl.PROTOCOL_TLS_SERVER)
    context.minimum_version = ssl.TLSVersion.TLSv1_2
    with tempfile.TemporaryDirectory() as folder:  # of this user alone, and gone at once: Python reads keys from files
        file = Path(folder) / "key"
        file.write_text(certificate + key)
        context.load_cert_chain(file)
    return context


def watching(bench: Bench, broadcast: Broadcast) -> Starlette:
    """The application of a class, without its guard."""
    seat = bench.seat
    watchers = Watchers(bench, broadcast)

    async def page(_: Request) -> Response:
        html = (PAGE / "index.html").read_text(encoding="utf-8").replace("/page/main.js", "/page/watch.js")
        return Response(html, media_type="text/html")

    async def run(_: Request) -> Response:
        return Answer({**of_a_class(bench.control.state), "events": bench.control.events})

    async def of_class(request: Request) -> Response:
        watcher = request.scope["watcher"]
        if request.method == "POST":
            body = await body_of(request, LARGEST)
            if body.get("do") == "ask":
                seat.ask(watcher, body.get("name"))
            elif body.get("do") == "back":
                seat.back(watcher)
            else:
                raise UsageError(f'"do" is {body.get("do")!r:.80}; it can be ask, back')
        return Answer({"you": public(watcher)})

    def operates(handler: Callable[[dict[str, Any]], Any]) -> Callable[[Request], Any]:
        async def answer(request: Request) -> Response:
            body = await body_of(request, LARGEST)
            seat.check(request.scope["watcher"], body.get("do"))
            return await bench.urgently(lambda body: Answer(handler(body)), body)

        return guarded(answer)

    routes = [
        Route("/", page),
        Route("/page/look.css", look),
        Mount("/page", GZipMiddleware(StaticFiles(directory=PAGE))),
        Route("/api/run", run),
        Route("/api/class", guarded(of_class), methods=["GET", "POST"]),
        Route("/api/run/command", operates(bench.control.command), methods=["POST"]),
        Route("/api/run/set", operates(bench.control.set), methods=["POST"]),
        WebSocketRoute("/live", stream(watchers.connect, watchers.disconnect)),
    ]
    return Starlette(routes=routes)


class WatcherPage:
    """A page of a watcher: one of the broadcast, with a bound for what it sends."""

    def __init__(self, page: Page, watcher: str) -> None:
        self.page = page
        self.watcher = watcher
        self.next = page.next
        self._rate = Rate(burst=2 * MESSAGES, per_s=MESSAGES)

    def heard(self, text: str) -> None:
        """See `Page.heard`. Ends its connection if it says too much."""
        if self._rate.late_s(""):
            raise WebSocketDisconnect
        self.page.heard(text)


class Watchers:
    """The pages of all watchers. Without one for `ABSENT_S`, who operates loses the operation."""

    def __init__(self, bench: Bench, broadcast: Broadcast) -> None:
        self._bench = bench
        self._broadcast = broadcast
        self._pages: set[WatcherPage] = set()

    def connect(self, socket: WebSocket) -> WatcherPage:
        """A new page; `disconnect` it at the end."""
        made = WatcherPage(self._broadcast.connect(), socket.scope["watcher"])
        self._pages.add(made)
        return made

    def disconnect(self, gone: WatcherPage) -> None:
        """A page has gone."""
        self._broadcast.disconnect(gone.page)
        self._pages.discard(gone)
        asyncio.get_running_loop().call_later(ABSENT_S, self._absent, gone.watcher)

    def _absent(self, watcher: str) -> None:
        if watcher not in [page.watcher for page in self._pages]:
            self._bench.seat.back(watcher)
