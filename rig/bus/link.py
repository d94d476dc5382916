"""Opens the Zenoh sessions of a run: a star with the plant as hub.

The plant is a Zenoh `peer` with one listener on a private unix socket (or on the loopback device), and for other hosts,
if its user asks for it, a second one by TLS. Every other process is a `client` of it: clients that were peers would not
see each other. There is no other listener and no discovery; Zenoh's default configuration would listen on all
interfaces.
"""

from __future__ import annotations

import json
import os
import socket
import time
from collections.abc import Iterable
from pathlib import Path
from typing import TYPE_CHECKING, Any

import zenoh

from rig.bus import messages, port, session
from rig.bus.access import bounds, dictionary, invite, login, take_user, user_of
from rig.bus.address import Reservation, RunAddress
from rig.errors import BusError, RigError

if TYPE_CHECKING:
    from rig.bus.tickets import Listener

_PRIORITIES = ("control", "real_time", "interactive_high", "interactive_low", "data_high", "data", "data_low")
_OTHERS = ", ".join(f"{other}: (handover: app)" for other in ("acc", "net", "rx", "tx"))
_ONE_THREAD = f"(app: (worker_threads: 1), {_OTHERS})"
"""One thread for all of Zenoh instead of five: handing a message from thread to thread takes longer than sending it."""
os.environ.setdefault("ZENOH_RUNTIME", _ONE_THREAD)  # Zenoh reads it when a process opens its first session
_SOON = "tls_handshake_timeout_ms=3000"
"""Time for a handshake, in which a stranger holds one of a hundred places. # chosen"""
CONNECT_MS = 3000
"""Time in which a session must connect, if nothing refuses it: a busy machine answers late."""
_LEASE_MS = 30_000
"""Time that a process may hang before the others close its connection. The death of a process is noticed at once."""


def configuration(mode: str, listen: str | None, connect: str | None, **more: Any) -> zenoh.Config:
    """The configuration of a Zenoh session that listens or connects at an endpoint; `more`: other settings."""
    queues = "transport/link/tx/queue"
    settings: dict[str, Any] = {
        "mode": mode,
        "scouting/multicast/enabled": False,
        "scouting/gossip/enabled": False,
        "listen/endpoints": [listen] if listen else [],
        "connect/endpoints": [connect] if connect else [],
        "connect/timeout_ms": CONNECT_MS,
        "connect/exit_on_failure": True,
        # reconnect after a process hung for longer than the lease
        "connect/retry": {"period_init_ms": 100, "period_max_ms": 500, "period_increase_factor": 1.5},
        "transport/shared_memory/enabled": False,
        "transport/link/tx/lease": _LEASE_MS,
        # a full queue never delays the sender: a message that does not fit is dropped at once
        f"{queues}/congestion_control/drop/wait_before_drop": 0,
        # but a large model waits for its asker, which on a busy machine reads nothing for a while. If the asker dies
        # meanwhile, Zenoh does nothing else for as long
        f"{queues}/congestion_control/block/wait_before_close": 2_000_000,
        **{f"{queues}/size/{priority}": 16 for priority in (*_PRIORITIES, "background")},
        **more,
    }
    config = zenoh.Config()
    for key, value in settings.items():
        config.insert_json5(key, json.dumps(value))
    return config


def open_hub(
    reservation: Reservation, controllers: Iterable[str] = (), listener: Listener | None = None
) -> port.Session:
    """Open the plant's session; with a `listener` other hosts can reach it, too.

    Raises BusError if another process listens at its address.
    """
    address = reservation.address
    endpoints = [address.endpoint] if listener is None else [address.endpoint, listener.endpoint]
    seats = () if listener is None else listener.seats
    remote = [user_of(seat) for seat in seats]
    try:
        bus_user = invite(address.run, controllers, remote)
        with dictionary(address.run) as users:
            more = bounds(address.run, bus_user, users, remote)
            files: dict[str, Path] = {}
            if listener is not None:
                from rig.bus import tickets  # imports ssl: only runs that other hosts can reach wait for it

                files, by_tls = tickets.issue(address.run, listener, bus_user.reserved)
                more |= {"listen/endpoints": [address.endpoint, f"{listener.endpoint}#{_SOON}"], **by_tls}
            opened = zenoh.open(configuration("peer", address.endpoint, None, **more))
    except (zenoh.ZError, OSError) as fault:
        reservation.release()
        raise BusError(f"run {address.run} cannot listen at {' and '.join(endpoints)}: {_cause(fault)}") from None
    except RigError:
        reservation.release()
        raise
    if listener is not None:
        _bound(int(listener.endpoint.rpartition(":")[2]))
    reservation.open()
    made = session.ZenohSession(address.run, "plant", bus_user, opened, reservation)
    made.tickets = files
    made.hold(remote)
    return made


