"""Tickets: files with which processes on other hosts join a run, one for each seat.

The plant then also listens by TLS, at one address of its host, and both sides show certificates of an authority that
exists for this run alone (`rig.bus.certificates`); they bound the time of a ticket. A seat is a controller of the
scene, `recorder`, `viewer` or `operator`. Its ticket holds all that its process needs: the run, the address, user and
password, certificates and key. Who has the file has the seat, so only its owner may read it. The folder of tickets is
deleted with the run.
"""

from __future__ import annotations

import base64
import errno
import hashlib
import ipaddress
import json
import os
import re
import shutil
import socket
from collections.abc import Collection, Iterable, Mapping
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

from rig import extras
from rig.bus.access import BusUser, user_of
from rig.bus.address import directory, folder
from rig.bus.certificates import Authority, is_address
from rig.errors import BusError, UsageError
from rig.machine import files, installation

SEATS = ("recorder", "viewer", "operator")
"""Seats of every run, beside its controllers."""
_PORTS = (1024, 65535)
_TLS = "transport/link/tls/"
_NAME = re.compile(r"[A-Za-z0-9_]([A-Za-z0-9_.-]*[A-Za-z0-9_])?")
_OWN = "localhost"
"""The name under which every host means itself; where a run listens there, only processes of this host can join."""


def tickets_of(run: str) -> Path:
    """The folder with the tickets of a run."""
    return directory() / f"{run}.tickets"


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


@dataclass(frozen=True)
class Listener:
    """Where a run listens for processes of other hosts (tls/HOST:PORT), the seats that it has for them, and how long
    it is planned to last [s].
    """

    endpoint: str
    seats: tuple[str, ...]
    lasts_s: float = 0.0

    def check(self, controllers: Collection[str]) -> None:
        """Raise UsageError if nobody can listen there, or if a seat is not there. `controllers`: those of the run."""
        extras.check("cryptography", "remote", "rig run --listen")
        known = (*controllers, *SEATS)
        for number, seat in enumerate(self.seats):
            if seat not in known:
                raise UsageError(f"--tickets {seat}: the run has no such seat; it has {', '.join(known)}")
            if seat in self.seats[:number]:
                raise UsageError(f"--tickets {seat}: named twice; a seat has one ticket and one holder")
        kind, _, place = self.endpoint.partition("/")
        given = f"--listen {self.endpoint}"
        if ":" in place.rpartition(":")[0]:  # Zenoh takes it for a name
            raise UsageError(f"{given}: processes cannot join at an IPv6 address; give a name or an IPv4 address")
        check_place(given, place if kind == "tls" else "", "tls/")


@dataclass(frozen=True)
class Ticket:
    """What a process on another host needs to take its seat. Certificates and key are texts in PEM."""

    run: str
    endpoint: str
    seat: str
    user: str
    password: str
    reserved: list[str]
    """Names that guests cannot use (`rig.bus.access.BusUser`)."""
    sources: str
    """Version and sources of the plant's installation (`rig.machine.installation`)."""
    authority: str
    certificate: str
    key: str

    @property
    def place(self) -> tuple[str, int]:
        """Host and port of the plant."""
        return parted(self.endpoint)

    def bus_user(self) -> BusUser:
        """The user of the bus that the ticket makes its holder."""
        return BusUser(self.user, self.user, self.password, frozenset(self.reserved))

    def settings(self) -> dict[str, Any]:
        """The settings of Zenoh with which its holder connects."""
        return _settings("connect", self.authority, self.certificate, self.key)


def issue(run: str, listener: Listener, reserved: Iterable[str]) -> tuple[dict[str, Path], dict[str, Any]]:
    """Write the tickets of a run, whose users exist; return seat -> file, and the settings with which the hub listens.

    `reserved`: names that guests cannot use. Raises OSError.
    """
    authority = Authority(f"rig {run}", listener.lasts_s)
    own = authority.server(parted(listener.endpoint)[0])
    where = tickets_of(run)
    shutil.rmtree(where, ignore_errors=True)  # of a run of this name whose plant was killed
    where.mkdir(mode=0o700)
    files: dict[str, Path] = {}
    for seat in listener.seats:
        user = user_of(seat)
        held = authority.client(user)
        ticket = Ticket(
            run=run,
            endpoint=listener.endpoint,
            seat=seat,
            user=user,
            password=(folder(run) / user).read_text(),
            reserved=sorted(reserved),
            sources=installation.described(),
            authority=authority.certificate,
            certificate=held.certificate,
            key=held.key,
        )
        files[seat] = where / f"{seat}.ticket"
        with open(os.open(files[seat], os.O_WRONLY | os.O_CREAT | os.O_EXCL | os.O_CLOEXEC, 0o600), "w") as file:
            file.write(sealed(asdict(ticket)))
    return files, _settings("listen", authority.certificate, own.certificate, own.key)


def sealed(values: Mapping[str, Any]) -> str:
    """The text of a ticket: its values under their hash, which tells whether all of it has arrived."""
    content = json.dumps(values, indent=1)
    return f"{_hash(content)}\n{content}\n"


def _hash(content: str) -> str:
    return hashlib.sha256(content.encode()).hexdigest()


def _settings(side: str, authority: str, certificate: str, key: str) -> dict[str, Any]:
    """The settings of Zenoh for one side of a connection on which both show certificates."""
    return {
        f"{_TLS}root_ca_certificate_base64": _base64(authority),
        f"{_TLS}enable_mtls": True,
        f"{_TLS}{side}_certificate_base64": _base64(certificate),
        f"{_TLS}{side}_private_key_base64": _base64(key),
    }


def _base64(text: str) -> str:
    return base64.b64encode(text.encode()).decode()


def read(path: Path) -> Ticket:
    """The ticket in a file. Raises BusError if it cannot be used on this host and with these sources."""
    try:
        text = files.contents(path).decode()
        mode = path.stat().st_mode & 0o777
    except OSError as fault:
        raise BusError(f"the ticket {path} cannot be read: {fault.strerror}") from None
    except UnicodeDecodeError:
        raise BusError(f"the ticket {path} cannot be read: it is no text") from None
    if mode & 0o077:
        raise BusError(
            f"the ticket {path} can be read by others (its mode is {mode:o}), and holds a key: chmod 600 {path}"
        )
    stated, _, content = "\n".join(text.splitlines()).strip().partition("\n")
    if stated != _hash(content):
        raise BusError(f"{path} is damaged, or no ticket: copy it again from the plant's host")
    values = json.loads(content)
    here = installation.described()
    if values["sources"] != here:
        raise BusError(
            f"the ticket {path} is of {values['sources']:.80}, and this is {here}: install the same version on both "
            "hosts"
        )
    return Ticket(**values)
