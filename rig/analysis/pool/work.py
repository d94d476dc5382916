"""What a work is, a pure function over numbered items, and the schedule of its units.

The schedule knows which units wait, in which batches they go out, and how often their workers were lost.

The folder with the results of a work: one file per batch, written atomically, so that an interrupted work continues.

maps/belt-1a2b3c4d5e6f/     named by the digest of scene, axes, settings and sources: another work, another folder
  job.json                  what the work is
  000012.npz                a batch, named by its first unit
  lock                      locked while a process computes

A batch has an array `#units` with the numbers of its units, and the type of the processor, `#processor`. Arrays of one
shape are stacked, "name" [unit, ...]; others are stored for each unit, "unit/name". Processes compute the same bits if
they have the same sources, kernels, and type of processor.
"""

from __future__ import annotations

import contextlib
import hashlib
import io
import json
import os
from collections import Counter, deque
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rig.compiled import kernel
from rig.errors import UsageError, WorkerError
from rig.machine import files, installation
from rig.machine.files import DATA, contents, draft_of, regular, write_file
from rig.record.provenance import blas, processor
from rig.scenes.scene import Scene

Arrays = dict[str, NDArray[Any]]
"""The result of one unit: arrays by name."""
Progress = Callable[[int, int], object]
"""(units done, all units)."""
MOST_WORKERS = 256
"""Largest number of worker processes."""
_ROOT = Path(__file__).resolve().parents[2]
_ROOMS = (  # whose sources decide numbers
    "analysis",
    "bench",
    "controllers",
    "design",
    "effects",
    "laws",
    "model",
    "motion",
    "plants",
    "record",
    "sensors",
    "solve",
    "stability",
)
_JOB = "job.json"
_LOCK = "lock"
_UNITS = "#units"  # no array has this name,
_PROCESSOR = "#processor"  # and none this
_ATTEMPTS = 2  # of a unit that ends its worker: the first time another one may be the cause
_SHARE = 2  # batches for each worker that the waiting units make at least: near the end the batches become small


@dataclass(frozen=True)
class Work:
    """`function` of each of `items`; the numbers of the units are those of the items. A work can be pickled.

    function  depends on nothing but its item and the values that a unit is given; raises RigError for a fault that
              ends the whole work
    name      what the folder of the results is called, before the digest
    digest    hash of everything that the results depend on, sources included
    prepare   compiles what all units need, before several workers ask for it; raises RigError for a work in vain
    failed    function of an item and a reason: the result of an item that ended its worker twice. By default, and if
              it raises WorkerError, there can be none, and the work ends
    about     what the folder says of the work, as JSON values
    """

    function: Callable[..., Arrays]
    items: Sequence[Any]
    name: str = "work"
    digest: str = ""
    prepare: Callable[[], object] = bool
    failed: Callable[[Any, str], Arrays] | None = None
    about: Mapping[str, Any] = field(default_factory=dict)

    @property
    def total(self) -> int:
        """Number of units."""
        return len(self.items)

    def compute(self, unit: int, *given: float) -> Arrays:
        """Return the result of a unit, for the values that it is given, if any."""
        return self.function(self.items[unit], *given)

    def given_up(self, unit: int, why: str) -> Arrays:
        """Return the result of a unit that ended its worker twice. Raises WorkerError if there can be none."""
        item = self.items[unit]
        if self.failed is None:
            raise WorkerError(f"{getattr(item, 'name', item)}: {why}")
        return self.failed(item, why)


def packed(raw: Any) -> Arrays:
    """Return JSON values as the result of a unit."""
    return {"json": np.frombuffer(json.dumps(raw).encode(), dtype=np.uint8)}


def unpacked(arrays: Arrays) -> Any:
    """Return the values of `packed`."""
    return json.loads(arrays["json"].tobytes())


