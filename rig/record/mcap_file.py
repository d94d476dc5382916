"""Scanner of the bytes of an MCAP file from front to back, which skips damaged parts.

A record is valid if the lengths inside it add up to its own length. After an invalid record the scan continues at the
next place with a valid one; the bytes between are a hole. A chunk in a hole is recovered if its checksum proves its
content: then only the frame of the chunk was damaged. `rig.record.mcap_writer` states the parts of a file.
"""

from __future__ import annotations

import mmap
import re
import struct
import zlib
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import zstandard
from mcap.data_stream import ReadDataStream
from mcap.opcode import Opcode
from mcap.records import (
    Attachment,
    AttachmentIndex,
    Channel,
    ChunkIndex,
    DataEnd,
    Footer,
    Header,
    Metadata,
    MetadataIndex,
    Schema,
    Statistics,
)
from numpy.typing import NDArray

from rig.errors import LogError

Data = bytes | mmap.mmap

HEAD = np.dtype(
    [("opcode", "u1"), ("length", "<u8"), ("channel", "<u2"), ("sequence", "<u4"), ("log", "<u8"), ("published", "<u8")]
)
"""What precedes the payload of a message: head of the record, channel, number, log time and publish time [ns]."""
_WALL_NS = 10**18
"""Log times from here on are the wall clock of format 1: as times since 1970 they are after 2001, as simulated times
after 31 years. The metadata that states the format may be damaged."""
_HEAD = struct.Struct("<BQ")
_LARGEST = 1 << 28  # bytes of a chunk's content; a damaged length must not claim the memory of the machine
_START = re.compile(rb"[\x01-\x0f](?=....\x00{4})", re.DOTALL)
_FRAME = b"\x28\xb5\x2f\xfd"  # the first bytes of every zstd frame

# The parts of each kind of record: a number of bytes, or the size of the length field of the part that follows.
_LAYOUT: dict[int, tuple[int | str, ...]] = {
    Opcode.HEADER: ("I", "I"),
    Opcode.FOOTER: (20,),
    Opcode.SCHEMA: (2, "I", "I", "I"),
    Opcode.CHANNEL: (4, "I", "I", "I"),
    Opcode.CHUNK: (28, "I", "Q"),
    Opcode.MESSAGE_INDEX: (2, "I"),
    Opcode.CHUNK_INDEX: (32, "I", 8, "I", 16),
    Opcode.ATTACHMENT: (16, "I", "I", "Q", 4),
    Opcode.ATTACHMENT_INDEX: (40, "I", "I"),
    Opcode.STATISTICS: (42, "I"),
    Opcode.METADATA: ("I", "I"),
    Opcode.METADATA_INDEX: (16, "I"),
    Opcode.SUMMARY_OFFSET: (17,),
    Opcode.DATA_END: (4,),
}
_KINDS: dict[int, Any] = {
    Opcode.HEADER: Header,
    Opcode.FOOTER: Footer,
    Opcode.SCHEMA: Schema,
    Opcode.CHANNEL: Channel,
    Opcode.CHUNK_INDEX: ChunkIndex,
    Opcode.ATTACHMENT: Attachment,
    Opcode.ATTACHMENT_INDEX: AttachmentIndex,
    Opcode.STATISTICS: Statistics,
    Opcode.METADATA: Metadata,
    Opcode.METADATA_INDEX: MetadataIndex,
    Opcode.DATA_END: DataEnd,
}
_NAMES = {
    Opcode.CHUNK: "a chunk of messages",
    Opcode.MESSAGE_INDEX: "an index",
    Opcode.CHUNK_INDEX: "an index",
    Opcode.ATTACHMENT: "an attachment",
    Opcode.METADATA: "metadata",
}

MAGIC = b"\x89MCAP0\r\n"
PROFILE = "friction-rig"
FORMAT = 2
"""Format of recordings: their attachments, metadata and topics, and what these mean. The metadata record "log"
states it; a recording without it has format 1. The scene in a recording has its own format (`Scene.from_json`).
In format 1 `publish_time` was simulated time and `log_time` the wall clock (`rig.record.mcap_file.Messages.times`)."""
COPY = "copy/"
"""Begin of the names of the attachments and metadata at the end of a file: other programs warn about equal names."""
CRC = "crc32"
DIGEST = "digest"


class FileRecord(NamedTuple):
    """A record from byte `begin` to `end`; `body`: the record as parsed by mcap, or the content of a chunk; None if
    unusable.
    """

    begin: int
    end: int
    opcode: int
    body: Any


