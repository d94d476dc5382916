"""A writer of MCAP files with small chunks, a checksum over every byte, and memory independent of the file's length.

    magic, header, attachments and metadata        the data section: a CRC at its end covers all of it, and before that
    chunk, message indexes, chunk, ...             the metadata record "digest" has the SHA-256 of all bytes up to it
    attachments and metadata, "digest", data end
    schemas, channels, statistics, indexes         the summary section: a CRC in the footer covers it and the footer
    footer, magic

Each chunk, attachment and metadata record has its own checksum as well, so that a reader finds the damaged parts and
keeps the rest. No chunk contains more than a 25th of the messages before it: one damaged chunk is less than 5 % of a
recording of any length. Schemas and channels are written in two chunks and in the summary.

Scanner of the bytes of an MCAP file from front to back, which skips damaged parts.

A record is valid if the lengths inside it add up to its own length. After an invalid record the scan continues at the
next place with a valid one; the bytes between are a hole. A chunk in a hole is recovered if its checksum proves its
content: then only the frame of the chunk was damaged.
"""

from __future__ import annotations

import hashlib
import mmap
import re
import struct
import tempfile
import zlib
from collections.abc import Iterable, Iterator, Mapping
from pathlib import Path
from typing import Any, BinaryIO, NamedTuple

