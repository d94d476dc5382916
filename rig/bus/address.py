"""Addresses of live runs: a private directory with one file and one socket for each run.

The plant holds a lock on the file of its run. The kernel releases the lock even when the plant is killed. So a file
without a lock belongs to a dead plant, and any process that finds it removes it.
"""

from __future__ import annotations

import json
import os
import re
import shutil
import socket
import stat
import sys
import tempfile
import time
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import asdict, dataclass
from pathlib import Path

from rig.bus.messages import FINGERPRINT
from rig.errors import BusError
from rig.machine import files
from rig.printable import printable, utf8

_LONGEST = 107 if sys.platform == "linux" else 103
_PRIVATE = ("unixsock-stream/", "tcp/127.0.0.1:", "tcp/[::1]:", "tcp/localhost:")
_NAME = re.compile(r"[A-Za-z0-9][A-Za-z0-9_-]*")


def folder(run: str) -> Path:
    """The folder with the passwords of a run."""
    return directory() / f"{run}.users"


@dataclass(frozen=True)
class RunAddress:
    """A run and how to reach it."""

    run: str
    endpoint: str
    pid: int
    scene: str
    started: float
    """Seconds since 1970."""
    speaks: str = ""
    """Fingerprint of its message types: `rig.bus.messages.FINGERPRINT`."""
    home: str = ""
    """The home directory of who started it."""


def directory() -> Path:
    """The directory of live runs, readable by this user only.

    Raises BusError if it cannot be made or belongs to another user, or if the system lacks unix sockets or file locks.
    """
    if not (files.KNOWN and hasattr(socket, "AF_UNIX")):
        raise BusError(
            "live runs need file locks and unix sockets, which this system does not have; "
            "rig simulate, studies and figures work here"
        )
    base = os.environ.get("XDG_RUNTIME_DIR")
    here = Path(base) / "friction-rig" if base else Path(tempfile.gettempdir()) / f"friction-rig-{os.getuid()}"
    if not utf8(here):
        raise BusError(
            f"the name of the directory of runs {printable(str(here))} is not UTF-8; "
            "set XDG_RUNTIME_DIR to a directory with another name"
        )
    try:
        here.mkdir(mode=0o700, parents=True, exist_ok=True)
        status = here.lstat()
    except OSError as fault:
        raise BusError(f"the directory of runs {here} cannot be created: {fault.strerror}") from None
    if not stat.S_ISDIR(status.st_mode) or status.st_uid != os.getuid():
        raise BusError(f"{here} does not belong to you; set XDG_RUNTIME_DIR to a directory of your own")
    if status.st_mode & 0o077:
        here.chmod(0o700)
    return here


def socket_endpoint(run: str) -> str:
    """The endpoint of a run's private unix socket. Raises BusError if its path is too long for the system."""
    path = directory() / f"{run}.sock"
    if len(os.fsencode(path)) > _LONGEST:
        raise BusError(
            f"the socket path {path} is longer than the {_LONGEST} bytes that the system allows; "
            "choose a shorter run name or set XDG_RUNTIME_DIR to a shorter directory"
        )
    return f"unixsock-stream/{path}"


@contextmanager
def _alone() -> Iterator[Path]:
    """The directory of runs, locked: no other process reserves or removes a run meanwhile."""
    here = directory()
    descriptor = os.open(here / "lock", os.O_RDWR | os.O_CREAT | os.O_CLOEXEC, 0o600)
    try:
        files.take(descriptor, wait=True)
        yield here
    finally:
        os.close(descriptor)


class Reservation:
    """The right to run under a name, until `release` or the end of the process.

    Other processes find the run only after `open`, which the plant calls when it listens at the address.
    """

    def __init__(self, path: Path, descriptor: int, address: RunAddress) -> None:
        self.address = address
        self._path = path
        self._descriptor = descriptor

    def open(self) -> None:
        """Make the run visible to other processes."""
        with _alone():
            os.pwrite(self._descriptor, json.dumps(asdict(self.address)).encode(), 0)

    def release(self) -> None:
        """Give the name back and remove the files of the run."""
        if self._descriptor >= 0:
            with _alone():
                _clear(self._path)
            os.close(self._descriptor)
            self._descriptor = -1


def check(run: str) -> None:
    """Raise BusError if a new run cannot have this name: it is malformed, too long, or taken."""
    if not _NAME.fullmatch(run):
        raise BusError(f"{run!r:.80} cannot name a run; use letters, digits, '_' and '-'")
    socket_endpoint(run)
    if is_live(run):
        raise BusError(f"a run called {run} is already live; choose another name")


