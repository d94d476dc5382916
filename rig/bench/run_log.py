"""The messages of the last live run, kept for a bug report: at most `MOST` lines in the user's state folder."""

from __future__ import annotations

from collections import deque
from collections.abc import Callable
from contextlib import suppress
from pathlib import Path

import platformdirs

MOST, LONGEST = 2000, 1000
"""Most lines that are kept, the latest ones, and most characters of a line."""


def path() -> Path:
    """The file with the messages of the last run; it may not exist."""
    return platformdirs.user_state_path("friction-rig") / "last_run.log"


class RunLog:
    """Passes the lines of a run on to `say` and keeps them; in the file `private` names are replaced."""

    def __init__(self, say: Callable[[str], object], private: dict[str, str]) -> None:
        self._say, self._private = say, private
        self._lines: deque[str] = deque(maxlen=MOST)

    def say(self, text: str) -> None:
        """Show a line, and keep it."""
        self.add(text)
        self._say(text)

    def add(self, text: str) -> None:
        """Keep text without showing it."""
        self._lines.extend(line[:LONGEST] for line in text.splitlines())

    def write(self) -> None:
        """Replace the file of the run before. If the folder cannot be written, only the log is lost."""
        text = "".join(f"{line}\n" for line in self._lines)
        for name, instead in self._private.items():
            text = text.replace(name, instead)
        with suppress(OSError):
            path().parent.mkdir(parents=True, exist_ok=True)
            path().write_text(text)
