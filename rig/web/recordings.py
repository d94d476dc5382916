"""The recordings of a folder for the page: the list, and jobs that check, report, export, compare and view them."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from rig.errors import UsageError
from rig.record.contents import SUFFIX
from rig.record.run_list import runs
from rig.web.jobs import Jobs

WORK = ("verify", "report", "csv", "compare", "view")


class Recordings:
    """The recordings in `folder`, and what `jobs` do with them."""

    def __init__(self, folder: Path, jobs: Jobs) -> None:
        self._folder, self._jobs = folder, jobs

    def all(self) -> list[dict[str, Any]]:
        """Name, scene, time, length, timing verdict, size and notes of each recording, the newest first."""
        found = runs(self._folder) if self._folder.is_dir() else []
        rows = []
        for one in reversed(found):
            row: dict[str, Any] = {"name": one.path.relative_to(self._folder).as_posix(), "bytes": one.size}
            row |= {"fault": one.fault, "notes": [str(note) for note in one.notes.found]}
            if one.contents is not None:
                read = one.contents
                row |= {"scene": read.scene, "title": read.title, "began": read.began_ns / 1e9}
                row |= {"seconds": read.seconds, "timing": read.timing, "run": read.run}
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
        """Start a job: `what` (`WORK`), `name`, and for compare `other`. Raises UsageError."""
        what, path = body.get("what"), self.path(body.get("name"))
        if what == "verify":
            return self._jobs.start(f"verify {path.name}", ["verify", str(path)])
        if what == "view":
            return self._jobs.start(f"view {path.name}", ["view", str(path), "--web"])
        if what not in WORK:
            raise UsageError(f"{what!r:.80}: expected {', '.join(WORK)}")
        folder = self._jobs.folder()
        if what == "report":
            page = folder / "report.html"
            return self._jobs.start(f"report of {path.name}", ["report", str(path), "--out", str(page)], page)
        if what == "csv":
            tables = folder / f"{path.stem}-csv"
            arguments = ["export", str(path), "--to", "csv", "--out", str(tables)]
            return self._jobs.start(f"tables of {path.name}", arguments, tables)
        other, figure = self.path(body.get("other")), folder / "difference.png"
        arguments = ["diff", str(path), str(other), "--figure", str(figure)]
        return self._jobs.start(f"compare {path.name} with {other.name}", arguments, figure)
