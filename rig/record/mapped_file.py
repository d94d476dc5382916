"""The bytes of a recording in memory, their checksums, and the place of its summary section."""

from __future__ import annotations

import hashlib
import mmap
import struct
import zlib
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from mcap.opcode import Opcode
from mcap.records import Footer

from rig.errors import LogError
from rig.record.byte_scan import Data, Found, walk
from rig.record.mcap_file import MAGIC
from rig.user_files import regular

_FOOTER = 29  # bytes
_OFFSET_HEAD = struct.pack("<BQ", Opcode.SUMMARY_OFFSET, 17)
_OFFSET = len(_OFFSET_HEAD) + 17  # bytes of a summary offset
_SLICE = 1 << 20


@contextmanager
def mapped(path: Path) -> Iterator[Data]:
    """The bytes of a file. Raises LogError if they cannot be read."""
    try:
        if not regular(path):  # an empty file cannot be mapped
            yield b""
            return
        with path.open("rb") as file, mmap.mmap(file.fileno(), 0, access=mmap.ACCESS_READ) as data:
            yield data
    except OSError as fault:
        raise LogError(f"{path} cannot be read: {fault.strerror}") from None


def summary_start(data: Data) -> int | None:
    """Begin of the summary section, if its checksum proves it; else None."""
    at = len(data) - _FOOTER - len(MAGIC)
    found = next(walk(data, at), None) if at > 0 else None
    if not isinstance(found, Found) or not isinstance(found.body, Footer):
        return None
    start, crc = _shifted(data, at, found.body), found.body.summary_crc
    if not 0 < start <= at or crc == 0 or crc_of(data, start, found.end - 4) != crc:
        return None
    return start


def _shifted(data: Data, at: int, footer: Footer) -> int:
    """Begin of the summary of the footer at byte `at`, also in a file that lost or gained bytes before it."""
    offsets = at
    while offsets >= _OFFSET and data[offsets - _OFFSET : offsets - _OFFSET + 9] == _OFFSET_HEAD:
        offsets -= _OFFSET
    begin = footer.summary_offset_start
    return footer.summary_start + (offsets - begin if begin else 0)


def _slices(data: Data, begin: int, end: int) -> Iterator[bytes]:
    return (data[at : min(at + _SLICE, end)] for at in range(begin, end, _SLICE))


def crc_of(data: Data, begin: int, end: int) -> int:
    """CRC-32 of the bytes from `begin` to `end`."""
    found = 0
    for part in _slices(data, begin, end):
        found = zlib.crc32(part, found)
    return found


def sha256_of(data: Data, end: int) -> str:
    """SHA-256 of the bytes up to `end` [64 hex digits]."""
    found = hashlib.sha256()
    for part in _slices(data, 0, end):
        found.update(part)
    return found.hexdigest()
