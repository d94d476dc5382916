"""Opens the Zenoh sessions of a run: a star with the plant as hub.

The plant is a Zenoh `peer` with one listener on a private unix socket (or on the loopback device). Every other process
is a `client` of it: clients that were peers would not see each other. There is no other listener and no discovery;
Zenoh's default configuration would listen on all interfaces.
"""

from __future__ import annotations

import json
import os
import socket
from collections.abc import Iterable
from pathlib import Path
from typing import Any

import zenoh

from rig.bus import messages, port, session
from rig.bus.access import bounds, dictionary, invite, login, take_user
from rig.bus.address import Reservation, RunAddress
from rig.errors import BusError

_PRIORITIES = ("control", "real_time", "interactive_high", "interactive_low", "data_high", "data", "data_low")
_OTHERS = ", ".join(f"{other}: (handover: app)" for other in ("acc", "net", "rx", "tx"))
_ONE_THREAD = f"(app: (worker_threads: 1), {_OTHERS})"
"""One thread for all of Zenoh instead of five: handing a message from thread to thread takes longer than sending it."""
os.environ.setdefault("ZENOH_RUNTIME", _ONE_THREAD)  # Zenoh reads it when a process opens its first session
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
        "connect/timeout_ms": 3000,
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


def open_hub(reservation: Reservation, controllers: Iterable[str] = ()) -> port.Session:
    """Open the plant's session. Raises BusError if another process listens at its address."""
    address = reservation.address
    try:
        bus_user = invite(address.run, controllers)
        with dictionary(address.run) as users:
            more = bounds(address.run, bus_user, users)
            opened = zenoh.open(configuration("peer", address.endpoint, None, **more))
    except (zenoh.ZError, OSError) as fault:
        reservation.release()
        raise BusError(f"run {address.run} cannot listen at {address.endpoint}: {_cause(fault)}") from None
    except BusError:
        reservation.release()
        raise
    reservation.open()
    return session.ZenohSession(address.run, "plant", bus_user, opened, reservation)


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
