"""A compiled controller in a helper process: if it crashes or hangs, only the controller is lost.

One helper serves all controllers of a library in this process, since a library keeps no state of its own.
"""

from __future__ import annotations

import os
import signal
import socket
import subprocess
import sys
import weakref
from collections.abc import Sequence
from typing import Any

from rig.controllers.runtime import c_library
from rig.errors import ControllerLost, PartError
from rig.parts import Binary

LONGEST_S = 2.0
"""Longest time of a step [s]. # chosen"""
_LOAD_S = 20.0
HELPERS: dict[str, LibraryProcess] = {}
"""SHA-256 -> helper."""


class LibraryProcess:
    """The compiled controller `binary` in a process of its own. Raises PartError if it cannot be used."""

    def __init__(self, binary: Binary) -> None:
        self._binary = binary
        if os.name != "posix":
            raise PartError(f"{binary}: a library is called through a helper process, which needs Linux or macOS")
        with binary.unpacked() as path:
            self._link, theirs = socket.socketpair()
            command = [sys.executable, "-I", "-S", c_library.__file__, str(path), str(theirs.fileno())]
            self._process = subprocess.Popen(
                command, pass_fds=[theirs.fileno()], stdin=subprocess.DEVNULL, stdout=2, start_new_session=True
            )  # what the library prints must not get into a report
            theirs.close()
            self._end = weakref.finalize(self, _end, self._process, self._link)
            self._link.settimeout(_LOAD_S)
            try:
                report = c_library.start_report(self._link)
            except TimeoutError:
                raise PartError(f"{binary}: was not loaded within {_LOAD_S:g} s") from None
        if "about" not in report:
            raise PartError(f"{binary}: {report.get('fault') or self._ending('while it was loaded')}")
        self.about: dict[str, Any] = report["about"]
        self._link.settimeout(LONGEST_S)
        self._request, self._answer = c_library.formats(self.about)
        self._states = self.about["states"]
        self._nothing = (0.0,) * (self._states + len(self.about["inputs"]))

    @property
    def pid(self) -> int:
        """Process id of the helper."""
        return self._process.pid

    @property
    def lives(self) -> bool:
        """Whether it can be asked."""
        return self._end.alive and self._process.poll() is None

    def init(self, parameters: Sequence[float]) -> tuple[int, list[float]]:
        """See `Library.init`. Raises ControllerLost if the helper has ended or does not answer."""
        request = self._request.pack(c_library.INIT, 0, *parameters, *self._nothing)
        code, *numbers = self._asked(request, "in init")
        return code, numbers[: self._states]

    def step(
        self, parameters: Sequence[float], state: Sequence[float], t_ns: int, values: Sequence[float]
    ) -> tuple[int, list[float], list[float]]:
        """See `Library.step`. Raises ControllerLost if the helper has ended or does not answer."""
        request = self._request.pack(c_library.STEP, t_ns, *parameters, *state, *values)
        code, *numbers = self._asked(request, "in step")
        return code, numbers[: self._states], numbers[self._states :]

    def _asked(self, request: bytes, when: str) -> tuple[Any, ...]:
        try:
            self._link.sendall(request)
            raw = c_library.received(self._link, self._answer.size)
        except OSError:
            raw = b""
        except BaseException:  # Ctrl-C: the answer to this request must not be taken for that to the next one
            self._end()
            raise
        if not raw:
            raise ControllerLost(f"{self._binary}: {self._ending(when)}")
        return self._answer.unpack(raw)

    def _ending(self, when: str) -> str:
        """How the helper ended, in words; one that hangs is ended."""
        try:
            code = self._process.wait(0.2)
        except subprocess.TimeoutExpired:
            self._end()
            return f"its helper process was ended: no answer within {LONGEST_S:g} s {when}"
        self._end()
        if code >= 0:
            return f"its helper process ended with code {code} {when}"
        return f"its helper process was ended by signal {-code} ({signal.Signals(-code).name}) {when}"


def _end(process: subprocess.Popen[bytes], link: socket.socket) -> None:
    link.close()
    try:
        process.wait(0.0)
    except subprocess.TimeoutExpired:
        process.kill()
        process.wait()


def helper(binary: Binary) -> LibraryProcess:
    """The helper of a library in this process, started if there is none."""
    library = HELPERS.get(binary.sha256)
    if library is None or not library.lives:
        library = HELPERS[binary.sha256] = LibraryProcess(binary)
    return library
