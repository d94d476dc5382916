"""Child processes: started, observed, and ended by process id, in steps of bounded duration."""

from __future__ import annotations

import os
import queue
import signal
import subprocess
import sys
import threading
import time
from collections.abc import Iterable, Sequence
from contextlib import suppress
from pathlib import Path

_ROOT = Path(__file__).resolve().parents[1]
_KEPT = 50
STEPS = ((signal.SIGINT, 5.0), (signal.SIGTERM, 2.0), (getattr(signal, "SIGKILL", signal.SIGTERM), 2.0))
"""Signals that end a process, in order, and how long to wait after each [s]."""


class Child:
    """A process `python -P -m ...` in a session of its own, so that Ctrl-C in the terminal reaches only its parent.

    A file of the working folder does not hide a module of this name (-P): there may be a rig.py or a queue.py.

    Its output on stdout and stderr is kept line by line: new lines in `lines`, the last ones in `tail`. `heard` is set
    with each line and when the output ends. With `fed` the process reads what `feed` writes. What follows `mark` in
    a line is a message to this process, which is no output and not kept in `tail`.
    """

    def __init__(
        self,
        name: str,
        arguments: Sequence[str],
        heard: threading.Event | None = None,
        fed: bool = False,
        mark: str = "",
    ) -> None:
        self.name = name
        self._heard, self._mark = heard or threading.Event(), mark
        self.lines: queue.SimpleQueue[str] = queue.SimpleQueue()
        self.tail: list[str] = []
        path = os.pathsep.join(filter(None, (str(_ROOT), os.environ.get("PYTHONPATH", ""))))
        self.process = subprocess.Popen(
            [sys.executable, "-P", "-m", *arguments],
            stdin=subprocess.PIPE if fed else subprocess.DEVNULL,
            stdout=subprocess.PIPE,
            stderr=subprocess.STDOUT,
            text=True,
            start_new_session=True,
            env={**os.environ, "PYTHONPATH": path},
        )
        self._reader = threading.Thread(target=self._read, name=f"read-{name}", daemon=True)
        self._reader.start()

    def _read(self) -> None:
        stream = self.process.stdout
        assert stream is not None
        with stream:
            for text in stream:
                said = text.partition(self._mark)[0] if self._mark else text
                self.tail = [*self.tail[-_KEPT:], said.rstrip()]
                self.lines.put(text.rstrip())
                self._heard.set()
        self._heard.set()

    def feed(self, line: str) -> None:
        """Write a line to the standard input of the process, unless it has ended."""
        assert self.process.stdin is not None
        with suppress(OSError):
            self.process.stdin.write(f"{line}\n")
            self.process.stdin.flush()

    def dismiss(self) -> None:
        """Close the standard input of the process: nothing more will come."""
        if self.process.stdin is not None:
            with suppress(OSError):
                self.process.stdin.close()

    def new_lines(self) -> list[str]:
        """Lines of output since the last call."""
        found = []
        while not self.lines.empty():
            found.append(self.lines.get())
        return found

    @property
    def code(self) -> int | None:
        """Exit code; None while the process runs; minus the signal number if a signal killed it."""
        return self.process.poll()

    @property
    def ending(self) -> str:
        """How the process ended, as a sentence with its last line of output."""
        code = self.code
        if code is not None and code < 0:
            return f"{self.name} was killed by {signal.Signals(-code).name}"
        last = next((f": {text}" for text in reversed(self.tail) if text), "")
        return f"{self.name} ended with code {code}{last}"

    def send(self, number: signal.Signals) -> None:
        """Send a signal to the process if it still runs."""
        if self.code is None:
            self.process.send_signal(number)

    def wait(self, seconds: float) -> bool:
        """Wait at most `seconds`; whether the process has ended."""
        try:
            self.process.wait(seconds)
        except subprocess.TimeoutExpired:
            return False
        self._reader.join(1.0)
        return True


def end(children: Iterable[Child], patience: float) -> list[str]:
    """Wait `patience` [s] for the children to end, then end them by `STEPS`.

    Returns the names of those that needed the last signal.
    """
    left = list(children)
    for number, span in ((None, patience), *STEPS):
        for child in left:
            if number is not None:
                child.send(number)
        deadline = time.monotonic() + span
        left = [child for child in left if not child.wait(max(deadline - time.monotonic(), 0.0))]
        if not left:
            return []
        killed = [child.name for child in left]
    return killed
