"""Whether what listens at an address is a dask scheduler: dask itself would wait for its answer for ever.

A dask scheduler speaks first: the length of its message in eight bytes, then the message.
"""

from __future__ import annotations

import socket
import struct

_LONGEST = 1 << 20  # bytes of a first message: it has some hundreds
_HEAD = struct.Struct("<Q")


def unanswered(where: str, seconds: float) -> str:
    """Why no scheduler answers at tcp://HOST:PORT within some time; "" if one does, or if nothing listens there yet.

    Other addresses are not tried: what listens without encryption fails at once with tls.
    """
    scheme, _, rest = where.partition("://")
    if scheme != "tcp":
        return ""
    host, _, port = rest.rpartition(":")
    try:
        connected = socket.create_connection((host.strip("[]"), int(port)), timeout=seconds)
    except OSError:  # dask tries again for some time
        return ""
    with connected:
        connected.settimeout(seconds)
        try:
            with connected.makefile("rb") as file:
                head = file.read(_HEAD.size)
        except TimeoutError:
            return "it accepts the connection and says nothing"
        except OSError as fault:
            return fault.strerror or str(fault)
    if len(head) == _HEAD.size and 0 < _HEAD.unpack(head)[0] <= _LONGEST:
        return ""
    return "what listens there does not speak as dask does"