def reserve(run: str | None = None, scene: str = "run", endpoint: str | None = None) -> Reservation:
    """Take a run name, or make one from the scene's name and the time.

    Raises BusError if the name is taken or malformed, or if others could reach the endpoint.
    """
    if endpoint is not None and not endpoint.startswith(_PRIVATE):
        raise BusError(
            f"{endpoint!r} would be reachable from other machines; give a unix socket or tcp/127.0.0.1:<port>"
        )
    if run is not None:
        check(run)
    stem = f"{re.sub(r'[^A-Za-z0-9_-]', '-', scene).strip('-') or 'run'}-{time.strftime('%Y%m%d-%H%M%S')}"
    for name in [run] if run is not None else [stem, *(f"{stem}-{number}" for number in range(2, 1000))]:
        if (taken := _try(name, scene, endpoint)) is not None:
            return taken
    if run is not None:
        raise BusError(f"a run called {run} is already live; choose another name")
    raise BusError(f"all run names {stem}, {stem}-2 to {stem}-999 are taken; choose a name")


def _try(run: str, scene: str, endpoint: str | None) -> Reservation | None:
    address = RunAddress(run, endpoint or socket_endpoint(run), os.getpid(), scene, time.time(), FINGERPRINT, _home())
    with _alone() as here:
        path = here / f"{run}.run"
        descriptor = os.open(path, os.O_RDWR | os.O_CREAT | os.O_CLOEXEC, 0o600)
        if not files.take(descriptor):
            os.close(descriptor)
            return None
        os.ftruncate(descriptor, 0)
    return Reservation(path, descriptor, address)


def _home() -> str:
    return os.path.expanduser("~")


def _clear(path: Path) -> None:
    listening = path.with_suffix(".sock")
    for leftover in (listening, listening.with_suffix(".sock.lock"), path):
        leftover.unlink(missing_ok=True)
    for inner in (".users", ".tickets"):
        shutil.rmtree(path.with_suffix(inner), ignore_errors=True)


def is_live(run: str) -> bool:
    """Whether the plant process of a run exists: it holds the lock of its file, even while it hangs."""
    try:
        descriptor = os.open(directory() / f"{run}.run", os.O_RDWR | os.O_CLOEXEC)
    except OSError:
        return False
    try:
        return not files.take(descriptor, shared=True)  # other processes may check at the same time
    finally:
        os.close(descriptor)


def list_runs() -> list[RunAddress]:
    """Live runs, newest first. Removes the files of dead runs."""
    live_runs = []
    with _alone() as here:
        for path in here.glob("*.run"):
            descriptor = os.open(path, os.O_RDWR | os.O_CLOEXEC)
            if files.take(descriptor):
                _clear(path)
            elif text := os.pread(descriptor, 1 << 16, 0):  # an empty file: reserved, but not open yet
                live_runs += _read(text)
            os.close(descriptor)
    return sorted(live_runs, key=lambda run: run.started, reverse=True)


def _read(text: bytes) -> list[RunAddress]:
    """The run in a file; none if another installation wrote it in another form."""
    try:
        address = RunAddress(**json.loads(text))
        return [address] if isinstance(address.started, float) and isinstance(address.endpoint, str) else []
    except (TypeError, ValueError, RecursionError):
        return []


def find(run: str | None = None, wait: float = 0.0) -> RunAddress:
    """A live run by name, or the only one of this home directory; waits at most `wait` seconds for it.

    Raises BusError, which lists the live runs, if there is none, or if without a name there are several.
    """
    deadline = time.monotonic() + wait
    while True:
        runs = list_runs()
        candidates = [address for address in runs if (address.home == _home() if run is None else address.run == run)]
        if len(candidates) == 1:
            return candidates[0]
        if candidates or time.monotonic() >= deadline:
            break
        time.sleep(0.05)
    named = ", ".join(address.run for address in candidates or runs)
    if candidates:
        raise BusError(f"several runs are live: {named}; name one with --run")
    if runs and run is None:
        homes = ", ".join(dict.fromkeys(address.home or "another version" for address in runs))
        raise BusError(f"no run of this home directory is live; others are: {named} (of {homes}); name one with --run")
    live = f"live runs: {named}" if runs else "no run is live; start one with `rig run`"
    raise BusError(live if run is None else f"no run is called {run}; {live}")
