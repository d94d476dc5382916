"""Files: those that a user names, and those that other processes and users can reach.

A lock shows that a process writes a file or that a run is live. The system releases it when its process ends, however
it ends. A cache holds what this user's processes execute or compute with, so a folder or file of it that another user
owns or can write is ignored, with a warning. The administrator counts as this user: a shared cache may be theirs.

A file to read must be regular and not too large: a pipe would block until another process opens its other end, and
reading a device may never end. A file to write is written completely or not.
"""

from __future__ import annotations

import csv
import errno
import io
import logging
import os
import stat
import struct
import zipfile
import zlib
from collections.abc import Iterable, Iterator, Set
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import IO

from rig.errors import OutputError, UsageError

try:
    import fcntl

    KNOWN = True
except ImportError:
    KNOWN = False
"""Whether this system has file locks. Without them `take` always succeeds."""

_log = logging.getLogger("rig")
_warned: set[Path] = set()  # folders for which this process has warned
_NUMBERS = {1, 2, 3, 4, 5, 6, 7, 9, 12, 13, 16, 17, 18}
_MATRIX = 14
_COMPRESSED = 15
"""Types of the elements of a MATLAB file of format 5."""
_NESTED = {1, 2, 3, 16, 17}
"""Classes of MATLAB that contain other matrices: cells, structures, objects."""
_OTHERS = 0o022
"""The bits of a mode that let others write."""

RUNS = Path("recordings/runs")
"""Where runs are recorded unless their user names a file."""
TEXT = 1 << 20
"""Largest file that counts as written by hand [bytes]."""
# Most files in a zip file. # chosen
FILES = 10_000
DATA = 1 << 28
"""Largest file of data that a program wrote for later [bytes]."""
FIGURES = (".png", ".svg", ".pdf")
"""Suffixes of a figure, in small or capital letters; they select its format."""
WRITTEN = "another run is writing it; name another file"


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
    with suppress(OSError):
        return take(file)
    return True


def trusted(path: Path, instead: str) -> bool:
    """Whether only this user can have written a folder or file of a cache, or it is missing; else warn, once a folder.

    `instead`: what the user can set, for the warning. The folders above it are not looked at.
    """
    try:
        why = _foreign(path)
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
        if _foreign(file.fileno()) or not trusted(path.parent, instead):
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


def _foreign(file: int | Path) -> str:
    """Why another user can have written a file or folder; "" if none can. Raises OSError."""
    if not hasattr(os, "getuid"):  # this system has other permissions
        return ""
    status = os.stat(file)
    if status.st_uid not in (0, os.geteuid()):
        return f"belongs to another user (number {status.st_uid})"
    mode = status.st_mode & _OTHERS
    if mode & 0o002 or (mode and not _alone_in(status.st_gid)):
        return f"can be written by other users (mode {status.st_mode & 0o777:o})"
    return ""


def _alone_in(group: int) -> bool:
    """Whether this user is the only member of a group: the one of the user's own name, as many systems have them."""
    import grp
    import pwd

    try:
        user = pwd.getpwuid(os.geteuid()).pw_name
        members = grp.getgrgid(group)
    except KeyError:
        return False
    return members.gr_name == user and {*members.gr_mem} <= {user}


def regular(path: Path) -> int:
    """Size of a regular file [bytes]. Raises OSError, whose `strerror` says why it is not one."""
    try:
        status = path.stat()
    except ValueError:  # a name with a zero byte in it
        raise OSError(errno.EINVAL, "the name contains a zero byte", str(path)) from None
    if stat.S_ISDIR(status.st_mode):
        raise IsADirectoryError(errno.EISDIR, "it is a folder", str(path))
    if not stat.S_ISREG(status.st_mode):
        raise OSError(errno.EINVAL, "it is not a regular file", str(path))
    return status.st_size


def takes(path: Path) -> None:
    """Raise OSError if `path` exists and cannot be written like a file. Devices such as /dev/null can."""
    with suppress(FileNotFoundError):
        mode = path.stat().st_mode
        if not (stat.S_ISREG(mode) or stat.S_ISCHR(mode) or stat.S_ISDIR(mode)):  # the system itself refuses a folder
            raise OSError(errno.EINVAL, "it is not a regular file; name another one")


def unused(path: Path) -> None:
    """Raise OSError if another process is writing the file."""
    file = os.open(path, os.O_WRONLY)
    try:
        if not free(file):
            raise OSError(errno.EBUSY, WRITTEN)
    finally:
        os.close(file)


def write_file(path: Path, content: bytes) -> None:
    """Write a file, completely or not at all. Raises OutputError."""
    with draft_of(path) as draft:
        draft.write_bytes(content)


