"""Files that a user names: a file to read must be regular and not too large, one to write is written completely or not.

A pipe would block until another process opens its other end, and reading a device may never end.
"""

from __future__ import annotations

import csv
import errno
import io
import os
import stat
import zipfile
from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from pathlib import Path

from rig import file_locks
from rig.errors import OutputError, UsageError

RUNS = Path("recordings/runs")
"""Where runs are recorded unless their user names a file."""
TEXT = 1 << 20
"""Largest file that counts as written by hand [bytes]."""
FILES = 10_000
"""Most files in a zip file. # chosen"""
DATA = 1 << 28
"""Largest file of data that a program wrote for later [bytes]."""
FIGURES = (".png", ".svg", ".pdf")
"""Suffixes of a figure, in small or capital letters; they select its format."""
WRITTEN = "another run is writing it; name another file"


def regular(path: Path) -> int:
    """Size of a regular file [bytes]. Raises OSError, whose `strerror` says why it is not one."""
    try:
        found = path.stat()
    except ValueError:  # a name with a zero byte in it
        raise OSError(errno.EINVAL, "the name contains a zero byte", str(path)) from None
    if stat.S_ISDIR(found.st_mode):
        raise IsADirectoryError(errno.EISDIR, "it is a folder", str(path))
    if not stat.S_ISREG(found.st_mode):
        raise OSError(errno.EINVAL, "it is not a regular file", str(path))
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
        target = path.resolve()  # a symbolic link stays a link
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
        found = file.read(most + 1)
    if len(found) > most:
        raise OSError(errno.EFBIG, f"it is larger than {most >> 20} MiB, the largest size that is read", str(path))
    return found


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