import numpy as np
import zstandard
from mcap.data_stream import ReadDataStream, RecordBuilder
from mcap.opcode import Opcode
from mcap.records import (
    Attachment,
    AttachmentIndex,
    Channel,
    Chunk,
    ChunkIndex,
    DataEnd,
    Footer,
    Header,
    Metadata,
    MetadataIndex,
    Schema,
    Statistics,
    SummaryOffset,
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
SHARE = 25
"""Largest size of a chunk, as a share of the messages before it."""
_LEVEL = 6  # of zstd: chunks are small; a tenth smaller than with level 3 in the same time
SPILL = 1 << 22  # bytes of chunk indexes in memory: some 20 000 chunks; more go to a temporary file
_MESSAGE = struct.Struct("<BQHIQQ")
_INDEXED = struct.Struct("<QQ")
_INDEX = struct.Struct("<BQHI")
_END = struct.Struct("<BQQQ")


class Found(NamedTuple):
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


def walk(data: Data, at: int = 0) -> Iterator[Found | Hole]:
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


def _hole(data: Data, begin: int, end: int, what: str, cut: bool = False) -> Iterator[Found | Hole]:
    """The damaged part between two places, and the chunks in it whose content is intact."""
    at = begin
    while (at := data.find(_FRAME, at, end)) >= 0:
        if (content := _content(data, at, end)) is not None:
            yield Hole(begin, end, what or "the frame of a chunk")
            yield Found(begin, end, Opcode.CHUNK, content)
            return
        at += 1
    yield Hole(begin, end, what, cut)


def _read(data: Data, at: int, opcode: int, end: int) -> Found | None:
    """A valid record; None if its own checksum or its text shows damage."""
    body = at + _HEAD.size
    if opcode == Opcode.CHUNK:
        content = _chunk(data, body, end)
        return None if content is None else Found(at, end, opcode, content)
    kind = _KINDS.get(opcode)
    if kind is None:
        return Found(at, end, opcode, None)
    raw = data[body:end]
    if opcode == Opcode.ATTACHMENT:
        (crc,) = struct.unpack_from("<I", raw, len(raw) - 4)
        if crc not in (0, zlib.crc32(raw[:-4])):
            return None
    try:
        return Found(at, end, opcode, kind.read(_Stream(raw)))
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


class Writer:
    """An MCAP file that is written from front to back to `stream`; `finish` does not close the stream.

    `folder`: for a temporary file that a long run needs, on the disk of the file. Errors of the stream are raised to
    the caller; the file is then cut off there.
    """

    def __init__(self, stream: BinaryIO, chunk_size: int, folder: Path | None = None) -> None:
        self.__stream = stream
        self._chunk_size = chunk_size
        self._compressor = zstandard.ZstdCompressor(_LEVEL, write_checksum=True)
        self._offset = 0
        self._crc = 0
        self._sha = hashlib.sha256()
        self._schemas: dict[int, Schema] = {}
        self._channels: dict[int, Channel] = {}
        self._fresh: list[Schema | Channel] = []
        """Described for the first time in this chunk; the next chunk repeats it."""
        self.counts: dict[int, int] = {}
        """Channel -> number of its messages."""
        self._messages = self._chunks = 0
        self.reached_ns = 0
        """Simulated time up to which the run has been added; the caller states it."""
        self._ends: list[tuple[int, int]] = []
        """Ends of the chunks that the system may not have yet, and the simulated time that each reaches."""
        self._first_ns = (1 << 64) - 1
        self._last_ns = 0
        self._attached: list[AttachmentIndex] = []
        self._noted: list[MetadataIndex] = []
        self._begin_chunk()
        self._put(MAGIC + _packed(Header(PROFILE, PROFILE)))
        self._chunk_indexes = tempfile.SpooledTemporaryFile(SPILL, dir=None if folder is None else str(folder))

    def _put(self, raw: bytes) -> None:
        self.__stream.write(raw)
        self._offset += len(raw)
        self._crc = zlib.crc32(raw, self._crc)
        self._sha.update(raw)

    def _begin_chunk(self) -> None:
        self._parts: list[bytes] = []
        self._size = self._held = 0
        self._indexes: dict[int, bytearray] = {}
        self._span = ((1 << 64) - 1, 0)

    def attach(self, name: str, media_type: str, raw: bytes, made_ns: int, log_ns: int = 0) -> None:
        """Add an attachment. `made_ns`: the wall clock when it was made."""
        self._end_chunk()
        packed = _packed(Attachment(made_ns, log_ns, name, media_type, raw))
        index = AttachmentIndex(self._offset, len(packed), log_ns, made_ns, len(raw), name, media_type)
        self._attached.append(index)
        self._put(packed)

    def note(self, name: str, values: Mapping[str, str]) -> None:
        """Add a metadata record."""
        self._end_chunk()
        packed = _packed(Metadata(name, {**values, CRC: checksum(name, values)}))
        self._noted.append(MetadataIndex(self._offset, len(packed), name))
        self._put(packed)

    def schema(self, name: str, encoding: str, described: bytes) -> int:
        """Describe a type of messages; return its number."""
        made = Schema(id=len(self._schemas) + 1, data=described, encoding=encoding, name=name)
        self._schemas[made.id] = made
        self._describe(made)
        return made.id

    def channel(self, topic: str, encoding: str, schema: int, metadata: Mapping[str, str]) -> int:
        """Describe a channel; return its number."""
        made = Channel(len(self._channels) + 1, topic, encoding, dict(metadata), schema)
        self._channels[made.id] = made
        self.counts[made.id] = 0
        self._describe(made)
        return made.id

    def _describe(self, description: Schema | Channel) -> None:
        self._fresh.append(description)
        self._hold(_packed(description))

    def _hold(self, raw: bytes) -> None:
        self._parts.append(raw)
        self._size += len(raw)

    def add(self, channel: int, log_ns: int, payload: bytes, published_ns: int, seq: int) -> None:
        """Add a message; close the chunk if it is large enough."""
        index = self._indexes.get(channel)
        if index is None:
            index = self._indexes[channel] = bytearray()
        index += _INDEXED.pack(log_ns, self._size)
        self._hold(_MESSAGE.pack(Opcode.MESSAGE, 22 + len(payload), channel, seq, log_ns, published_ns) + payload)
        self._span = (min(self._span[0], log_ns), max(self._span[1], log_ns))
        self.counts[channel] += 1
        self._held += 1
        if self._size > self._chunk_size or self._held * SHARE > self._messages:
            self._end_chunk()

    def _end_chunk(self) -> None:
        if not self._held:
            return
        content = b"".join(self._parts)
        packed = self._compressor.compress(content)
        start = self._offset
        begin, end = self._span
        record = _packed(Chunk("zstd", packed, end, begin, zlib.crc32(content), len(content)))
        self._put(record)
        self._ends.append((self._offset, self.reached_ns))
        offsets = dict[int, int]()
        raw = bytearray()
        for channel, places in self._indexes.items():
            offsets[channel] = self._offset + len(raw)
            raw += _INDEX.pack(Opcode.MESSAGE_INDEX, 6 + len(places), channel, len(places)) + places
        self._put(bytes(raw))
        index = ChunkIndex(
            chunk_length=len(record),
            chunk_start_offset=start,
            compression="zstd",
            compressed_size=len(packed),
            message_end_time=end,
            message_index_length=len(raw),
            message_index_offsets=offsets,
            message_start_time=begin,
            uncompressed_size=len(content),
        )
        self._chunk_indexes.write(_packed(index))
        self._chunks += 1
        self._messages += self._held
        self._first_ns = min(self._first_ns, begin)
        self._last_ns = max(self._last_ns, end)
        again = self._fresh
        self._fresh = []
        self._begin_chunk()
        for description in again:
            self._hold(_packed(description))

    @property
    def size(self) -> int:
        """Size of the file [bytes] after a flush."""
        return self._offset

    def flush(self) -> None:
        """Close the chunk and pass everything to the system."""
        self._end_chunk()
        self.__stream.flush()
        self._ends = self._ends[-1:]

    def reached(self, size: int) -> int:
        """Return the simulated time that the chunks complete in the first `size` bytes reach; 0 if there is none."""
        return next((t_ns for end, t_ns in reversed(self._ends) if end <= size), 0)

    def finish(self) -> None:
        """Write digest, indexes and footer."""
        self._end_chunk()
        self.note(DIGEST, {"sha256": self._sha.hexdigest()})
        self._put(_packed(DataEnd(self._crc)))
        start = self._offset
        self._crc = 0
        self._chunk_indexes.seek(0)
        groups = [
            self._group(Opcode.SCHEMA, map(_packed, self._schemas.values())),
            self._group(Opcode.CHANNEL, map(_packed, self._channels.values())),
            self._group(Opcode.STATISTICS, [_packed(self._statistics())]),
            self._group(Opcode.CHUNK_INDEX, iter(lambda: self._chunk_indexes.read(1 << 20), b"")),
            self._group(Opcode.ATTACHMENT_INDEX, map(_packed, self._attached)),
            self._group(Opcode.METADATA_INDEX, map(_packed, self._noted)),
        ]
        offsets = self._offset
        self._put(b"".join(_packed(group) for group in groups if group.group_length))
        crc = zlib.crc32(_END.pack(Opcode.FOOTER, 20, start, offsets), self._crc)
        self._put(_packed(Footer(start, offsets, crc)) + MAGIC)
        self.__stream.flush()
        self.discard()

    def discard(self) -> None:
        """Delete temporary data beside the file, whether it is finished or not."""
        self._chunk_indexes.close()

    def _group(self, opcode: Opcode, records: Iterable[bytes]) -> SummaryOffset:
        start = self._offset
        for raw in records:
            self._put(raw)
        return SummaryOffset(opcode, start, self._offset - start)

    def _statistics(self) -> Statistics:
        return Statistics(
            attachment_count=len(self._attached),
            channel_count=len(self._channels),
            channel_message_counts=self.counts,
            chunk_count=self._chunks,
            message_count=self._messages,
            message_end_time=self._last_ns,
            message_start_time=min(self._first_ns, self._last_ns),
            metadata_count=len(self._noted),
            schema_count=len(self._schemas),
        )


def _packed(record: Any) -> bytes:
    builder = RecordBuilder()
    record.write(builder)
    return bytes(builder.end())  # type: ignore[no-untyped-call]