class Hole(NamedTuple):
    """Bytes that are not a record, or a damaged record; `cut` if the file ends within it."""

    begin: int
    end: int
    what: str
    cut: bool = False


class Messages(NamedTuple):
    """Messages in the content of one chunk: `head` has a row of the type `HEAD` for each, `begin` its first byte."""

    content: bytes
    begin: NDArray[np.int64]
    head: NDArray[np.void]

    def only(self, here: NDArray[np.bool_]) -> Messages:
        """The messages whose entry in `here` is true."""
        return Messages(self.content, self.begin[here], self.head[here])

    def times(self) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
        """Simulated time [ns], and the wall clock at reception [ns since 1970, UTC], of each message."""
        log = self.head["log"]
        published = self.head["published"]
        former = log >= _WALL_NS
        stamps = np.where(former, published, log), np.where(former, log, published)
        return stamps[0].astype(np.int64), stamps[1].astype(np.int64)

    def payload(self, number: int) -> bytes:
        """The payload of one message."""
        begin = int(self.begin[number]) + HEAD.itemsize
        return self.content[begin : int(self.begin[number]) + _HEAD.size + int(self.head["length"][number])]

    def payloads(self) -> Iterator[bytes]:
        """Yield the payload of each message, in order."""
        ends = self.begin + _HEAD.size + self.head["length"].astype(np.int64)
        for begin, end in zip((self.begin + HEAD.itemsize).tolist(), ends.tolist()):
            yield self.content[begin:end]


def walk(data: Data, at: int = 0) -> Iterator[FileRecord | Hole]:
    """Yield every record of `data` from byte `at` on and every hole between them, in order; magic bytes are not
    records.
    """
    size = len(data)
    if at == 0:
        if data[: len(MAGIC)] == MAGIC:
            at = len(MAGIC)
        else:
            at = _next(data, 0)
            yield from _hole(data, 0, at, "its first bytes")
    while at < size:
        if data[at : at + len(MAGIC)] == MAGIC and at + len(MAGIC) == size:
            return
        opcode, end = _extent(data, at)
        if _fits(data, at, opcode, end):
            made = _read(data, at, opcode, end)
            yield made if made is not None else Hole(at, end, _NAMES.get(Opcode(opcode), "a record"))
        elif _starts(data, end):  # the length is right, but the record is damaged or of a kind that we never write
            what = _NAMES.get(Opcode(opcode), "a record") if opcode in _LAYOUT else ""
            yield from _hole(data, at, end, what)
        else:
            end = _next(data, at + 1)
            yield from _hole(data, at, end, "", cut=end == size)
        at = end


def _extent(data: Data, at: int) -> tuple[int, int]:
    """Opcode and end of the record that begins at `at`; the end is 0 if there cannot be a record."""
    if at + _HEAD.size > len(data):
        return 0, 0
    opcode, length = _HEAD.unpack_from(data, at)
    end = at + _HEAD.size + length
    return opcode, end if end <= len(data) else 0


def _fits(data: Data, at: int, opcode: int, end: int) -> bool:
    """Whether the lengths inside a record add up to its own."""
    layout = _LAYOUT.get(opcode)
    place = at + _HEAD.size
    if layout is None or not end:
        return False
    for part in layout:
        if isinstance(part, str):
            size = struct.calcsize(f"<{part}")
            if place + size > end:
                return False
            (part,) = struct.unpack_from(f"<{part}", data, place)
            place += size
        place += part
    return place == end


def _starts(data: Data, at: int) -> bool:
    """Whether a record begins at `at`, or the file correctly ends there."""
    if not at or at >= len(data):
        return False
    return (at + len(MAGIC) == len(data) and data[at:] == MAGIC) or _fits(data, at, *_extent(data, at))


def _next(data: Data, at: int) -> int:
    """The first place from `at` on where a record begins; the end of the data if there is none."""
    for match in _START.finditer(data, at):
        if _fits(data, match.start(), *_extent(data, match.start())):
            return match.start()
    return len(data)


def _hole(data: Data, begin: int, end: int, what: str, cut: bool = False) -> Iterator[FileRecord | Hole]:
    """The damaged part between two places, and the chunks in it whose content is intact."""
    at = begin
    while (at := data.find(_FRAME, at, end)) >= 0:
        if (content := _content(data, at, end)) is not None:
            yield Hole(begin, end, what or "the frame of a chunk")
            yield FileRecord(begin, end, Opcode.CHUNK, content)
            return
        at += 1
    yield Hole(begin, end, what, cut)