class Schedule:
    """The waiting units for `workers` workers. A batch takes about `span` s, the first ones are single units.

    Units of a lost batch are sent again, each alone, so that the one that ended its worker is known.
    """

    def __init__(self, units: Iterable[int], workers: int, span: float) -> None:
        self._waiting = deque(units)
        self._again = deque[int]()
        self._workers = workers
        self._span = span
        self._out = 0
        self._done = 0
        self._seconds = 0.0
        self._lost = Counter[int]()

    @property
    def left(self) -> int:
        """Number of units that are neither done nor given up."""
        return len(self._waiting) + len(self._again) + self._out

    @property
    def waiting(self) -> bool:
        """Whether a unit waits for a worker."""
        return bool(self._waiting or self._again)

    @property
    def suspects(self) -> bool:
        """Whether the next batch is a unit whose worker was lost before."""
        return bool(self._again)

    def batch(self) -> list[int]:
        """Return the next units for a worker; none if none waits."""
        if self._again:
            units = [self._again.popleft()]
        else:
            size = 1
            if self._done:
                fits = int(self._span * self._done / max(self._seconds, 1e-9))
                size = max(1, min(fits, len(self._waiting) // (_SHARE * self._workers)))
            units = [self._waiting.popleft() for _ in range(min(size, len(self._waiting)))]
        self._out += len(units)
        return units

    def done(self, batch: list[int], seconds: float) -> None:
        """Take note that a batch is finished; it took `seconds`."""
        self._out -= len(batch)
        self._done += len(batch)
        self._seconds += seconds

    def lost(self, batch: list[int], attempts: int = 1) -> list[int]:
        """Take note that the worker of a batch was lost, after `attempts`; return the units that are given up."""
        self._out -= len(batch)
        self._lost.update(batch * attempts)
        given_up = [unit for unit in batch if self._lost[unit] >= _ATTEMPTS]
        self._again.extend(unit for unit in batch if unit not in given_up)
        return given_up


@cache
def sources() -> str:
    """Return version and hash (12 hex digits) of all sources and of what the kernels depend on."""
    return installation.described(kernel.source_key())


def digest(scene: Scene, text: str) -> str:
    """Return a hash (12 hex digits) of a scene, of a description, and of the sources that decide their numbers."""
    decides = f"{kernel.source_key()} {_hash_of_sources()} {np.__version__} {scene.digest} {text}"
    return hashlib.sha256(decides.encode()).hexdigest()[:12]


@cache
def _hash_of_sources() -> str:
    """A hash of the sources in `_ROOMS`."""
    known = hashlib.sha256()
    paths: list[Path] = []
    for room in _ROOMS:
        paths += (_ROOT / room).rglob("*.py")
    for path in sorted(paths):
        known.update(path.name.encode() + path.read_bytes())
    return known.hexdigest()


@cache
def this_processor() -> str:
    """Return the type of this processor and its linear algebra: results have the same bits on one type."""
    return f"{processor()}, {blas()}"


class Store:
    """The folder of one work; it is made when something is written."""

    def __init__(self, folder: Path, lasting: bool = True) -> None:
        self.folder = folder
        self.kept = f". Finished results are kept in {folder}" if lasting else ""
        """What an error says of the results, after its own sentence."""
        self._at = folder.absolute()  # a function of the user may change the current folder
        self.processors: set[str] = set()
        """Types of processor on which the results were computed that have been loaded."""

    @classmethod
    def of(cls, work: Work, root: Path) -> Store:
        """Return the store of a work under `root`."""
        return cls(root / f"{work.name}-{work.digest}")

    @contextlib.contextmanager
    def open(self, work: Work) -> Iterator[None]:
        """Make the folder and lock it; an error that leaves nothing in it takes it away again.

        Raises UsageError if it cannot be written or another process has locked it.
        """
        new = [self._at, *(folder for folder in self._at.parents if not folder.exists())]
        try:
            self._at.mkdir(parents=True, exist_ok=True)
            lock = (self._at / _LOCK).open("w")
        except OSError as error:
            raise UsageError(f"{self.folder}: cannot be written: {error.strerror}") from None
        with lock:
            if not files.take(lock):
                raise UsageError(f"{self.folder}: another process computes this at the moment; wait until it ends")
            try:
                self._check(work)
                write_file(self._at / _JOB, json.dumps({"digest": work.digest, **work.about}).encode())
                yield
            except BaseException:
                self._remove_empty(new)
                raise

    def _remove_empty(self, new: list[Path]) -> None:
        """Take the folder away if it holds no results; then those of `new` that are empty, from the innermost on."""
        with contextlib.suppress(OSError):
            if {path.name for path in self._at.iterdir()} <= {_JOB, _LOCK}:
                for name in (_JOB, _LOCK):
                    (self._at / name).unlink(missing_ok=True)
                for folder in new:
                    folder.rmdir()

    def _check(self, work: Work) -> None:
        """Raise UsageError if the folder holds another work, as after it was renamed."""
        with contextlib.suppress(OSError, ValueError, AttributeError):  # not there, or damaged: it is written anew
            digest = json.loads(contents(self._at / _JOB, DATA)).get("digest", work.digest)
            if digest != work.digest:
                raise UsageError(
                    f"{self.folder}: holds the results of another work ({digest}, not {work.digest}); "
                    "name another folder with --out, or move this one away"
                )

    def compute(
        self, work: Work, batch: Iterable[Sequence[float]], rows: dict[int, Arrays], progress: Callable[[int], object]
    ) -> None:
        """Compute a batch of [unit, value, ...] into `rows` and save it; after an interruption, what is finished of it.

        `progress` gets the number of finished units.
        """
        try:
            for unit, *given in batch:
                rows[int(unit)] = work.compute(int(unit), *given)
                progress(len(rows))
        finally:
            if rows:
                self.save(rows)

    def save(self, rows: dict[int, Arrays], processor: str = "") -> None:
        """Save the results of a batch, computed on a type of `processor`, by default this one. Raises OutputError."""
        flat = _flat(rows) | {_PROCESSOR: np.array(processor or this_processor())}
        with draft_of(self._at / f"{min(rows):06d}.npz") as draft, draft.open("wb") as file:
            np.savez(file, allow_pickle=False, **flat)  # type: ignore[arg-type]
            file.flush()
            os.fsync(file.fileno())

    def load(self, first: int = 0) -> dict[int, Arrays]:
        """Return the results of finished units, of batches that begin with `first` or later; unreadable files are
        skipped.
        """
        rows: dict[int, Arrays] = {}
        for path in sorted(self._at.glob("*.npz")):
            if path.stem.isdecimal() and int(path.stem) < first:
                continue
            try:
                regular(path)
                with io.BytesIO(path.read_bytes()) as data, np.load(data) as file:  # numpy leaves a damaged file open
                    batch = {key: file[key] for key in file.files}
                units = batch.pop(_UNITS).tolist()
                self.processors.add(str(batch.pop(_PROCESSOR)))
            except Exception:  # damaged: zipfile raises many kinds
                continue
            for key, array in batch.items():
                unit, slash, name = key.partition("/")
                if slash:
                    rows.setdefault(int(unit), {})[name] = array
                else:
                    for number, entry in zip(units, array):
                        rows.setdefault(number, {})[key] = entry
        return rows


def _flat(rows: dict[int, Arrays]) -> Arrays:
    """The arrays of a file: those of one shape and type in all units stacked."""
    units = sorted(rows)
    flat: Arrays = {_UNITS: np.array(units, dtype=np.int64)}
    for name in dict.fromkeys(name for unit in units for name in rows[unit]):
        arrays = {unit: rows[unit][name] for unit in units if name in rows[unit]}
        if len(arrays) == len(units) and len({(array.shape, array.dtype) for array in arrays.values()}) == 1:
            flat[name] = np.stack([*arrays.values()])
        else:
            flat |= {f"{unit}/{name}": array for unit, array in arrays.items()}
    return flat
