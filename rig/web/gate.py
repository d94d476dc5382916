"""The checks of host, origin and token of a request to a server on loopback.

The Host header stops other names for this address (DNS rebinding), the Origin header stops the pages of other servers,
the token stops other users of this machine.
"""

from __future__ import annotations

import hmac
from urllib.parse import parse_qs


class Gate:
    """The checks of a server at `port`, whose users know `token`."""

    def __init__(self, port: int, token: str) -> None:
        self.hosts = {f"127.0.0.1:{port}", f"localhost:{port}"}
        self._origins = {f"http://{host}" for host in self.hosts}
        self._token = token

    def local(self, host: str | None, origin: str | None = None, *, of_a_page: bool = False) -> bool:
        """Whether a request asks for this address, from no page or from a page of it; `of_a_page`: from such a page."""
        return host in self.hosts and (origin in self._origins if of_a_page or origin is not None else True)

    def same(self, token: str) -> bool:
        """Whether this is the token."""
        return hmac.compare_digest(token.encode(), self._token.encode())

    def in_query(self, query: str) -> bool:
        """Whether the query of an address has the token."""
        return self.same(parse_qs(query).get("token", [""])[0])
