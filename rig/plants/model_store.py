"""Reduced models of structures on disk: what takes seconds to build is built once.

A file holds one model, is named by the hash of all that the model depends on, and is read as it was written or not at
all: whoever reads it checks it. `RIG_MODELS` moves the folder.
"""

from __future__ import annotations

import logging
import os
import threading
from collections.abc import Callable
from contextlib import suppress
from pathlib import Path
from typing import TypeVar

import platformdirs

T = TypeVar("T")

LIMIT = 1 << 26
"""Bytes that all models may take; those that were not used for longest make room. # chosen"""
_log = logging.getLogger("rig")
_told: set[Path] = set()  # folders that this process has said it cannot write


def root() -> Path:
    """Folder that holds the models."""
    chosen = os.environ.get("RIG_MODELS")
    return Path(chosen) if chosen else platformdirs.user_cache_path("friction-rig") / "models"


def kept(key: str, build: Callable[[], T], write: Callable[[T], bytes], read: Callable[[bytes], T]) -> T:
    """The model of `key`, from its file or from `build`.

    `read` raises ValueError for what `write` did not make: such a file is built and written anew. Two processes that
    build one model at once write the same file, each as a whole. A folder that cannot be written is no fault.
    """
    path = root() / key
    with suppress(OSError, ValueError):
        found = read(path.read_bytes())
        with suppress(OSError):  # of a folder that cannot be written
            os.utime(path)
        return found
    made = build()
    try:
        _keep(path, write(made))
    except OSError as fault:
        if path.parent not in _told:
            _told.add(path.parent)
            _log.warning(
                "models cannot be kept in %s (%s): the next start builds them again, which takes seconds; "
                "make room, or set RIG_MODELS to another folder",
                path.parent,
                fault.strerror,
            )
    return made


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
