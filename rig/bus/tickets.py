"""Tickets: files with which processes on other hosts join a run, one for each seat.

The plant then also listens by TLS, at one address of its host, and both sides show certificates of an authority that
exists for this run alone (`rig.bus.certificates`); they bound the time of a ticket. A seat is a controller of the
scene, `recorder`, `viewer` or `operator`. Its ticket holds all that its process needs: the run, the address, user and
password, certificates and key. Who has the file has the seat, so only its owner may read it. The folder of tickets is
deleted with the run.
"""

from __future__ import annotations

import base64
import hashlib
import json
import os
import shutil
from collections.abc import Collection, Iterable, Mapping
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

from rig import extras
from rig.bus.access import BusUser, user_of
from rig.bus.address import directory, folder
from rig.bus.certificates import Authority
from rig.bus.place import check_place, parted
from rig.errors import BusError, UsageError
from rig.machine import files, installation

SEATS = ("recorder", "viewer", "operator")
"""Seats of every run, beside its controllers."""
_TLS = "transport/link/tls/"


def tickets_of(run: str) -> Path:
    """The folder with the tickets of a run."""
    return directory() / f"{run}.tickets"


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
