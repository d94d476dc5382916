"""Child processes: started, observed, and ended by process id, in steps of bounded duration.

What a child prints may come from a user's code: it is text to show and nothing else. What the child itself has to tell
(`rig.process.tell`) comes over a pipe of its own.
"""

from __future__ import annotations

import codecs
import io
import json
import os
import signal
import subprocess
import sys
import threading
import time
from collections import deque
from collections.abc import Iterable, Sequence
from contextlib import suppress
from pathlib import Path
from typing import Any

from rig.process import PARENT

_ROOT = Path(__file__).resolve().parents[1]
_KEPT, _WAITING = 50, 1000
"""Lines of output that are kept at the end, and that wait to be shown; of more, the oldest are left out."""
LONGEST = 2000
"""Longest line of output [characters]; longer ones, such as dots without an end of line, are several lines."""
STEPS = ((signal.SIGINT, 5.0), (signal.SIGTERM, 2.0), (getattr(signal, "SIGKILL", signal.SIGTERM), 2.0))
"""Signals that end a process, in order, and how long to wait after each [s]."""


class Child:
    """A process `python -P -m ...` in a session of its own, so that Ctrl-C in the terminal reaches only its parent.

    A file of the working folder does not hide a module of this name (-P): there may be a rig.py or a queue.py.

    Its output on stdout and stderr is kept line by line: new lines for `new_lines`, the last ones in `tail`. What it
    tells with `rig.process.tell` waits for `new_words`; `fault` is why it ends, if it told that. `heard` is set with
    each line or word and when they end. With `fed` the process reads what `feed` writes.
    """

    def __init__(
        self, name: str, arguments: Sequence[str], heard: threading.Event | None = None, fed: bool = False
    ) -> None:
        self.name = name
        self._heard = heard or threading.Event()
        self._lines: deque[str] = deque()
        self._left_out = 0
        self._words: deque[tuple[str, Any]] = deque()
        self.tail: list[str] = []
        self.fault = ""
        path = os.pathsep.join(filter(None, (str(_ROOT), os.environ.get("PYTHONPATH", ""))))
        words, theirs = os.pipe()
        try:
            number, inherited = _inherited(theirs)
            self.process = subprocess.Popen(
                [sys.executable, "-P", "-m", *arguments],
                stdin=subprocess.PIPE if fed else subprocess.DEVNULL,
                stdout=subprocess.PIPE,
                stderr=subprocess.STDOUT,
                start_new_session=True,
                env={**os.environ, "PYTHONPATH": path, PARENT: str(number)},
                **inherited,
            )
        except BaseException:
            os.close(words)
            raise
        finally:
            os.close(theirs)
        self._readers = [
            threading.Thread(target=self._read, name=f"read-{name}", daemon=True),
            threading.Thread(target=self._listen, args=(words,), name=f"words-{name}", daemon=True),
        ]
        for reader in self._readers:
            reader.start()

    def _read(self) -> None:
        stream = self.process.stdout
        assert isinstance(stream, io.BufferedReader)
        decoder = io.IncrementalNewlineDecoder(codecs.getincrementaldecoder("utf-8")("replace"), translate=True)
        rest = ""
        with stream:
            while read := stream.read1():
                *lines, rest = (rest + decoder.decode(read)).split("\n")
                for line in lines:
                    self._keep(line)
                while len(rest) > LONGEST:
                    self._keep(rest[:LONGEST])
                    rest = rest[LONGEST:]
        if rest := rest + decoder.decode(b"", True):
            self._keep(rest)
        self._heard.set()

    def _keep(self, line: str) -> None:
        line = line.rstrip()
        self.tail = [*self.tail[-_KEPT:], line[:LONGEST]]
        self._lines.extend(line[first : first + LONGEST] for first in range(0, max(len(line), 1), LONGEST))
        while len(self._lines) > _WAITING:
            self._lines.popleft()
            self._left_out += 1
        self._heard.set()

    def _listen(self, words: int) -> None:
        with open(words, encoding="utf-8") as stream:
            for line in stream:
                with suppress(ValueError):  # of a process that was killed while it told something
                    kind, value = json.loads(line)
                    if kind == "fault":
                        self.fault = value
                    else:
                        self._words.append((kind, value))
                    self._heard.set()
        self._heard.set()

    def feed(self, line: str) -> None:
        """Write a line to the standard input of the process, unless it has ended."""
        assert self.process.stdin is not None
        with suppress(OSError):
            self.process.stdin.write(f"{line}\n".encode())
            self.process.stdin.flush()

    def dismiss(self) -> None:
        """Close the standard input of the process: nothing more will come."""
        if self.process.stdin is not None:
            with suppress(OSError):
                self.process.stdin.close()

    def new_lines(self, most: int = _WAITING) -> list[str]:
        """Lines of output since the last call: the latest `most`, before them a line that counts those left out."""
        lines = [self._lines.popleft() for _ in range(len(self._lines))]
        left_out, self._left_out = self._left_out + max(len(lines) - most, 0), 0
        return [f"({left_out} lines left out)", *lines[-most:]] if left_out else lines

    def new_words(self) -> list[tuple[str, Any]]:
        """What the process has told since the last call: kind, value."""
        return [self._words.popleft() for _ in range(len(self._words))]

    @property
    def code(self) -> int | None:
        """Exit code; None while the process runs; minus the signal number if a signal killed it."""
        return self.process.poll()

    @property
    def ending(self) -> str:
        """How the process ended, as a sentence with the fault that it told, else with its last line of output."""
        code = self.code
        if code is not None and code < 0:
            return f"{self.name} was killed by {signal.Signals(-code).name}"
        why = self.fault or next((text for text in reversed(self.tail) if text), "")
        return f"{self.name} ended with code {code}{f': {why}' if why else ''}"

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
        for reader in self._readers:  # what it has started may keep its output open
            reader.join(1.0)
        return True


def _inherited(descriptor: int) -> tuple[int, dict[str, Any]]:
    """The number under which a new process finds an open file, and the options of `Popen` that give it to it."""
    if sys.platform != "win32":
        return descriptor, {"pass_fds": [descriptor]}
    import msvcrt

    handle = msvcrt.get_osfhandle(descriptor)
    os.set_handle_inheritable(handle, True)
    return handle, {"close_fds": False}


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
