"""The store of reduced models of structures: a model takes seconds to build, is built once, and is part of a recording.

A file contains one model. Its name is the hash of everything that the model depends on. The reader checks the content.
Of a model that was deleted to make room an empty file remains: who builds it again is told why.
The environment variable `RIG_MODELS` sets the folder. A file that another user can have written is ignored.

A re-simulation uses the model of the recording, whatever this machine would build: the recording offers the bytes
(`offer`), and its scene names them by digest while the rig is assembled (`using`).
"""

from __future__ import annotations

import hashlib
import logging
import os
import threading
from collections import OrderedDict
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager, suppress
from contextvars import ContextVar
from pathlib import Path
from typing import Any, ParamSpec, TypeVar

import platformdirs

from rig.machine import files

P = ParamSpec("P")
T = TypeVar("T")

LIMIT = 2 << 30
"""Largest size of all stored models together [bytes]; the least recently used ones are deleted beyond it [chosen]."""
MEMORY = 1 << 26
"""Largest size of a model of a recording, and of all offered models together [bytes] [chosen]."""
MARKS = 1000
"""Most empty files of deleted models that are kept; each says that its model was there [chosen]."""
_CACHED = 4  # results, of each plant
_INSTEAD = "RIG_MODELS to another folder"
_log = logging.getLogger("rig")
_reported: set[Path] = set()  # folders that this process has reported as not writable
OFFERED: OrderedDict[str, bytes] = OrderedDict()  # digest -> model, the latest last
_given: ContextVar[Mapping[str, str] | None] = ContextVar("given", default=None)
_taken: ContextVar[dict[str, bytes] | None] = ContextVar("taken", default=None)


def root() -> Path:
    """The folder of the models."""
    chosen = os.environ.get("RIG_MODELS")
    return Path(chosen) if chosen else platformdirs.user_cache_path("friction-rig") / "models"


def digest(content: bytes) -> str:
    """The digest of the content of a model (32 hex digits)."""
    return hashlib.sha256(content).hexdigest()[:32]


def offer(content: bytes) -> str:
    """Make a model available in this process by its digest; returns the digest."""
    name = digest(content)
    OFFERED[name] = content
    OFFERED.move_to_end(name)
    left = MEMORY
    for known in reversed(list(OFFERED)):
        left -= len(OFFERED[known])
        if left < 0 and known != name:
            del OFFERED[known]
    return name


@contextmanager
def using(models: Mapping[str, str]) -> Iterator[None]:
    """Context in which `stored_or_built` uses these models (subject -> digest) if they were offered."""
    before = _given.set(models)
    try:
        yield
    finally:
        _given.reset(before)


@contextmanager
def collected() -> Iterator[dict[str, bytes]]:
    """Context that collects the models that `stored_or_built` returns in it: subject -> model as bytes."""
    models: dict[str, bytes] = {}
    before = _taken.set(models)
    try:
        yield models
    finally:
        _taken.reset(before)


def stored_or_built(
    key: str, build: Callable[[], T], write: Callable[[T], bytes], read: Callable[[bytes], T], of: str = ""
) -> T:
    """The model of `key`, from its file or from `build`. `of`: its subject, the same on every machine.

    A model of the same subject that is `using` and offered has priority. `read` raises ValueError for content that
    `write` did not produce; the model is then built and written again. Two processes that build one model at the same
    time write the same file atomically. A folder that is not writable is reported once and is no error.
    """
    path = root() / key
    offered = OFFERED.get((_given.get() or {}).get(of, ""))
    if offered is not None:
        with suppress(ValueError):
            return _take(of, offered, read(offered))
    with suppress(OSError):
        content = files.own_bytes(path, _INSTEAD)
        try:
            model = read(content)
        except ValueError:
            _tell_lost(path, content)
        else:
            with suppress(OSError):  # of a folder that cannot be written
                os.utime(path)
            return _take(of, content, model)
    made = build()
    content = write(made)
    try:
        _keep(path, content)
    except OSError as fault:
        if path.parent not in _reported:
            _reported.add(path.parent)
            _log.warning(
                "models cannot be stored in %s (%s): the next start builds them again, which takes seconds; "
                "make room, or set RIG_MODELS to another folder",
                path.parent,
                fault.strerror,
            )
    return _take(of, content, made)


def built_by(folder: Path, sources: Sequence[str]) -> dict[str, Any]:
    """What a model depends on beside its data: these source files, and the libraries that may round otherwise.

    OpenBLAS chooses its code for the processor that it finds. A cache that two machines share has a file for each.
    """
    import numpy as np  # all three only for a plant with a reduced model
    import scipy
    from threadpoolctl import threadpool_info

    blas = [library.get("architecture") for library in threadpool_info() if library["user_api"] == "blas"]
    return {
        "sources": [hashlib.sha256((folder / name).read_bytes()).hexdigest() for name in sources],
        "libraries": [np.__version__, scipy.__version__],
        "processor": blas[:1],  # numpy's
    }


def cached(build: Callable[P, T]) -> Callable[P, T]:
    """`build` with a cache of its latest results, each valid for the models that were given at the call.

    `build` takes hashable positional arguments and obtains its models from `stored_or_built`.
    """
    known: OrderedDict[Any, tuple[T, dict[str, bytes]]] = OrderedDict()

    def call(*args: P.args, **_: P.kwargs) -> T:
        here = tuple(sorted(pair for pair in (_given.get() or {}).items() if pair[1] in OFFERED))
        if (entry := known.get((args, here))) is None:
            with collected() as models:
                entry = build(*args), models  # type: ignore[call-arg]
            known[args, here] = entry
            if len(known) > _CACHED:
                known.popitem(last=False)
        for of, content in entry[1].items():
            _take(of, content, None)
        return entry[0]

    return call


def _take(of: str, content: bytes, model: T) -> T:
    """Return `model`, and pass its bytes to the active `collected` contexts."""
    taken = _taken.get()
    if taken is not None:
        taken[of] = content
    return model


def _tell_lost(path: Path, content: bytes) -> None:
    """Say that a model that was stored at `path` is built again, and why."""
    why = "cannot be read: the file is damaged"
    if not content:
        why = f"was deleted, because all models together exceeded {LIMIT / (1 << 30):.3g} GiB"
    _log.warning("a reduced model that was stored is built again: %s %s", path, why)


def _keep(path: Path, content: bytes) -> None:
    """Write a file atomically and empty the least recently used ones beyond `LIMIT`."""
    if not files.trusted(path.parent, _INSTEAD):
        return
    files.own_folder(path.parent)
    _write(path, content)
    left = LIMIT
    deleted = 0
    for _, size, file in sorted(_files(path.parent), reverse=True):
        left -= size
        deleted += not size
        with suppress(OSError):
            if size and left < 0 and file != path:
                _write(file, b"")
            elif deleted > MARKS and not size:
                file.unlink()


def _write(path: Path, content: bytes) -> None:
    """Write a file atomically."""
    draft = path.with_name(f"{path.name}.{os.getpid()}.{threading.get_ident()}")
    try:
        draft.write_bytes(content)
        files.own_file(draft)
        draft.replace(path)
    except OSError:
        with suppress(OSError):
            draft.unlink()
        raise


def _files(folder: Path) -> list[tuple[float, int, Path]]:
    """Time of last use, size and path of each file."""
    uses = []
    for file in folder.iterdir():
        with suppress(OSError):  # another process has just removed it
            status = file.stat()
            uses.append((status.st_mtime, status.st_size, file))
    return uses
