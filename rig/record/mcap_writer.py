"""A writer of MCAP files with small chunks, a checksum over every byte, and memory independent of the file's length.

    magic, header, attachments and metadata        the data section: a CRC at its end covers all of it, and before that
    chunk, message indexes, chunk, ...             the metadata record "digest" has the SHA-256 of all bytes up to it
    attachments and metadata, "digest", data end
    schemas, channels, statistics, indexes         the summary section: a CRC in the footer covers it and the footer
    footer, magic

Each chunk, attachment and metadata record has its own checksum as well, so that a reader finds the damaged parts and
keeps the rest. No chunk contains more than a 25th of the messages before it: one damaged chunk is less than 5 % of a
recording of any length. Schemas and channels are written in two chunks and in the summary.
"""

from __future__ import annotations

import hashlib
import struct
import tempfile
import zlib
from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Any, BinaryIO

import zstandard
from mcap.data_stream import RecordBuilder
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

from rig.record.mcap_file import CRC, DIGEST, MAGIC, PROFILE, checksum

SHARE = 25
"""Largest size of a chunk, as a share of the messages before it."""
_LEVEL = 6  # of zstd: chunks are small; a tenth smaller than with level 3 in the same time
SPILL = 1 << 22  # bytes of chunk indexes in memory: some 20 000 chunks; more go to a temporary file
_MESSAGE = struct.Struct("<BQHIQQ")
_INDEXED = struct.Struct("<QQ")
_INDEX = struct.Struct("<BQHI")
_END = struct.Struct("<BQQQ")


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
