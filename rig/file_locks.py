"""File locks, which show that a process writes a file or that a run is live.

The system releases a lock when its process ends, however it ends.
"""

from __future__ import annotations

from typing import IO

try:
    import fcntl

    KNOWN = True
except ImportError:
    KNOWN = False
"""Whether this system has file locks. Without them `take` always succeeds."""


def take(file: int | IO[bytes] | IO[str], *, wait: bool = False, shared: bool = False) -> bool:
    """Take the lock of an open file, exclusively or `shared`; whether it succeeded.

    With `wait` block until other processes release it. Raises OSError on a file system without locks.
    """
    if not KNOWN:
        return True
    try:
        fcntl.flock(file, (fcntl.LOCK_SH if shared else fcntl.LOCK_EX) | (0 if wait else fcntl.LOCK_NB))
    except BlockingIOError:
        return False
    return True


def free(file: int | IO[bytes] | IO[str]) -> bool:
    """Take the lock of an open file; whether no other process has it. Always true without file locks."""
    try:
        return take(file)
    except OSError:
        return True