def _read(data: Data, at: int, opcode: int, end: int) -> FileRecord | None:
    """A valid record; None if its own checksum or its text shows damage."""
    body = at + _HEAD.size
    if opcode == Opcode.CHUNK:
        content = _chunk(data, body, end)
        return None if content is None else FileRecord(at, end, opcode, content)
    kind = _KINDS.get(opcode)
    if kind is None:
        return FileRecord(at, end, opcode, None)
    raw = data[body:end]
    if opcode == Opcode.ATTACHMENT:
        (crc,) = struct.unpack_from("<I", raw, len(raw) - 4)
        if crc not in (0, zlib.crc32(raw[:-4])):
            return None
    try:
        return FileRecord(at, end, opcode, kind.read(_Stream(raw)))
    except (UnicodeDecodeError, struct.error, EOFError):
        return None


class _Stream(ReadDataStream):
    """A stream of bytes in memory for the parser of mcap; a short read is an error."""

    def __init__(self, raw: bytes) -> None:
        self._raw = raw
        self._count = 0

    def read(self, length: int) -> bytes:
        content = self._raw[self._count : self._count + length]
        if len(content) < length:
            raise EOFError
        self._count += length
        return content


def _chunk(data: Data, body: int, end: int) -> bytes | None:
    """The content of a chunk record; None if its checksum does not prove it."""
    size, crc, length = struct.unpack_from("<QII", data, body + 16)
    kind = data[body + 32 : body + 32 + length]
    begin = body + 40 + length
    if kind:  # we compress with zstd only, so that any other name is damaged
        return _content(data, begin, end)
    return data[begin:end] if crc in (0, zlib.crc32(data[begin:end])) and size == end - begin else None


def _content(data: Data, at: int, end: int) -> bytes | None:
    """The content of the zstd frame at `at`; None unless its own checksum or that of its chunk proves it."""
    try:
        about = zstandard.get_frame_parameters(data[at : min(at + 32, end)])
        if about.content_size > _LARGEST:
            return None
        inflate = zstandard.ZstdDecompressor(max_window_size=_LARGEST).decompressobj()
        content: bytes = inflate.decompress(data[at:end])
    except (zstandard.ZstdError, MemoryError):
        return None
    if not inflate.eof or len(content) != about.content_size:
        return None
    if not about.has_checksum:
        before = data[at - 20 : at - 16]  # the CRC in the record of the chunk; 0: it has none
        if len(before) < 4 or struct.unpack("<I", before)[0] not in (0, zlib.crc32(content)):
            return None
    return content


def inside(content: bytes) -> tuple[list[Schema | Channel], Messages]:
    """Return the records in the content of a chunk: descriptions and messages, each in order."""
    described = list[Schema | Channel]()
    begin = list[int]()
    at = 0
    size = len(content)
    while at + _HEAD.size <= size:  # for every message of a recording: nothing else is done for each of them
        opcode, length = _HEAD.unpack_from(content, at)
        if opcode == Opcode.MESSAGE:
            begin.append(at)
        elif opcode == Opcode.SCHEMA:
            described.append(Schema.read(_Stream(content[at + _HEAD.size : at + _HEAD.size + length])))
        elif opcode == Opcode.CHANNEL:
            described.append(Channel.read(_Stream(content[at + _HEAD.size : at + _HEAD.size + length])))
        at += _HEAD.size + length
    starts = np.array(begin, np.int64)
    head = np.frombuffer(content, np.uint8)[starts[:, None] + np.arange(HEAD.itemsize)]
    return described, Messages(content, starts, head.view(HEAD)[:, 0])


def refuse_newer(path: Path, log: Mapping[str, str]) -> None:
    """Raise LogError for a recording of a format that only newer versions can read. `log`: its metadata "log"."""
    written = log.get("format", "1")
    if not written.isdecimal() or int(written) > FORMAT:
        raise LogError(
            f"{path} is a recording of format {written[:20]}, written by a newer version of friction-rig; "
            f"this version reads recordings up to format {FORMAT}: install a newer version"
        )


def checksum(name: str, values: Mapping[str, str]) -> str:
    """Return the checksum of a metadata record, independent of the order of its values; the record stores it under
    `CRC`.
    """
    texts = [name]
    for key in sorted(values):
        if key != CRC:
            texts += [key, values[key]]
    packed = bytearray()
    for text in texts:
        raw = text.encode()
        packed += struct.pack("<I", len(raw)) + raw
    return f"{zlib.crc32(packed):08x}"
