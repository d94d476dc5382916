"""The way to a plant on another host: why a ticket cannot be used there, and whether the plant can still be reached.

Whether a plant on this host is live shows in a lock. Of another host only the connection is known. While its cable is
cut, both sides keep it: TCP sends again what was lost. It ends when the plant's process ends, or when nothing has come
for the lease (`rig.bus.link`), after a cut or while this computer slept. Zenoh then tries to connect again. The plant
counts as gone when its host says that nobody listens, or after `ALONE_S` without a connection.
"""

from __future__ import annotations

import socket
import ssl
import time
from collections.abc import Callable
from contextlib import suppress
from pathlib import Path

from rig.bus.tickets import Ticket
from rig.errors import BusError

ALONE_S = 10.0
"""Longest time without a connection [s]: with the lease, a host that vanished is told of after 40 s."""
_ANSWER_S = 3.0  # in which a host must accept a connection
_LOOK_S = 0.3  # the same for one that has done so before, which a process asks while it waits
_NAMES = (62, 64)  # errors of OpenSSL: the certificate is for another name, or another address
_TIMES = (9, 10)  # it is not valid yet, or no more


def reach(ticket: Ticket, path: Path) -> None:
    """Raise BusError, with the reason, if the run of the ticket in file `path` does not listen at its address."""
    host, port = ticket.place
    at = f"{host}:{port}"
    trusting = ssl.SSLContext(ssl.PROTOCOL_TLS_CLIENT)
    try:
        trusting.load_verify_locations(cadata=ticket.authority)
    except (ssl.SSLError, ValueError):
        raise BusError(f"{path} is damaged, or no ticket: copy it again from the plant's host") from None
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
        if fault.verify_code in _NAMES:
            why = f"the certificate of the run at {at} does not name {host}: use the address that --listen named"
        elif fault.verify_code in _TIMES:
            why = f"the certificate of the run at {at} is not valid by the clock of this host: set the clock"
        else:
            why = f"another run than {ticket.run} listens at {at}: ask for a ticket of that run"
    except ssl.SSLError:
        why = f"what listens at {at} is no run: another program has the port"
    except OSError as fault:
        why = f"{at} does not answer ({fault.strerror or fault}): is the host on, and does its firewall let it through?"
    raise BusError(f"the ticket {path} opens nothing: {why}")


def _local_address(host: str, port: int) -> str:
    """The address of this host from which it reaches another one; "" if it does not."""
    with suppress(OSError), socket.create_connection((host, port), _LOOK_S) as plain:
        return str(plain.getsockname()[0])
    return ""


def _slept_s() -> float:
    """Time [s] that this computer has slept since it started; 0 where the system does not tell it."""
    clock = getattr(time, "CLOCK_BOOTTIME", None)
    return 0.0 if clock is None else time.clock_gettime(clock) - time.monotonic()


class Contact:
    """Whether a process still has its plant, `connected()` at this moment; `over()`: the plant has said farewell.

    `say` gets a line when the connection is lost.
    """

    def __init__(
        self,
        ticket: Ticket,
        connected: Callable[[], bool],
        over: Callable[[], bool],
        say: Callable[[str], object],
    ) -> None:
        self._ticket = ticket
        self._connected = connected
        self._over = over
        self._say = say
        self._since: float | None = None
        self._slept = _slept_s()
        self._address = _local_address(*ticket.place)
        self.gone = ""
        """Why the plant cannot be reached any more; "" while it can, and if it has said farewell."""

    def ended(self) -> bool:
        """Whether the run has ended, or its plant is gone. To be asked while the plant is not present."""
        now = time.monotonic()
        if self._connected():
            self._since = None
            return False
        if self._over() or self.gone:
            return True
        run = self._ticket.run
        at = self._ticket.endpoint
        if self._since is None:
            self._since = now
            self._say(f"no connection to run {run} at {at}{self._own_part()}; trying again for {ALONE_S:g} s")
        try:
            socket.create_connection(self._ticket.place, _LOOK_S).close()
        except ConnectionRefusedError:
            self.gone = f"the plant of run {run} is gone: nobody listens at {at} any more"
        except OSError:
            pass
        if not self.gone and now - self._since > ALONE_S:
            self.gone = f"the plant of run {run} is out of reach at {at}{self._own_part()}"
        return bool(self.gone)

    def _own_part(self) -> str:
        """What this computer has to do with the loss, for the end of a sentence."""
        slept = _slept_s() - self._slept
        if slept > 1.0:
            return f": this computer slept for {slept:.0f} s"
        address = _local_address(*self._ticket.place)
        if address and address != self._address:
            return f": the address of this computer was {self._address}, and is {address} now"
        return ""
