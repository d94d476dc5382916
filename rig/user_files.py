"""Files that a user names: to be read, a regular file and no larger than such a file can be; to be written, no pipe.

A pipe would wait for whoever is at its other end, a device may never end.
"""

from __future__ import annotations

import errno
import os
import stat
from pathlib import Path

from rig import file_locks

TEXT = 1 << 20
"""Largest file that somebody writes by hand [bytes]."""
WRITTEN = "another run is writing it; name another file"


def regular(path: Path) -> int:
    """Size of a regular file [bytes]. Raises OSError, whose `strerror` says what is there in its place."""
    try:
        found = path.stat()
    except ValueError:  # a name with a zero byte in it
        raise OSError(errno.EINVAL, "no file can have this name") from None
    if stat.S_ISDIR(found.st_mode):
        raise IsADirectoryError(errno.EISDIR, "it is a folder")
    if not stat.S_ISREG(found.st_mode):
        raise OSError(errno.EINVAL, "it is no regular file")
    return found.st_size


def takes(path: Path) -> None:
    """Raise OSError for what is there and cannot be written as a file is; devices such as /dev/null can."""
    try:
        mode = path.stat().st_mode
    except FileNotFoundError:
        return
    if not (stat.S_ISREG(mode) or stat.S_ISCHR(mode) or stat.S_ISDIR(mode)):  # of a folder the system tells
        raise OSError(errno.EINVAL, "it is no regular file; name another one")


def unused(path: Path) -> None:
    """Raise OSError for a file that another process is writing."""
    file = os.open(path, os.O_WRONLY)
    try:
        if not file_locks.free(file):
            raise OSError(errno.EBUSY, WRITTEN)
    finally:
        os.close(file)


def contents(path: Path, most: int = TEXT) -> bytes:
    """What is in a file of at most `most` bytes. Raises OSError, as `regular` does."""
    regular(path)
    with path.open("rb") as file:
        found = file.read(most + 1)
    if len(found) > most:
        raise OSError(errno.EFBIG, f"it is larger than {most >> 20} MiB")
    return found
