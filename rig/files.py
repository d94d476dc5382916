"""Reading a file that a user names: a regular file and no larger than such a file can be.

A pipe would wait for a writer, a device may never end.
"""

from __future__ import annotations

import errno
import stat
from pathlib import Path

TEXT = 1 << 20
"""Largest file that somebody writes by hand [bytes]."""


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


def contents(path: Path, most: int = TEXT) -> bytes:
    """What is in a file of at most `most` bytes. Raises OSError, as `regular` does."""
    regular(path)
    with path.open("rb") as file:
        found = file.read(most + 1)
    if len(found) > most:
        raise OSError(errno.EFBIG, f"it is larger than {most >> 20} MiB")
    return found
