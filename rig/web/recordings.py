"""The recordings of a folder on the page, with the jobs that check, report, export, compare, view and continue them."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from rig.errors import UsageError
from rig.record.contents import SUFFIX
from rig.record.run_list import runs
from rig.web.form import as_text
from rig.web.jobs import Jobs

OF_RECORDINGS = ("verify", "report", "csv", "compare", "view", "spectrum", "sound", "continue")
"""The jobs of a recording."""
_OF_CONTENTS = ("scene", "title", "seconds", "timing", "run")
"""What the list shows of the contents of a file that can be read."""


class Recordings:
    """The recordings in `folder`, and what `jobs` do with them."""

    def __init__(self, folder: Path, jobs: Jobs) -> None:
        self._folder = folder
        self._jobs = jobs

    def all(self) -> list[dict[str, Any]]:
        """Name, scene, time, length, timing verdict, size and notes of each recording, the newest first."""
        if not self._folder.is_dir():
            return []
        rows = []
        for entry in reversed(runs(self._folder)):
            row: dict[str, Any] = {"name": entry.path.relative_to(self._folder).as_posix(), "bytes": entry.size}
            row["fault"] = entry.fault
            row["notes"] = [str(note) for note in entry.notes.entries]
            contents = entry.contents
            if contents is not None:
                row |= {name: getattr(contents, name) for name in _OF_CONTENTS}
                row["began"] = contents.began_ns / 1e9
            rows.append(row)
        return rows

    def path(self, name: Any) -> Path:
        """The file of a recording of the list. Raises UsageError for anything else."""
        if isinstance(name, str) and name.endswith(SUFFIX) and "\0" not in name:
            path = self._folder / name
            if path.is_file() and path.resolve().is_relative_to(self._folder.resolve()):
                return path
        raise UsageError(f"no recording is called {name!r:.80}; the list of the page shows them all")

    def work(self, body: dict[str, Any]) -> dict[str, Any]:
        """Start a job: `what` (`OF_RECORDINGS`), `name`, for compare `other`, for continue `at` [s] and `changes`.

        Raises UsageError.
        """
        what = body.get("what")
        path = self.path(body.get("name"))
        if what not in OF_RECORDINGS:
            raise UsageError(f"{what!r:.80}: expected {', '.join(OF_RECORDINGS)}")
        if what == "continue":
            return self._continue(path, body)
        if what == "compare":
            return self._compare(path, self.path(body.get("other")))
        file = str(path)
        match what:
            case "verify":
                return self._jobs.start(f"verify {path.name}", ["verify", file])
            case "view":
                return self._jobs.start(f"view {path.name}", ["view", file, "--web"])
            case "report":
                return self._write(f"report of {path.name}", ["report", file], "--out", "report.html")
            case "csv":
                command = ["export", file, "--to", "csv"]
                return self._write(f"tables of {path.name}", command, "--out", f"{path.stem}-csv")
            case "spectrum":
                command = ["analyse", "spectrum", file]
                return self._write(f"spectrum of {path.name}", command, "--figure", "spectrum.png")
            case _:
                return self._write(f"sound of {path.name}", ["analyse", "sound", file], "--out", "sound.wav")

    def _continue(self, path: Path, body: Mapping[str, Any]) -> dict[str, Any]:
        """Start the simulation that continues a recording from a time, with changed values."""
        at = body.get("at")
        changes = body.get("changes") or {}
        is_time = isinstance(at, int | float) and not isinstance(at, bool)
        if not is_time or not isinstance(changes, dict):
            raise UsageError(f'"at" is {at!r:.80}; expected a time [s], and "changes" values by their keys')
        options = [f"-p{key}={as_text(value, key)}" for key, value in changes.items()]
        out = path.with_name(f"{path.stem}-from-{at:g}.mcap")
        command = ["simulate", "--from", f"{path}@{at:g}s", *options, "--out", str(out), "--force"]
        return self._jobs.start(f"{path.name} continued from {at:g} s", command)

    def _compare(self, path: Path, other: Path) -> dict[str, Any]:
        """Start the comparison of two recordings."""
        title = f"compare {path.name} with {other.name}"
        return self._write(title, ["diff", str(path), str(other)], "--figure", "difference.png")

    def _write(self, title: str, command: Sequence[str], option: str, file: str) -> dict[str, Any]:
        """Start a job that writes a file or a folder, which its `option` names, into a folder of its own."""
        result = self._jobs.folder() / file
        return self._jobs.start(title, [*command, option, str(result)], result)
