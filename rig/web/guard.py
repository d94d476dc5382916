"""Admits only the pages of this server's user: checks host, origin and token of every request and web socket.

`rig.web.gate` has the checks. The token is in the address that is printed; the first visit moves it to a
cookie that scripts cannot read. A cookie is sent to every port, so its name contains the port.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from starlette.responses import PlainTextResponse, RedirectResponse

from rig.web.gate import Gate

REFUSED = 1008
"""Code with which a web socket is closed that is not admitted: policy violation."""
FORBIDDEN = (
    "This page belongs to the user who started rig web. Open the address that rig web printed, with its token; "
    "after a new start of rig web the old address is no longer valid."
)


class Guard:
    """An ASGI application that passes admitted requests on to `app`. `port`: that of the server, on loopback."""

    def __init__(self, app: Any, port: int, token: str) -> None:
        self._app, self._token, self._gate = app, token, Gate(port, token)
        self._cookie = f"bench-{port}"
        sources = " ".join(f"ws://{host}" for host in sorted(self._gate.hosts))
        self._headers = [
            (b"content-security-policy", f"default-src 'self'; img-src 'self' data: blob:; "
             f"connect-src 'self' {sources}; frame-ancestors 'none'".encode()),
            (b"referrer-policy", b"no-referrer"),
            (b"cross-origin-resource-policy", b"same-origin"),
            (b"x-content-type-options", b"nosniff"),
            (b"cache-control", b"no-store"),
        ]  # fmt: skip

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
                own = message.get("headers", ())  # a file of the user may have rules of its own
                given = {name for name, _ in own}
                message = {**message, "headers": [*own, *(one for one in self._headers if one[0] not in given)]}
            await send(message)

        return wrapped