@contextmanager
def draft_of(path: Path) -> Iterator[Path]:
    """A file beside `path` that takes its place if all goes well: a full disk or Ctrl-C leaves what was there.

    Raises OutputError if it cannot be written.
    """
    try:
        target = Path(os.path.realpath(path))  # a symbolic link stays a link
        takes(target)
        if target.exists() and not target.is_file():  # a device, such as /dev/null
            yield target
            return
        if target.exists():
            target.open("r+b").close()  # the folder would let a file be replaced that must not be written
        draft = target.with_name(f".draft-{os.getpid()}")  # short, whatever the length of the name
        try:
            yield draft
            if target.exists():
                draft.chmod(target.stat().st_mode)
            draft.replace(target)
        finally:
            draft.unlink(missing_ok=True)
    except OSError as fault:
        raise OutputError(f"{path} cannot be written: {fault.strerror}") from None


def csv_table(rows: Iterable[Iterable[object]]) -> bytes:
    """Rows as the content of a CSV file."""
    text = io.StringIO(newline="")
    csv.writer(text).writerows(rows)
    return text.getvalue().encode()


def contents(path: Path, most: int = TEXT) -> bytes:
    """Read a regular file of at most `most` bytes. Raises OSError, as `regular` does."""
    regular(path)
    with path.open("rb") as file:
        content = file.read(most + 1)
    if len(content) > most:
        raise OSError(errno.EFBIG, f"it is larger than {most >> 20} MiB, the largest size that is read", str(path))
    return content


def unpacked(archive: zipfile.ZipFile, most: int) -> None:
    """Check what a zip file says of itself before anything is unpacked: a few megabytes can become gigabytes.

    Raises OSError for more than `most` bytes in all its files together, or more than `FILES` files. No file can become
    larger than it is said to be.
    """
    parts = archive.infolist()
    size = sum(part.file_size for part in parts)
    if size > most:
        raise OSError(errno.EFBIG, f"its files take {size / (1 << 20):.0f} MiB unpacked; at most {most >> 20} MiB")
    if len(parts) > FILES:
        raise OSError(errno.EFBIG, f"it contains {len(parts)} files; at most {FILES}")


def matlab_checked(data: bytes, most: int) -> None:
    """Check the elements of a MATLAB file of format 5: scipy's reader ends the process at some damaged ones.

    Raises ValueError for an element that cannot be, and for more than `most` bytes unpacked.
    """
    order = "<" if data[126:128] == b"IM" else ">"
    unpacked_bytes = 0

    def elements(data: bytes, at: int, end: int, allowed: Set[int]) -> None:
        nonlocal unpacked_bytes
        while at + 8 <= end:
            kind, length = struct.unpack_from(f"{order}II", data, at)
            start = at + 8
            padded = length + -length % 8 * (kind != _COMPRESSED)
            if kind >> 16:  # a short element, with its data in the tag
                length = kind >> 16
                kind &= 0xFFFF
                start = at + 4
                padded = 4
            if kind not in allowed or length > min(padded, end - start):
                raise ValueError(f"the element at byte {at} has the type {kind} and {length} bytes")
            if kind == _COMPRESSED:
                inner = zlib.decompressobj().decompress(data[start : start + length], most + 1 - unpacked_bytes)
                unpacked_bytes += len(inner)
                if unpacked_bytes > most:
                    raise ValueError(f"its variables take more than {most >> 20} MiB unpacked")
                elements(inner, 0, len(inner), {_MATRIX})
            elif kind == _MATRIX and length:
                of = struct.unpack_from(f"{order}I", data, start + 8)[0] & 0xFF if length >= 16 else 0
                elements(data, start, start + length, (_NUMBERS | {_MATRIX}) if of in _NESTED else _NUMBERS)
            at = start + padded

    if 0 not in data[:4]:  # as it is in format 4
        elements(data, 128, len(data), {_MATRIX, _COMPRESSED})


def recording_name(path: Path) -> None:
    """Raise UsageError for a name that does not end in .mcap, unless it is a device such as /dev/null."""
    if path.suffix.lower() != ".mcap" and not path.is_char_device():
        raise UsageError(
            f"{path}: a recording is an MCAP file, and its name ends in .mcap; rig export writes other formats from it"
        )


def figure_format(path: Path) -> str:
    """Return the format of a figure from its suffix. Raises UsageError for a suffix that is not among `FIGURES`."""
    suffix = path.suffix.lower()
    if suffix not in FIGURES:
        raise UsageError(f"{path}: the name of a figure ends in {', '.join(FIGURES[:-1])} or {FIGURES[-1]}")
    return suffix[1:]
