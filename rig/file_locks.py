"""Files that other processes and other users can reach: locks, and caches that only their owner can have written.

A lock shows that a process writes a file or that a run is live. The system releases it when its process ends, however
it ends. A cache holds what this user's processes execute or compute with, so a folder or file of it that another user
owns or can write is ignored, with a warning. The administrator counts as this user: a shared cache may be theirs.
"""

from __future__ import annotations

import errno
import logging
import os
from pathlib import Path
from typing import IO

try:
    import fcntl

    KNOWN = True
except ImportError:
    KNOWN = False
"""Whether this system has file locks. Without them `take` always succeeds."""

_log = logging.getLogger("rig")
_warned: set[Path] = set()
"""Folders for which this process has warned."""
_OTHERS = 0o022
"""The bits of a mode that let others write."""


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


def trusted(path: Path, instead: str) -> bool:
    """Whether only this user can have written a folder or file of a cache, or it is missing; else warn, once a folder.

    `instead`: what the user can set, for the warning. The folders above it are not looked at.
    """
    try:
        why = _others(path)
    except OSError:
        return True
    folder = path if path.is_dir() else path.parent
    if why and folder not in _warned:
        _warned.add(folder)
        _log.warning("%s %s: it is ignored; remove it or its permission, or set %s", path, why, instead)
    return not why


def own_bytes(path: Path, instead: str) -> bytes:
    """The content of a file of a cache. Raises OSError for one that is not `trusted`, or in a folder that is not."""
    with path.open("rb") as file:  # this very file is checked, whatever takes its place
        if _others(file.fileno()) or not trusted(path.parent, instead):
            trusted(path, instead)
            raise PermissionError(errno.EPERM, "another user can have written it")
        return file.read()


def own_folder(path: Path) -> None:
    """Make a folder of a cache, and those above it that are missing, which only this user can write. Raises OSError."""
    for folder in (*reversed(path.parents), path):
        if not folder.exists():
            folder.mkdir(0o755, exist_ok=True)


def own_file(file: int | Path) -> None:
    """Take the permission of others to write a new file of a cache. Raises OSError."""
    if hasattr(os, "getuid"):
        os.chmod(file, os.stat(file).st_mode & ~_OTHERS)


def _others(file: int | Path) -> str:
    """Why another user can have written a file or folder; "" if none can. Raises OSError."""
    if not hasattr(os, "getuid"):  # this system has other permissions
        return ""
    found = os.stat(file)
    if found.st_uid not in (0, os.geteuid()):
        return f"belongs to another user (number {found.st_uid})"
    mode = found.st_mode & _OTHERS
    if mode & 0o002 or (mode and not _alone_in(found.st_gid)):
        return f"can be written by other users (mode {found.st_mode & 0o777:o})"
    return ""


def _alone_in(group: int) -> bool:
    """Whether this user is the only member of a group: the one of the user's own name, as many systems have them."""
    import grp
    import pwd

    try:
        user, found = pwd.getpwuid(os.geteuid()).pw_name, grp.getgrgid(group)
    except KeyError:
        return False
    return found.gr_name == user and {*found.gr_mem} <= {user}
