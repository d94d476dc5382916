"""Who may speak to a server: host, origin and token of every request and web socket are checked.

The Host header stops other names for this address (DNS rebinding), the Origin header stops the pages of other servers,
the token stops other users. The token is in the address that is printed; the first visit moves it to a cookie that
scripts cannot read. A cookie is sent to every port, so its name contains the port.
"""

from __future__ import annotations

import hmac
from collections.abc import Collection, Mapping
from typing import Any
from urllib.parse import parse_qs

from starlette.responses import PlainTextResponse, RedirectResponse

REFUSED = 1008
"""Code with which a web socket is closed that is not admitted: policy violation."""
FORBIDDEN = (
    "This page belongs to the user who started rig web. Open the address that rig web printed, with its token; "
    "after a new start of rig web the old address is no longer valid."
)


def hosts_of(port: int) -> set[str]:
    """The names of a server at `port` on loopback."""
    return {f"127.0.0.1:{port}", f"localhost:{port}"}


class Gate:
    """The checks of a server with these `hosts` (HOST:PORT) and this `scheme`, whose users know `token`."""

    def __init__(self, hosts: Collection[str], scheme: str, token: str) -> None:
        self.hosts = frozenset(hosts)
        self.scheme = scheme
        self._origins = {f"{scheme}://{host}" for host in self.hosts}
        self.token = token

    def local(self, host: str | None, origin: str | None = None, *, of_a_page: bool = False) -> bool:
        """Whether a request asks for this address, from no page or from a page of it; `of_a_page`: from such a page."""
        from_here = origin in self._origins
        from_no_page = origin is None and not of_a_page
        return host in self.hosts and (from_here or from_no_page)

    def same(self, token: str) -> bool:
        """Whether this is the token."""
        return hmac.compare_digest(token.encode(), self.token.encode())

    def in_query(self, query: str) -> bool:
        """Whether the query of an address has the token."""
        return self.same(parse_qs(query).get("token", [""])[0])


class Guard:
    """An ASGI application that passes admitted requests on to `app`; `name`: that of the cookie."""

    def __init__(self, app: Any, gate: Gate, name: str) -> None:
        self._app = app
        self._gate = gate
        self._name = name
        socket = gate.scheme.replace("http", "ws")
        sources = " ".join(f"{socket}://{host}" for host in sorted(gate.hosts))
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
        if local and any(self.admit(scope, value) for value in self._cookies(head)):
            await self.admitted(scope, receive, self._with_headers(send))
        elif (
            not is_socket
            and local
            and scope["method"] == "GET"
            and self._gate.in_query(scope["query_string"].decode("latin1"))
        ):
            answer = RedirectResponse("/" + scope["path"].lstrip("/\\"), 303)  # //host/ would be another server
            secure = self._gate.scheme == "https"
            answer.set_cookie(self._name, self.cookie(), httponly=True, samesite="strict", secure=secure)
            await answer(scope, receive, self._with_headers(send))
        elif is_socket:
            await self.refuse_socket(receive, send)
        else:
            await self.refuse(scope, receive, self._with_headers(send))

    async def admitted(self, scope: Any, receive: Any, send: Any) -> None:
        """Pass on a request that is admitted."""
        await self._app(scope, receive, send)

    def admit(self, _: Any, value: str) -> bool:
        """Whether a request with this value of the cookie is admitted."""
        return self._gate.same(value)

    def cookie(self) -> str:
        """The value of the cookie that the first visit gets."""
        return self._gate.token

    async def refuse(self, scope: Any, receive: Any, send: Any) -> None:
        """Tell a stranger what is needed."""
        await PlainTextResponse(FORBIDDEN, 403)(scope, receive, send)

    async def refuse_socket(self, receive: Any, send: Any) -> None:
        """Close the web socket of a stranger."""
        await receive()
        await send({"type": "websocket.close", "code": REFUSED})

    def _cookies(self, head: Mapping[str, str]) -> list[str]:
        # other servers on this machine may set cookies too: http.cookies gives up at one that it cannot read
        pairs = (part.strip().partition("=") for part in head.get("cookie", "").split(";"))
        return [value for name, _, value in pairs if name == self._name]

    def _with_headers(self, send: Any) -> Any:
        async def wrapped(message: Any) -> None:
            if message["type"] == "http.response.start":
                headers = message.get("headers", ())  # a file of the user may have rules of its own
                names = {name for name, _ in headers}
                added = [(name, rule) for name, rule in self._headers if name not in names]
                message = {**message, "headers": [*headers, *added]}
            await send(message)

        return wrapped
