"""The target of a view: rerun's viewer in its own process, a viewer that already runs, or a file.

Each view opens its own window, on a free port of the loopback device. The window stays open after the run and the
viewer process have ended, and the user closes it. A browser page needs a server, which nobody would see and close.
Therefore the server ends with the process that started it; a loaded page keeps what it shows.
"""

from __future__ import annotations

import os
import re
import socket
import subprocess
import sys
import tempfile
import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import IO, TYPE_CHECKING
from urllib.parse import quote
from uuid import uuid4

from rig.errors import OutputError, UsageError
from rig.view.blueprint import blueprint
from rig.view.drawing import Drawing

if TYPE_CHECKING:
    import rerun as rr

_OPENING_S = 15.0
_LEAVING_S = 0.5
_WRITTEN_S = 2.0  # longest wait for the end of a file; a file has no reader that could block it
_SETTLED_S = 0.4  # time for which a viewer must run after it listens: without a display it ends within a tenth of this
OPEN_TO = (
    "any user of this machine can look at this page while it is served; the page itself asks fonts.googleapis.com, "
    "api.github.com, tel.rerun.io and app.rerun.io for fonts, versions, statistics and examples"
)
"""A warning for users of the page: it needs no password, and rerun's page contacts other servers."""
_MEMORY = "2GB"
_SERVED = "256MB"
_BOUND = """import ctypes, os, sys
ctypes.CDLL(None).prctl(1, 15)
if os.getppid() == int(sys.argv[1]):
    os.execv(sys.argv[2], sys.argv[2:])"""
"""Becomes the program of its second argument, which gets SIGTERM when the process of the first one ends in any way."""


class Viewer:
    """A viewer at `url`, as a process; `page`: address for a browser, "" for a window."""

    def __init__(self, url: str, page: str, process: subprocess.Popen[bytes]) -> None:
        self.url = url
        self.page = page
        self.process = process

    @property
    def alive(self) -> bool:
        """Whether the viewer still runs."""
        return self.process.poll() is None

    def stop(self) -> None:
        """End the viewer."""
        self.process.terminate()
        try:
            self.process.wait(1.0)
        except subprocess.TimeoutExpired:
            self.process.kill()
            self.process.wait()


def binary() -> Path:
    """Path of the viewer program, not of its Python wrapper, which would leave the viewer running when killed."""
    import rerun_cli

    return Path(str(rerun_cli.__file__)).parent / ("rerun.exe" if os.name == "nt" else "rerun")


def start(web: bool = False) -> Viewer:
    """Start a viewer: a window, or a server for a browser page (`web`).

    Raises UsageError if it does not open, e.g. on a machine without a display.
    """
    port = free_port()
    command = [str(binary()), "--bind", "127.0.0.1", "--port", str(port), "--memory-limit", _MEMORY]
    page = ""
    url = f"rerun+http://127.0.0.1:{port}/proxy"
    if web:
        page_port = free_port()
        page = f"http://127.0.0.1:{page_port}/?theme=dark&url={quote(url, safe='')}"  # the colours need it
        command += ["--serve-web", "--web-viewer-port", str(page_port), "--server-memory-limit", _SERVED]
    else:
        command.append("--hide-welcome-screen")
    if web and sys.platform == "linux":
        command = [sys.executable, "-ISc", _BOUND, str(os.getpid()), *command]
    environment = {**os.environ, "CI": "true"}  # with CI rerun sends no usage statistics
    with tempfile.TemporaryFile() as output:
        try:
            process = subprocess.Popen(
                command,
                stdin=subprocess.DEVNULL,
                stdout=subprocess.DEVNULL,
                stderr=output,
                start_new_session=True,  # so that Ctrl-C does not end the window
                env=environment,
            )
        except OSError as fault:
            raise UsageError(f"the viewer {binary()} cannot be started: {fault.strerror}") from None
        viewer = Viewer(url, page, process)
        try:
            _wait_until_open(viewer, port, output)
        except BaseException:
            viewer.stop()
            raise
    return viewer


def _wait_until_open(viewer: Viewer, port: int, output: IO[bytes]) -> None:
    deadline = time.monotonic() + _OPENING_S
    opened = 0.0
    while not opened or time.monotonic() < opened + _SETTLED_S:
        if not viewer.alive:
            output.seek(0)
            lines = output.read().decode(errors="replace").splitlines()
            last = next((line for line in reversed(lines) if line), "")
            reason = "there is no display" if "DISPLAY" in last else last
            raise UsageError(f"the viewer's window could not be opened: {reason}; try --web for a browser page")
        if time.monotonic() > deadline:
            raise UsageError(f"the viewer did not open within {_OPENING_S:g} s; the machine may be too busy: try again")
        if not opened:
            with suppress(OSError), socket.create_connection(("127.0.0.1", port), 0.2):
                opened = time.monotonic()
        time.sleep(0.03)


def free_port() -> int:
    """A free port of the loopback device."""
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        return int(probe.getsockname()[1])


@contextmanager
def sink(
    name: str,
    drawing: Drawing,
    *,
    until: float | None,
    save: Path | str | None = None,
    web: bool = False,
) -> Iterator[tuple[rr.RecordingStream, Viewer | None]]:
    """Open a recording stream of rerun called `name`, with the window arranged; yields it and the viewer.

    `until` is the end of a recording [s], None for a live run. `save` writes a file (.rrd), which `rerun FILE` shows;
    the viewer is None then. Raises OutputError if the file cannot be written, UsageError if the viewer does not open.
    """
    import rerun as rr

    described = blueprint(drawing, until)
    plant = re.sub(r"[^A-Za-z0-9_-]", "-", Path(drawing.plant).stem)  # rerun warns of other letters in a name
    rec = rr.RecordingStream(f"friction-rig {plant}", recording_id=str(uuid4()))
    viewer: Viewer | None = None
    if save is not None:
        target = Path(save)
        try:
            target.parent.mkdir(parents=True, exist_ok=True)
            target.touch()
        except OSError as fault:
            raise OutputError(f"{target} cannot be written: {fault.strerror}") from None
        try:
            rec.save(target, default_blueprint=described)
        except Exception as fault:  # rerun's own kinds
            raise OutputError(f"{target} cannot be written ({fault})") from None
    else:
        viewer = start(web)
        rec.connect_grpc(viewer.url, default_blueprint=described)
        rec.send_blueprint(described, make_active=True, make_default=True)
    try:
        rec.send_recording_name(name)
        yield rec, viewer
    finally:
        _leave(rec, _LEAVING_S if save is None else _WRITTEN_S)
        if viewer is not None and web:
            viewer.stop()


def _leave(rec: rr.RecordingStream, patience: float) -> None:
    """Send the remaining data and close, within `patience` [s]: a viewer that hangs would block it for ever."""
    import rerun as rr

    rr.unregister_shutdown()
    leaving = threading.Thread(target=rec.disconnect, name="rerun-leaves", daemon=True)
    leaving.start()
    leaving.join(patience)
