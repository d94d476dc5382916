"""The bus of one run over WebSocket, for languages without a Zenoh client: docs/wire.md describes the messages.

Every client has a session of its own on the bus and, once it is admitted as a controller, a seat of its own: the plant
checks what it sends like everything else, and knows when it has gone. A client that does not read loses messages, which
are counted, and is disconnected when it answers no ping for ten seconds.
"""

from __future__ import annotations

import json
import logging
import secrets
import socket
import struct
import sys
import threading
import time
from collections.abc import Callable
from contextlib import suppress
from http import HTTPStatus
from typing import Any

from rig.bus import address
from rig.errors import BusError
from rig.extras import needed
from rig.machine.process import told_to_stop
from rig.web.bridge_client import LOOK_S, Client
from rig.web.guard import Gate, hosts_of
from rig.web.server import HOST, listening

CLIENTS = 8
"""Most clients at a time."""
LARGEST = 1 << 16
"""Largest message of a client [bytes]."""
SEND_S = 5
"""Longest time for which a message to a client waits [s]: one that takes nothing must not hold its seat. # chosen"""
_END_S = 3.0
"""Longest wait for clients, and then for the server, when it ends [s]. # chosen"""
PING_S = 5.0
"""Time between two pings [s]. # chosen"""
PONG_S = 10.0
"""Time in which a client must answer a ping [s]. # chosen"""
_QUIET = logging.getLogger(__name__)  # a client that breaks off its handshake is none of the user's concern
_QUIET.addHandler(logging.NullHandler())
_QUIET.propagate = False
FORBIDDEN = "Open the address that rig live bridge printed, with its token, from a program or a page of this address.\n"


class Bridge:
    """The server for `run`; `port` 0: any free port. Use it in a `with` block. Raises UsageError for a used port."""

    def __init__(self, run: str, port: int = 0) -> None:
        self.run = run
        self.clients: set[Client] = set()
        self._seats: set[Any] = set()  # connections that count against `CLIENTS`
        self._seating = threading.Lock()
        self._stopped = threading.Event()
        self._socket = listening(port)
        self.port: int = self._socket.getsockname()[1]
        self.token = secrets.token_urlsafe(24)
        self._gate = Gate(hosts_of(self.port), "http", self.token)
        self._server = needed("websockets.sync.server", "web").serve(
            self._serve,
            sock=self._socket,
            process_request=self._check,
            compression=None,
            open_timeout=5,
            ping_interval=PING_S,
            ping_timeout=PONG_S,
            close_timeout=1,
            max_size=LARGEST,
            server_header=None,
            logger=_QUIET,
        )
        self._thread = threading.Thread(target=self._server.serve_forever, name="bridge", daemon=True)

    @property
    def address(self) -> str:
        """The address for clients, with the token of this start."""
        return f"ws://{HOST}:{self.port}/?token={self.token}"

    def __enter__(self) -> Bridge:
        self._thread.start()
        return self

    def __exit__(self, *_: object) -> None:
        """Tell all clients why it ends, and disconnect them; wait at most a few seconds for each step."""
        self._stopped.set()
        deadline = time.monotonic() + _END_S
        while self.clients and time.monotonic() < deadline:
            time.sleep(0.01)
        for client in list(self.clients):  # of a client that waits for an answer
            client.close()
        ending = threading.Thread(target=self._server.shutdown, name="bridge-close", daemon=True)
        ending.start()
        ending.join(_END_S)

    def _check(self, connection: Any, request: Any) -> Any:
        """Admit a client (None), or refuse it."""
        hosts = request.headers.get_all("Host")
        origins = request.headers.get_all("Origin")
        once = len(hosts) == 1 and len(origins) < 2
        query = request.path.partition("?")[2]
        if not (once and self._gate.local(*hosts, *origins) and self._gate.in_query(query)):
            return connection.respond(HTTPStatus.FORBIDDEN, FORBIDDEN)
        if not self._seated(connection):
            return connection.respond(HTTPStatus.SERVICE_UNAVAILABLE, f"{CLIENTS} clients are connected already\n")
        return None

    def _seated(self, connection: Any) -> bool:
        """Give a connection one of the seats, if one is free; many connections may ask at once."""
        over = needed("websockets.protocol", "web").CLOSED
        with self._seating:
            self._seats = {other for other in self._seats if other.protocol.state is not over}
            if len(self._seats) >= CLIENTS:
                return False
            self._seats.add(connection)
            return True

    def _serve(self, connection: Any) -> None:
        """Serve one client, in a thread of its own."""
        closed = needed("websockets", "web").ConnectionClosed
        # a client that takes nothing must not hold its seat: sending fails after some seconds
        connection.socket.setsockopt(socket.SOL_SOCKET, socket.SO_SNDTIMEO, struct.pack("ll", SEND_S, 0))
        connection.socket.setsockopt(socket.SOL_SOCKET, socket.SO_SNDBUF, LARGEST)
        connection.socket.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
        try:
            client = Client(self.run, connection.send, connection.ping)
        except BusError as fault:
            with suppress(closed, OSError):
                connection.send(json.dumps({"error": str(fault)}))
            return
        self.clients.add(client)
        try:
            while True:
                try:
                    client.answer(connection.recv(LOOK_S))
                except TimeoutError:
                    pass
                if client.ended:
                    client.say_end()
                    break
                if self._stopped.is_set():
                    client.say(error="the bridge was ended by its user")
                    break
        except (closed, OSError):
            pass
        finally:
            client.close()
            self.clients.discard(client)


def serve(run: str | None, port: int = 0, say: Callable[[Bridge], object] = print) -> None:
    """Serve a live run (the only one by default) until it ends, or until Ctrl-C. Raises RigError."""
    live = address.find(run)
    sys.setswitchinterval(1e-4)  # a step waits a tenth of a frame for the interpreter, instead of five frames
    stopped = threading.Event()

    def stop(_: str) -> None:  # set from another thread: the main thread may hold the lock of the event
        threading.Thread(target=stopped.set).start()

    with Bridge(live.run, port) as bridge, told_to_stop(stop):
        say(bridge)
        while not stopped.wait(LOOK_S) and address.is_live(live.run):
            pass
