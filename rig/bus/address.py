"""Where runs are found: a private directory with one file and one socket for each live run.

The file of a run is locked for as long as its plant lives: the kernel gives the lock back even when the plant is
killed, so a file without a lock is what a dead plant left behind, and is removed by whoever notices.
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

from rig import file_locks
from rig.bus.messages import FINGERPRINT
from rig.errors import BusError

_LONGEST = 107 if sys.platform == "linux" else 103
_PRIVATE = ("unixsock-stream/", "tcp/127.0.0.1:", "tcp/[::1]:", "tcp/localhost:")
_NAME = re.compile(r"[A-Za-z0-9][A-Za-z0-9_-]*")


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
    """Fingerprint of its messages: `rig.bus.messages.FINGERPRINT`."""


def directory() -> Path:
    """The directory of live runs, readable by this user only; raises BusError if someone else has a hand in it."""
    if not (file_locks.KNOWN and hasattr(socket, "AF_UNIX")):
        raise BusError(
            "live runs need locks of files and unix sockets, which this system has not; "
            "rig simulate, studies and figures work here"
        )
    base = os.environ.get("XDG_RUNTIME_DIR")
    here = Path(base) / "friction-rig" if base else Path(tempfile.gettempdir()) / f"friction-rig-{os.getuid()}"
    try:
        here.mkdir(mode=0o700, parents=True, exist_ok=True)
        found = here.lstat()
    except OSError as fault:
        raise BusError(f"the directory of runs {here} cannot be made: {fault.strerror}") from None
    if not stat.S_ISDIR(found.st_mode) or found.st_uid != os.getuid():
        raise BusError(f"{here} does not belong to you; set XDG_RUNTIME_DIR to a directory of your own")
    if found.st_mode & 0o077:
        here.chmod(0o700)
    return here


def socket_endpoint(run: str) -> str:
    """The private unix socket of a run."""
    path = directory() / f"{run}.sock"
    if len(os.fsencode(path)) > _LONGEST:
        raise BusError(
            f"the socket path {path} is longer than the {_LONGEST} bytes that the system allows; "
            "choose a shorter run name or set XDG_RUNTIME_DIR to a shorter directory"
        )
    return f"unixsock-stream/{path}"


@contextmanager
def _alone() -> Iterator[Path]:
    """The directory of runs, with nobody else claiming or clearing in it meanwhile."""
    here = directory()
    descriptor = os.open(here / "lock", os.O_RDWR | os.O_CREAT | os.O_CLOEXEC, 0o600)
    try:
        file_locks.take(descriptor, wait=True)
        yield here
    finally:
        os.close(descriptor)


class Claim:
    """The right to run under a name; held until `release` or the end of the process.

    Others find the run once it is open: not before somebody listens at its address.
    """

    def __init__(self, path: Path, descriptor: int, address: RunAddress) -> None:
        self.address = address
        self._path, self._descriptor = path, descriptor

    def open(self) -> None:
        """Let others find the run."""
        with _alone():
            os.pwrite(self._descriptor, json.dumps(asdict(self.address)).encode(), 0)

    def release(self) -> None:
        """Give the name back and clear away what stood for it."""
        if self._descriptor >= 0:
            with _alone():
                _clear(self._path)
            os.close(self._descriptor)
            self._descriptor = -1


def claim(run: str | None = None, scene: str = "run", endpoint: str | None = None) -> Claim:
    """Take a run name, or make one from the scene's name and the time; raises BusError if it is taken."""
    if endpoint is not None and not endpoint.startswith(_PRIVATE):
        raise BusError(f"{endpoint!r} would be open to others; give a unix socket or tcp/127.0.0.1:<port>")
    if run is not None:
        if not _NAME.fullmatch(run):
            raise BusError(f"{run!r} cannot name a run; use letters, digits, '_' and '-'")
        taken = _try(run, scene, endpoint)
        if taken is None:
            raise BusError(f"a run called {run} is going on already; choose another name")
        return taken
    stem = f"{re.sub(r'[^A-Za-z0-9_-]', '-', scene).strip('-') or 'run'}-{time.strftime('%Y%m%d-%H%M%S')}"
    for number in range(1, 1000):
        if (taken := _try(stem if number == 1 else f"{stem}-{number}", scene, endpoint)) is not None:
            return taken
    raise BusError(f"no free run name like {stem}")


def _try(run: str, scene: str, endpoint: str | None) -> Claim | None:
    address = RunAddress(run, endpoint or socket_endpoint(run), os.getpid(), scene, time.time(), FINGERPRINT)
    with _alone() as here:
        path = here / f"{run}.run"
        descriptor = os.open(path, os.O_RDWR | os.O_CREAT | os.O_CLOEXEC, 0o600)
        if not file_locks.take(descriptor):
            os.close(descriptor)
            return None
        os.ftruncate(descriptor, 0)
    return Claim(path, descriptor, address)


def _clear(path: Path) -> None:
    listening = path.with_suffix(".sock")
    for leftover in (listening, listening.with_suffix(".sock.lock"), path):
        leftover.unlink(missing_ok=True)
    shutil.rmtree(path.with_suffix(".users"), ignore_errors=True)


def is_live(run: str) -> bool:
    """Whether the plant of a run lives: it holds the lock of its file, also while it hangs."""
    try:
        descriptor = os.open(directory() / f"{run}.run", os.O_RDWR | os.O_CLOEXEC)
    except OSError:
        return False
    try:
        return not file_locks.take(descriptor, shared=True)  # others may look at the same time
    finally:
        os.close(descriptor)


def list_runs() -> list[RunAddress]:
    """Live runs, newest first; what dead ones left behind is cleared away."""
    found = []
    with _alone() as here:
        for path in here.glob("*.run"):
            descriptor = os.open(path, os.O_RDWR | os.O_CLOEXEC)
            if file_locks.take(descriptor):
                _clear(path)
            elif text := os.pread(descriptor, 1 << 16, 0):  # empty: claimed, but not open yet
                found += _read(text)
            os.close(descriptor)
    return sorted(found, key=lambda run: run.started, reverse=True)


def _read(text: bytes) -> list[RunAddress]:
    """The run of a file; none where another installation has written it otherwise."""
    try:
        address = RunAddress(**json.loads(text))
        return [address] if isinstance(address.started, float) and isinstance(address.endpoint, str) else []
    except (TypeError, ValueError, RecursionError):
        return []


def find(run: str | None = None, wait: float = 0.0) -> RunAddress:
    """A live run by name, or the newest; waits at most `wait` seconds for it. Raises BusError with those there are."""
    deadline = time.monotonic() + wait
    while True:
        runs = list_runs()
        for candidate in runs:
            if run in (None, candidate.run):
                return candidate
        if time.monotonic() >= deadline:
            break
        time.sleep(0.05)
    live = f"going on now: {', '.join(r.run for r in runs)}" if runs else "no run is going on; start one with `rig run`"
    raise BusError(live if run is None else f"no run is called {run}; {live}")
