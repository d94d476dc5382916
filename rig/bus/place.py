"""Places at which this host listens for others: HOST:PORT, with a name or an address that certificates can hold.

Other hosts must reach the place, and nobody else may listen there. A wrong one is refused before anything starts: what
listens at an address of loopback lets nobody in, and what listens at all addresses lets in more than was asked for.
"""

from __future__ import annotations

import errno
import ipaddress
import re
import socket

from rig.bus.certificates import is_address
from rig.errors import UsageError

_PORTS = (1024, 65535)
_NAME = re.compile(r"[A-Za-z0-9_]([A-Za-z0-9_.-]*[A-Za-z0-9_])?")
_OWN = "localhost"
"""The name under which every host means itself; where a run listens there, only processes of this host can join."""


def parted(endpoint: str) -> tuple[str, int]:
    """Host and port of an endpoint tls/HOST:PORT."""
    host, _, port = endpoint.partition("/")[2].rpartition(":")
    return host.strip("[]"), int(port)


def check_place(given: str, place: str, before: str = "") -> tuple[str, int]:
    """Host and port of a place HOST:PORT. Raises UsageError if nobody can listen there.

    `given`: the option; `before`: what its value has before the place.
    """
    host, _, port = place.rpartition(":")
    if not host or not (port.isascii() and port.isdecimal()):
        raise UsageError(
            f"{given}: expected {before}HOST:PORT with the name or address under which other hosts reach this one, "
            f"such as {before}192.168.7.2:7450"
        )
    host = _host(given, host)
    if not _PORTS[0] <= int(port) <= _PORTS[1]:
        raise UsageError(f"{given}: the port must be {_PORTS[0]} to {_PORTS[1]}; those below belong to the system")
    try:
        kind_of_address, _, _, _, address = socket.getaddrinfo(host, int(port), type=socket.SOCK_STREAM)[0]
        _check_reached(given, host, str(address[0]))
        with socket.socket(kind_of_address) as tried:
            tried.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
            tried.bind(address)
            tried.listen()
            socket.create_connection((str(address[0]), int(port)), 1.0).close()  # of many hosts: nobody can connect
    except (socket.gaierror, UnicodeError):
        raise UsageError(f"{given}: no address is known for the name {host}; give an address of this host") from None
    except OSError as fault:
        taken = fault.errno == errno.EADDRINUSE
        other = "another process listens there; choose another port"
        wrong = f"{fault.strerror}; give an address of this host"
        raise UsageError(f"{given}: {other if taken else wrong}") from None
    return host, int(port)


def _host(given: str, text: str) -> str:
    """The host of a place as certificates and browsers write it. Raises UsageError for one that they cannot name."""
    inner = text[1:-1] if text.startswith("[") and text.endswith("]") else text
    if "%" in inner:
        raise UsageError(f"{given}: {text} is an address of one cable; give another address of this host")
    if is_address(inner):
        address = ipaddress.ip_address(inner)
        if (address.version == 6) != (inner != text):
            raise UsageError(f"{given}: an IPv6 address stands in brackets, such as [fd00::2]:7450, and no other host")
        return str(address)
    if not _NAME.fullmatch(text):
        raise UsageError(f"{given}: {text} is no name and no address of a host; give one, such as 192.168.7.2")
    return text.lower()


def _check_reached(given: str, host: str, address: str) -> None:
    """Raise UsageError if other hosts do not reach this one at `address`, which belongs to `host`."""
    meant = ipaddress.ip_address(address.partition("%")[0])
    if meant.is_unspecified:
        raise UsageError(f"{given}: name the one address or name of this host under which others reach it")
    if is_address(host) or host == _OWN:
        return
    if host.replace(".", "").isdigit():
        raise UsageError(f"{given}: certificates need the whole address; write {address}")
    if meant.is_loopback:
        raise UsageError(
            f"{given}: on this host the name {host} means {address}, which no other host reaches; give its address in "
            "the network"
        )
