"""The way to a plant on another host: why a ticket cannot be used there, and why its connection is lost.

Whether a plant on this host is live shows in a lock. Of another host only the connection is known. While its cable is
cut, both sides keep it: TCP sends again what was lost. It ends when the plant's process ends, or when nothing has come
for the lease (`rig.bus.link`), after a longer cut or while this computer slept. A process does not take it up again by
itself, because another one may have its seat by then.
"""

from __future__ import annotations

import socket
import ssl
import time
from contextlib import suppress
from datetime import UTC, datetime
from pathlib import Path

from rig.bus.tickets import Ticket
from rig.errors import BusError

_ANSWER_S = 3.0  # in which a host must accept a connection
_NAMES = (62, 64)  # errors of OpenSSL: the certificate is for another name, or another address
_EARLY = 9  # it is not valid yet
_TIMES = (_EARLY, 10)  # or no more


class NotThere(BusError):
    """No run answers at the address of a ticket: it may not have begun."""


def reach(ticket: Ticket, path: Path) -> None:
    """Raise BusError, with the reason, if the run of the ticket in file `path` does not listen at its address.

    It is NotThere where that may change: also a run under a flood of strangers closes a connection in its handshake.
    """
    host, port = ticket.place
    at = f"{host}:{port}"
    kind: type[BusError] = NotThere
    trusting = ssl.SSLContext(ssl.PROTOCOL_TLS_CLIENT)
    trusting.load_verify_locations(cadata=ticket.authority)
    try:
        with (
            socket.create_connection((host, port), _ANSWER_S) as plain,
            trusting.wrap_socket(plain, server_hostname=host),
        ):
            return
    except ConnectionRefusedError:
        why = f"nobody listens at {at}: the run {ticket.run} has ended, or not begun"
    except socket.gaierror:
        why = f"no address is known for {host}"
    except ssl.SSLCertVerificationError as fault:
        kind = BusError
        if fault.verify_code in _NAMES:
            why = f"the certificate of the run at {at} does not name {host}: use the address that --listen named"
        elif fault.verify_code in _TIMES:
            clock = f"by the clock of this host ({datetime.now(UTC):%Y-%m-%d %H:%M} UTC)"
            over = f"its time is over {clock}: set the clock, or ask for a new ticket"
            why = f"its time has not begun {clock}: set the clock" if fault.verify_code == _EARLY else over
        else:
            why = f"the run that listens at {at} has not issued it: ask for a ticket of that run"
    except ssl.SSLError:
        why = f"what listens at {at} is no run: another program has the port"
    except OSError as fault:
        why = f"{at} does not answer ({fault.strerror or fault}): is the host on, and does its firewall let it through?"
    raise kind(f"the ticket {path} opens nothing: {why}")


def _local_address(host: str, port: int) -> str:
    """The address of this host from which it would reach another one; "" if it knows no way there."""
    with suppress(OSError):
        family, kind, _, _, place = socket.getaddrinfo(host, port, type=socket.SOCK_DGRAM)[0]
        with socket.socket(family, kind) as asked:
            asked.connect(place)  # sends nothing
            return str(asked.getsockname()[0])
    return ""


def _slept_s() -> float:
    """Time [s] that this computer has slept since it started; 0 where the system does not tell it."""
    clock = getattr(time, "CLOCK_BOOTTIME", None)
    return 0.0 if clock is None else time.clock_gettime(clock) - time.monotonic()


class Contact:
    """The connection that a process of another host has with the plant of its ticket, from now on."""

    def __init__(self, ticket: Ticket) -> None:
        self._ticket = ticket
        self._slept = _slept_s()
        self._address = _local_address(*ticket.place)

    def loss(self) -> str:
        """Why the connection was lost, in a line."""
        at = f"run {self._ticket.run} at {self._ticket.endpoint}"
        try:
            socket.create_connection(self._ticket.place, _ANSWER_S).close()
        except ConnectionRefusedError:
            return f"the plant of {at} is gone: nobody listens there any more"
        except OSError:
            return f"the plant of {at} is out of reach{self._own_part()}"
        return f"the connection to {at} was lost{self._own_part()}; start again with the ticket"

    def _own_part(self) -> str:
        """What this computer has to do with the loss."""
        slept = _slept_s() - self._slept
        if slept > 1.0:
            return f": this computer slept for {slept:.0f} s"
        address = _local_address(*self._ticket.place)
        if address and address != self._address:
            return f": the address of this computer was {self._address}, and is {address} now"
        return ""
