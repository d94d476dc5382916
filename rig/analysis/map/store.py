"""The folder with the results of a map: one file per batch, written atomically, so that an interrupted map continues.

maps/belt-1a2b3c4d5e6f/     named by the digest of scene, axes, settings and sources: another job, another folder
  job.json                  the job
  plan.json                 the batches of the current run
  000012.npz                a batch, named by its first unit; arrays "unit/name"
  000012.claim              the worker that computes it
"""

from __future__ import annotations

import contextlib
import json
import os
from collections.abc import Iterator, Sequence
from pathlib import Path
from zipfile import BadZipFile

import numpy as np

from rig import file_locks
from rig.analysis.map.job import Arrays, Job
from rig.errors import UsageError
from rig.user_files import draft_of, write_file


class Store:
    """The folder of one job under `root`; it is made when something is written."""

    def __init__(self, folder: Path) -> None:
        self.folder = folder

    @classmethod
    def of(cls, job: Job, root: Path) -> Store:
        """Return the store of a job."""
        return cls(root / f"{job.scene.name}-{job.digest}")

    @contextlib.contextmanager
    def open(self, job: Job) -> Iterator[None]:
        """Make the folder and lock it. Raises UsageError if it cannot be written or another process has locked it."""
        try:
            self.folder.mkdir(parents=True, exist_ok=True)
            lock = (self.folder / "lock").open("w")
        except OSError as error:
            raise UsageError(f"{self.folder}: cannot be written: {error.strerror}") from None
        with lock:
            if not file_locks.take(lock):
                raise UsageError(f"{self.folder}: another process computes this map at the moment; wait until it ends")
            self._write("job.json", job.to_json())
            self._forget()
            yield
            self._forget()

    def _forget(self) -> None:
        for claim in self.folder.glob("*.claim"):
            claim.unlink()

    def job(self) -> Job:
        """The job."""
        return Job.from_json((self.folder / "job.json").read_text())

    def plan(self, batches: Sequence[Sequence[int]]) -> None:
        """Write down the batches to be computed."""
        self._write("plan.json", json.dumps([list(batch) for batch in batches]))

    def planned(self) -> list[list[int]]:
        """Return the batches to be computed."""
        return [list(batch) for batch in json.loads((self.folder / "plan.json").read_text())]

    def claim(self, batch: Sequence[int]) -> bool:
        """Claim a batch for this worker; return whether no other worker had claimed it."""
        try:
            os.close(os.open(self.folder / f"{batch[0]:06d}.claim", os.O_CREAT | os.O_EXCL))
        except FileExistsError:
            return False
        return True

    def save(self, found: dict[int, Arrays]) -> None:
        """Save the results of a batch. Raises OutputError."""
        with draft_of(self.folder / f"{min(found):06d}.npz") as draft, draft.open("wb") as file:
            flat = {f"{unit}/{name}": array for unit, arrays in found.items() for name, array in arrays.items()}
            np.savez(file, allow_pickle=False, **flat)  # type: ignore[arg-type]
            file.flush()
            os.fsync(file.fileno())

    def load(self) -> dict[int, Arrays]:
        """Return the results of every finished unit; unreadable files are skipped."""
        found: dict[int, Arrays] = {}
        for path in sorted(self.folder.glob("*.npz")):
            try:
                with np.load(path) as file:
                    batch = {key: file[key] for key in file.files}
            except (OSError, ValueError, BadZipFile):
                continue
            for key, array in batch.items():
                unit, _, name = key.partition("/")
                found.setdefault(int(unit), {})[name] = array
        return found

    def _write(self, name: str, text: str) -> None:
        write_file(self.folder / name, text.encode())
