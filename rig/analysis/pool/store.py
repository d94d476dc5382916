"""The folder with the results of a work: one file per batch, written atomically, so that an interrupted work continues.

maps/belt-1a2b3c4d5e6f/     named by the digest of scene, axes, settings and sources: another work, another folder
  job.json                  the work
  000012.npz                a batch, named by its first unit
  lock                      locked while a process computes

A batch has an array `#units` with the numbers of its units, and the type of the processor, `#processor`. Arrays of one
shape are stacked, "name" [unit, ...]; others are stored for each unit, "unit/name".
"""

from __future__ import annotations

import contextlib
import json
import os
from collections.abc import Iterator
from pathlib import Path
from zipfile import BadZipFile

import numpy as np

from rig import file_locks
from rig.analysis.pool.identity import this_processor
from rig.analysis.pool.work import Arrays, Work, from_text, to_text
from rig.errors import UsageError
from rig.user_files import draft_of, write_file

_JOB = "job.json"
_UNITS, _PROCESSOR = "#units", "#processor"


class Store:
    """The folder of one work; it is made when something is written."""

    def __init__(self, folder: Path) -> None:
        self.folder = folder
        self.processors: set[str] = set()
        """Types of processor on which the results were computed that have been loaded."""

    @classmethod
    def of(cls, work: Work, root: Path) -> Store:
        """Return the store of a work under `root`."""
        return cls(root / f"{work.name}-{work.digest}")

    @contextlib.contextmanager
    def open(self, work: Work) -> Iterator[None]:
        """Make the folder and lock it. Raises UsageError if it cannot be written or another process has locked it."""
        try:
            self.folder.mkdir(parents=True, exist_ok=True)
            lock = (self.folder / "lock").open("w")
        except OSError as error:
            raise UsageError(f"{self.folder}: cannot be written: {error.strerror}") from None
        with lock:
            if not file_locks.take(lock):
                raise UsageError(f"{self.folder}: another process computes this at the moment; wait until it ends")
            self._check(work)
            write_file(self.folder / _JOB, to_text(work).encode())
            yield

    def _check(self, work: Work) -> None:
        """Raise UsageError if the folder holds another work, as after it was renamed."""
        with contextlib.suppress(OSError, ValueError, AttributeError):  # not there, or damaged: it is written anew
            digest = json.loads((self.folder / _JOB).read_text()).get("digest", work.digest)
            if digest != work.digest:
                raise UsageError(
                    f"{self.folder}: holds the results of another work ({digest}, not {work.digest}); "
                    "name another folder with --out, or move this one away"
                )

    def work(self) -> Work:
        """Return the work."""
        return from_text((self.folder / _JOB).read_text())

    def save(self, found: dict[int, Arrays], processor: str = "") -> None:
        """Save the results of a batch, computed on a type of `processor`, by default this one. Raises OutputError."""
        flat = _flat(found) | {_PROCESSOR: np.array(processor or this_processor())}
        with draft_of(self.folder / f"{min(found):06d}.npz") as draft, draft.open("wb") as file:
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
                units = batch.pop(_UNITS).tolist()
                self.processors.add(str(batch.pop(_PROCESSOR)))
            except (OSError, ValueError, BadZipFile, KeyError):
                continue
            for key, array in batch.items():
                unit, slash, name = key.partition("/")
                if slash:
                    found.setdefault(int(unit), {})[name] = array
                else:
                    for number, one in zip(units, array):
                        found.setdefault(number, {})[key] = one
        return found


def _flat(found: dict[int, Arrays]) -> Arrays:
    """The arrays of a file: those of one shape and type in all units stacked."""
    units = sorted(found)
    flat: Arrays = {_UNITS: np.array(units, dtype=np.int64)}
    for name in dict.fromkeys(name for unit in units for name in found[unit]):
        arrays = {unit: found[unit][name] for unit in units if name in found[unit]}
        if len(arrays) == len(units) and len({(one.shape, one.dtype) for one in arrays.values()}) == 1:
            flat[name] = np.stack([*arrays.values()])
        else:
            flat |= {f"{unit}/{name}": one for unit, one in arrays.items()}
    return flat