def open_leaf(address: RunAddress, role: str, name: str) -> port.Session:
    """Open the session of another process.

    Raises BusError if no process listens at the address, if the run is of another installation, or if no user is
    left for `name`.
    """
    kind, _, path = address.endpoint.partition("/")
    if address.speaks != messages.FINGERPRINT:
        raise BusError(
            f"run {address.run} belongs to another installation, whose messages differ: "
            "start all processes of a run from the same installation"
        )
    if kind == "unixsock-stream":
        _probe(Path(path), address.run)
    bus_user = take_user(address.run, role, name)
    try:
        opened = zenoh.open(configuration("client", None, address.endpoint, **login(bus_user)))
    except zenoh.ZError as fault:
        bus_user.release()
        raise BusError(f"run {address.run} does not answer at {address.endpoint}: {_cause(fault)}") from None
    return session.ZenohSession(address.run, role, bus_user, opened, None)


def open_ticket(path: Path, role: str, name: str, wait: float) -> port.Session:
    """Open the session of a process of another host, which has a ticket; wait at most `wait` seconds for the run.

    Raises BusError.
    """
    from rig.bus import contact, tickets

    ticket = tickets.read(path)
    if ticket.seat != (name if role == "controller" else role):
        whose = f"controller {name}" if role == "controller" else role
        raise BusError(f"{path} is the ticket of {ticket.seat}, and not that of {whose}")
    deadline = time.monotonic() + wait
    while True:
        try:
            contact.reach(ticket, path)
            break
        except contact.NotThere:
            if time.monotonic() >= deadline:
                raise
            time.sleep(0.2)
    own = ticket.bus_user()
    if role == "operator":
        own.name = name
    try:
        opened = zenoh.open(configuration("client", None, ticket.endpoint, **login(own), **ticket.settings()))
    except zenoh.ZError:
        raise BusError(
            f"run {ticket.run} refuses the user, the password or the certificate of {path}: copy the ticket again "
            "from the plant's host"
        ) from None
    made = session.ZenohSession(ticket.run, role, own, opened, None)
    made.depend(ticket)
    return made


def _bound(port: int) -> None:
    """Bound what other hosts can do to the socket that listens at `port`, and which Zenoh has opened.

    The system ends a connection when its host has acknowledged nothing for the lease: Zenoh alone would wait until it
    has sent what waits for that host. And strangers wait at the door: Zenoh takes in as many as come, but gives up only
    ten of them a second.
    """
    for descriptor in filter(Path.is_socket, [*Path("/proc/self/fd").glob("*")]):  # only Linux has both
        with socket.fromfd(int(descriptor.name), socket.AF_INET, socket.SOCK_STREAM) as opened:
            listens = opened.getsockopt(socket.SOL_SOCKET, socket.SO_ACCEPTCONN)
            if listens and opened.getsockname()[1] == port:
                opened.setsockopt(socket.IPPROTO_TCP, socket.TCP_USER_TIMEOUT, _LEASE_MS)
                opened.listen(0)


def _probe(path: Path, run: str) -> None:
    """Raise BusError at once if nobody listens; Zenoh would notice only after its timeout."""
    if not path.exists():
        raise BusError(f"run {run} has no socket {path}: it has ended, or has not started yet")
    with socket.socket(socket.AF_UNIX) as probe:
        try:
            probe.connect(str(path))
        except OSError as fault:
            raise BusError(
                f"no process listens at {path}: the plant of run {run} has ended unexpectedly ({fault.strerror})"
            ) from None


def _cause(fault: Exception) -> str:
    text = str(fault).partition(" at /")[0]
    return "another process already listens there" if "lock" in text or "in use" in text else text
