"""Locks of files: who writes, who runs. The system gives a lock back when its process ends, however it ends."""

from __future__ import annotations

from typing import IO

try:
    import fcntl

    KNOWN = True
except ImportError:
    KNOWN = False
"""Whether this system has them. Where it has not, `take` grants everything: nobody can be asked."""


def take(file: int | IO[bytes] | IO[str], *, wait: bool = False, shared: bool = False) -> bool:
    """Whether the lock of an open file is ours: alone, or with others who share it. Others are waited for, or not.

    A file system without locks raises OSError.
    """
    if not KNOWN:
        return True
    try:
        fcntl.flock(file, (fcntl.LOCK_SH if shared else fcntl.LOCK_EX) | (0 if wait else fcntl.LOCK_NB))
    except BlockingIOError:
        return False
    return True


def free(file: int | IO[bytes] | IO[str]) -> bool:
    """Whether nobody else has the lock of an open file, which is ours then. Without locks nobody has it."""
    try:
        return take(file)
    except OSError:
        return True
