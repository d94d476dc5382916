"""Checks of files that a user names: a file to read must be regular and not too large, a file to write not a pipe.

A pipe would block until another process opens its other end, and reading a device may never end.
"""

from __future__ import annotations

import errno
import os
import stat
from pathlib import Path

from rig import file_locks

TEXT = 1 << 20
"""Largest file that counts as written by hand [bytes]."""
WRITTEN = "another run is writing it; name another file"


def regular(path: Path) -> int:
    """Size of a regular file [bytes]. Raises OSError, whose `strerror` says why it is not one."""
    try:
        found = path.stat()
    except ValueError:  # a name with a zero byte in it
        raise OSError(errno.EINVAL, "the name contains a zero byte") from None
    if stat.S_ISDIR(found.st_mode):
        raise IsADirectoryError(errno.EISDIR, "it is a folder")
    if not stat.S_ISREG(found.st_mode):
        raise OSError(errno.EINVAL, "it is not a regular file")
    return found.st_size


def takes(path: Path) -> None:
    """Raise OSError if `path` exists and cannot be written like a file. Devices such as /dev/null can."""
    try:
        mode = path.stat().st_mode
    except FileNotFoundError:
        return
    if not (stat.S_ISREG(mode) or stat.S_ISCHR(mode) or stat.S_ISDIR(mode)):  # the system itself refuses a folder
        raise OSError(errno.EINVAL, "it is not a regular file; name another one")


def unused(path: Path) -> None:
    """Raise OSError if another process is writing the file."""
    file = os.open(path, os.O_WRONLY)
    try:
        if not file_locks.free(file):
            raise OSError(errno.EBUSY, WRITTEN)
    finally:
        os.close(file)


def contents(path: Path, most: int = TEXT) -> bytes:
    """Read a regular file of at most `most` bytes. Raises OSError, as `regular` does."""
    regular(path)
    with path.open("rb") as file:
        found = file.read(most + 1)
    if len(found) > most:
        raise OSError(errno.EFBIG, f"it is larger than {most >> 20} MiB, the largest size that is read")
    return found
