"""Results in a folder: one file for each batch, put in place whole, so that a broken run goes on where it was.

maps/belt-1a2b3c4d5e6f/     named by the digest of scene, axes, settings and sources: another job, another folder
  job.json                  the job
  plan.json                 the batches that the run under way works on
  000012.npz                a batch, named by its first unit; arrays "unit/name"
  000012.claim              which worker has it
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


class Store:
    """The folder of one job under `root`; made when something is written."""

    def __init__(self, folder: Path) -> None:
        self.folder = folder

    @classmethod
    def of(cls, job: Job, root: Path) -> Store:
        """Where a job's results are."""
        return cls(root / f"{job.scene.name}-{job.digest}")

    @contextlib.contextmanager
    def open(self, job: Job) -> Iterator[None]:
        """Make the folder and keep others out of it. Raises UsageError where it cannot be or somebody is in it."""
        try:
            self.folder.mkdir(parents=True, exist_ok=True)
            lock = (self.folder / "lock").open("w")
        except OSError as error:
            raise UsageError(f"{self.folder}: cannot be written: {error.strerror}") from None
        with lock:
            if not file_locks.take(lock):
                raise UsageError(f"{self.folder}: this map is being made just now")
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
        """Write down the batches to be made."""
        self._write("plan.json", json.dumps([list(batch) for batch in batches]))

    def planned(self) -> list[list[int]]:
        """The batches to be made."""
        return [list(batch) for batch in json.loads((self.folder / "plan.json").read_text())]

    def claim(self, batch: Sequence[int]) -> bool:
        """Take a batch; whether nobody had it."""
        try:
            os.close(os.open(self.folder / f"{batch[0]:06d}.claim", os.O_CREAT | os.O_EXCL))
        except FileExistsError:
            return False
        return True

    def save(self, found: dict[int, Arrays]) -> None:
        """Put a batch in place."""
        path = self.folder / f"{min(found):06d}.npz"
        draft = path.with_suffix(f".{os.getpid()}")
        with draft.open("wb") as file:
            flat = {f"{unit}/{name}": array for unit, arrays in found.items() for name, array in arrays.items()}
            np.savez(file, allow_pickle=False, **flat)  # type: ignore[arg-type]
            file.flush()
            os.fsync(file.fileno())
        draft.replace(path)

    def load(self) -> dict[int, Arrays]:
        """Every unit that is done; a file that cannot be read is left out."""
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
        draft = self.folder / f"{name}.{os.getpid()}"
        draft.write_text(text)
        draft.replace(self.folder / name)
