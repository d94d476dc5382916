"""Reduced models of structures: what takes seconds to build is built once, and a recording keeps it.

A file holds one model, is named by the hash of all that the model depends on, and is read as it was written or not at
all: whoever reads it checks it. `RIG_MODELS` moves the folder.

A rig that is simulated again takes the model of its recording, whatever this machine would build: the recording offers
the bytes (`offer`), and its scene names them by digest while its rig is assembled (`given`).
"""

from __future__ import annotations

import hashlib
import logging
import os
import threading
from collections import OrderedDict
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager, suppress
from contextvars import ContextVar
from pathlib import Path
from typing import Any, ParamSpec, TypeVar

import platformdirs

P = ParamSpec("P")
T = TypeVar("T")

LIMIT = 1 << 26
"""Bytes that all models may take; those that were not used for longest make room. # chosen"""
_REMEMBERED = 4  # results, of each plant
_log = logging.getLogger("rig")
_told: set[Path] = set()  # folders that this process has said it cannot write
_offered: OrderedDict[str, bytes] = OrderedDict()  # digest -> model, the latest last
_given: ContextVar[Mapping[str, str] | None] = ContextVar("given", default=None)
_taken: ContextVar[dict[str, bytes] | None] = ContextVar("taken", default=None)


def root() -> Path:
    """Folder that holds the models."""
    chosen = os.environ.get("RIG_MODELS")
    return Path(chosen) if chosen else platformdirs.user_cache_path("friction-rig") / "models"


def digest(content: bytes) -> str:
    """Name of a model by what it is (32 hex digits)."""
    return hashlib.sha256(content).hexdigest()[:32]


def offer(content: bytes) -> str:
    """Have a model at hand in this process for whoever names its digest, which is returned."""
    name = digest(content)
    _offered[name] = content
    _offered.move_to_end(name)
    left = LIMIT
    for one in reversed(list(_offered)):
        left -= len(_offered[one])
        if left < 0 and one != name:
            del _offered[one]
    return name


@contextmanager
def given(models: Mapping[str, str]) -> Iterator[None]:
    """Within it, `kept` takes these models (what they are of -> digest) where they are at hand."""
    before = _given.set(models)
    try:
        yield
    finally:
        _given.reset(before)


@contextmanager
def gathered() -> Iterator[dict[str, bytes]]:
    """The models that `kept` gives within it: what each is of -> the model as bytes."""
    found: dict[str, bytes] = {}
    before = _taken.set(found)
    try:
        yield found
    finally:
        _taken.reset(before)


def kept(key: str, build: Callable[[], T], write: Callable[[T], bytes], read: Callable[[bytes], T], of: str = "") -> T:
    """The model of `key`, from its file or from `build`; `of`: what it is a model of, whoever built it.

    A model of the same thing that is `given` and offered comes first. `read` raises ValueError for what `write` did not
    make: such a file is built and written anew. Two processes that build one model at once write the same file, each as
    a whole. A folder that cannot be written is no fault.
    """
    path = root() / key
    offered = _offered.get((_given.get() or {}).get(of, ""))
    if offered is not None:
        with suppress(ValueError):
            return _take(of, offered, read(offered))
    with suppress(OSError, ValueError):
        content = path.read_bytes()
        found = read(content)
        with suppress(OSError):  # of a folder that cannot be written
            os.utime(path)
        return _take(of, content, found)
    made = build()
    content = write(made)
    try:
        _keep(path, content)
    except OSError as fault:
        if path.parent not in _told:
            _told.add(path.parent)
            _log.warning(
                "models cannot be kept in %s (%s): the next start builds them again, which takes seconds; "
                "make room, or set RIG_MODELS to another folder",
                path.parent,
                fault.strerror,
            )
    return _take(of, content, made)


def remembered(build: Callable[P, T]) -> Callable[P, T]:
    """`build` with its latest results remembered, each for the models that were given when it was called.

    `build` takes arguments by place that can be hashed, and makes its models by `kept`.
    """
    known: OrderedDict[Any, tuple[T, dict[str, bytes]]] = OrderedDict()

    def call(*args: P.args, **_: P.kwargs) -> T:
        here = tuple(sorted(pair for pair in (_given.get() or {}).items() if pair[1] in _offered))
        if (entry := known.get((args, here))) is None:
            with gathered() as models:
                entry = build(*args), models  # type: ignore[call-arg]
            known[args, here] = entry
            if len(known) > _REMEMBERED:
                known.popitem(last=False)
        for of, content in entry[1].items():
            _take(of, content, None)
        return entry[0]

    return call


def _take(of: str, content: bytes, model: T) -> T:
    """`model`; whoever gathers models gets its bytes."""
    taken = _taken.get()
    if taken is not None:
        taken[of] = content
    return model


def _keep(path: Path, content: bytes) -> None:
    """Write a file as a whole; the oldest others make room."""
    path.parent.mkdir(parents=True, exist_ok=True)
    draft = path.with_name(f"{path.name}.{os.getpid()}.{threading.get_ident()}")
    try:
        draft.write_bytes(content)
        draft.replace(path)
    except OSError:
        with suppress(OSError):
            draft.unlink()
        raise
    left = LIMIT
    for _, size, one in sorted(_files(path.parent), reverse=True):
        left -= size
        if left < 0 and one != path:
            with suppress(OSError):
                one.unlink()


def _files(folder: Path) -> list[tuple[float, int, Path]]:
    """Time of last use, size and path of each file."""
    found = []
    for one in folder.iterdir():
        with suppress(OSError):  # another process has just removed it
            status = one.stat()
            found.append((status.st_mtime, status.st_size, one))
    return found
