"""Commands that the page starts beside a run, such as the check of a recording: processes that can be stopped."""

from __future__ import annotations

import shutil
import signal
import tempfile
import threading
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

from rig.errors import UsageError
from rig.machine.process import Child, end

MOST = 3
"""Largest number of jobs that work at a time."""
KEPT = 20
"""Number of finished jobs whose results are kept."""
LINES = 200
"""Number of lines of output of a job that are kept. # chosen"""

Numbers = Callable[[int, Any], list[dict[str, Any]]]
"""Exit code and report of a command (`--json`, None without one) -> numbers of it, for the page."""


class Job:
    """One command of `rig`; `result`: the file or the folder that it writes, if any; `folder`: where it runs.

    When it has ended, `numbers` gets its exit code and its report, and gives what is told of them.
    """

    def __init__(
        self,
        number: int,
        title: str,
        arguments: Sequence[str],
        result: Path | None,
        folder: Path | None,
        numbers: Numbers | None,
    ) -> None:
        self.number = number
        self.title = title
        self.command = arguments[0]
        self.result = result
        self._lines: list[str] = []
        self._stopped = False
        self._numbers = numbers
        self._report: Any = None
        self.child = Child(title, ["rig.web.job_process", *arguments], folder=folder)

    def stop(self) -> None:
        """Ask the process to stop, as Ctrl-C does."""
        self._stopped = True
        self.child.send(signal.SIGINT)

    def file(self) -> Path:
        """The result as one file; of a folder an archive (ZIP). Raises UsageError if there is none."""
        if self.working or self.result is None or not self.result.exists():
            raise UsageError(f"{self.title} has no result")
        if self.result.is_dir():
            return Path(shutil.make_archive(str(self.result), "zip", self.result))
        return self.result

    @property
    def working(self) -> bool:
        """Whether the process runs."""
        return self.child.code is None

    def to_json(self) -> dict[str, Any]:
        """Number, title, command, state, exit code, lines of output, kind of file of the result ("" without one).

        `numbers`: what is told of the report when it has ended.
        """
        code = self.child.code
        if code is not None:
            self.child.wait(0.1)  # its last lines
        self._lines = [*self._lines, *self.child.new_lines()][-LINES:]
        self._report = dict(self.child.new_words()).get("report", self._report)
        numbers: list[dict[str, Any]] = []
        if self._numbers is not None and code is not None:
            numbers = self._numbers(code, self._report)
        return {
            "number": self.number,
            "title": self.title,
            "command": self.command,
            "state": self._state(code),
            "code": code,
            "lines": self._lines,
            "result": self._kind(code),
            "numbers": numbers,
        }

    def _state(self, code: int | None) -> str:
        if code is None:
            return "working"
        return "stopped" if self._stopped else "done"

    def _kind(self, code: int | None) -> str:
        """Kind of file of the result; "" while there is none."""
        if code is None or self.result is None or not self.result.exists():
            return ""
        return self.result.suffix or ".zip"


class Jobs:
    """The jobs of the page. Their results are in a folder of their own, which `close` removes."""

    def __init__(self) -> None:
        self._folder: tempfile.TemporaryDirectory[str] | None = None
        self._jobs: dict[int, Job] = {}
        self._lock = threading.Lock()
        self._number = 0

    def folder(self) -> Path:
        """A new folder for the result of a job."""
        if self._folder is None:  # a server that is killed cannot remove it: only those that need it make it
            self._folder = tempfile.TemporaryDirectory(prefix="friction-rig-web-")
        return Path(tempfile.mkdtemp(dir=self._folder.name))

    def start(
        self,
        title: str,
        arguments: Sequence[str],
        result: Path | None = None,
        folder: Path | None = None,
        numbers: Numbers | None = None,
    ) -> dict[str, Any]:
        """Start `rig` with these arguments. Raises UsageError while `MOST` jobs work."""
        with self._lock:
            if sum(job.working for job in self._jobs.values()) >= MOST:
                raise UsageError(f"{MOST} jobs are working; wait for one of them, or stop it")
            finished = sorted(number for number, job in self._jobs.items() if not job.working)
            for number in finished[:-KEPT]:
                del self._jobs[number]
            self._number += 1
            self._jobs[self._number] = Job(self._number, title, arguments, result, folder, numbers)
            return self._jobs[self._number].to_json()

    def all(self) -> list[dict[str, Any]]:
        """All jobs, the newest first."""
        with self._lock:
            return [job.to_json() for job in reversed(self._jobs.values())]

    def job(self, number: Any) -> Job:
        """The job with this number. Raises UsageError."""
        if isinstance(number, bool) or not isinstance(number, int) or number not in self._jobs:
            raise UsageError(f"there is no job {number!r:.20} (any more); start it again")
        return self._jobs[number]

    def close(self) -> None:
        """End all jobs and remove their results."""
        end([job.child for job in self._jobs.values()], 0.0)
        if self._folder is not None:
            self._folder.cleanup()
