"""Scanner of a recording, whole, cut off or damaged: yields every message proved by checksums and reports missing ones.

The file is read from front to back and not through its index, because a file that was cut off has none.

Its bytes are mapped into memory. If it is no recording of this project, the error says what it is instead.
"""

from __future__ import annotations

import hashlib
import math
import mmap
import struct
import zlib
from collections.abc import Iterable, Iterator, Mapping
from contextlib import contextmanager, suppress
from functools import reduce
from pathlib import Path
from typing import NamedTuple

import numpy as np
from mcap.opcode import Opcode
from mcap.records import Attachment, Channel, DataEnd, Footer, Header, Metadata, Schema, Statistics

from rig.bus.messages import decode, times
from rig.bus.topics import of, of_plant
from rig.errors import BusError, LogError
from rig.machine.files import regular
from rig.printable import counted
from rig.record.mcap_file import (
    COPY,
    CRC,
    DIGEST,
    MAGIC,
    PROFILE,
    Data,
    FileRecord,
    Hole,
    Messages,
    checksum,
    inside,
    refuse_newer,
    walk,
)

_OURS = {"scene.json", "setup.json"}
_SHOWN = 3  # channels of another file that a message names

_FOOTER = 29  # bytes
_OFFSET_HEAD = struct.pack("<BQ", Opcode.SUMMARY_OFFSET, 17)
_OFFSET = len(_OFFSET_HEAD) + 17  # bytes of a summary offset
_SLICE = 1 << 20  # bytes that are read at a time

_SEQUENCE = 1 << 32  # numbers of messages begin again after it: MCAP has 32 bits for them
_COPY = "a copy of a chunk before it,"
_UNPROVED = "its header or an index"
"""What differs if every record is intact and the checksum of the whole file is wrong."""
_NO_MESSAGES = (_COPY, "an attachment", "metadata")
"""Damaged places that contain no message."""


def why(
    data: Data,
    header: Header | None,
    attachments: Mapping[str, Attachment],
    metadata: Mapping[str, Mapping[str, str]],
    schemas: Iterable[Schema],
    channels: Iterable[Channel],
) -> str:
    """Return why nothing can be read from a file of which these records are intact; "" for a recording of a run.

    One intact description is enough: a damaged recording is still a recording.
    """
    if _OURS & attachments.keys() or "log" in metadata or any(schema.name.startswith("rig.") for schema in schemas):
        return ""
    topics = sorted(stream.topic for stream in channels)
    if header is not None and header.profile == PROFILE:
        return "" if topics else "it breaks off before the description of its run, and nothing of it can be read"
    if not len(data):
        return "the file is empty"
    if header is None and not topics:
        if data[: len(MAGIC)] == MAGIC:
            return "it breaks off before the description of its run, and nothing of it can be read"
        return f"it is not an MCAP file: it begins with the bytes {data[:4].hex(' ')}, not {MAGIC[:4].hex(' ')}"
    made = f"profile {header.profile[:40]!r}" if header is not None and header.profile else "no profile"
    if header is not None and header.library:
        made += f" and library {header.library[:40]!r}"
    more = ", ..." if len(topics) > _SHOWN else ""
    channel = f"; its channels: {', '.join(topic[:40] for topic in topics[:_SHOWN])}{more}" if topics else ""
    return f"it is an MCAP file of another program ({made}{channel}); read it with that program"


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
    record = next(walk(data, at), None) if at > 0 else None
    if not isinstance(record, FileRecord) or not isinstance(record.body, Footer):
        return None
    start = _shifted(data, at, record.body)
    crc = record.body.summary_crc
    if not 0 < start <= at or crc == 0 or crc_of(data, start, record.end - 4) != crc:
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
    return reduce(lambda crc, part: zlib.crc32(part, crc), _slices(data, begin, end), 0)


def sha256_of(data: Data, end: int) -> str:
    """SHA-256 of the bytes up to `end` [64 hex digits]."""
    digest = hashlib.sha256()
    for part in _slices(data, 0, end):
        digest.update(part)
    return digest.hexdigest()


def _missing(number: int) -> str:
    return f"{counted(number, 'message')} {'is' if number == 1 else 'are'} missing"


class Record(NamedTuple):
    """One message of a recording."""

    topic: str
    payload: bytes
    t_ns: int
    seq: int
    wall_ns: int
    """The wall clock when it was received [ns since 1970, UTC]."""


class Skipped(NamedTuple):
    """Damaged bytes of a recording that were skipped."""

    begin: int
    end: int
    what: str
    after_ns: int
    """Simulated time [ns] reached before them."""

    def __str__(self) -> str:
        if self.what == _UNPROVED:
            return f"nothing: every record was read, but {self.what} is not as it was recorded"
        place = f"{self.what} after t = {self.after_ns * 1e-9:.3f} s" if self.what else "no record is identifiable"
        return f"{self.end - self.begin} bytes from byte {self.begin} on: {place}"


class Scan:
    """A scan of a recording; each iteration reads the file again and yields its messages.

    `attachments`, `metadata`, `schemas` and `channels` are filled during the iteration, with undamaged entries only.
    Afterwards `whole` is true if every message exists and no damage was found, `fault` describes the damage, `skipped`
    its places.
    """

    def __init__(self, path: Path) -> None:
        self.path = path
        self._reset()

    def _reset(self) -> None:
        self.attachments: dict[str, Attachment] = {}
        self.metadata: dict[str, dict[str, str]] = {}
        self.schemas: dict[int, Schema] = {}
        self.channels: dict[int, Channel] = {}
        self._of_plant: set[int] = set()
        """Channels whose simulated times are those of the run."""
        self._of_blocks: set[int] = set()
        """Channels whose messages are blocks of samples."""
        self.whole = False
        self.sealed = False
        """Whether checksums prove every byte of the file; older recordings have no digest."""
        self.fault = ""
        self.skipped: list[Skipped] = []
        self.began_ns = 0
        """The wall clock at simulated time 0, by the first message of the plant [ns since 1970, UTC]."""
        self._begun_ns = 0
        """Latest simulated time of a message; that of a block is the time of its first sample."""
        self._blocks: dict[int, tuple[Messages, int]] = {}
        """Channel of blocks of samples -> chunk and place of its latest message."""
        self.count = 0
        self.missing: int | None = 0
        """Number of missing messages; None if unknown: the end is cut off, or the statistics are damaged too."""
        self._statistics: Statistics | None = None
        self._indexed = False
        """Whether the summary section exists and is intact."""
        self._end: FileRecord | None = None
        self._footer = False
        self._digest_at = -1
        self._header: Header | None = None
        """The record at the begin of every file; None if it is damaged or missing."""
        self._contents: set[int] = set()
        """Hashes of the chunks so far: no two are equal, since messages are numbered."""
        self._gaps = 0
        self._undescribed = 0
        """Number of intact messages whose channel description is lost."""
        self._seen: dict[int, tuple[int, int]] = {}
        """Channel -> number of its latest message, and the number of skipped places before it."""

    def __iter__(self) -> Iterator[Record]:
        for chunk in self._chunks():
            columns = (column.tolist() for column in (chunk.head["channel"], chunk.head["sequence"], *chunk.times()))
            for channel, sequence, t_ns, wall_ns, payload in zip(*columns, chunk.payloads()):
                yield Record(self.channels[channel].topic, payload, t_ns, sequence, wall_ns)

    def payloads(self, topics: tuple[str, ...]) -> dict[str, list[bytes]]:
        """Read the whole file: topic -> payloads in its order, for topics that begin with one of `topics`.

        Raises LogError for a file that is not a recording.
        """
        gathered: dict[str, list[bytes]] = {}
        for chunk in self._chunks():
            wanted = [number for number, described in self.channels.items() if described.topic.startswith(topics)]
            chunk = chunk.only(np.isin(chunk.head["channel"], wanted))
            for channel, payload in zip(chunk.head["channel"].tolist(), chunk.payloads()):
                gathered.setdefault(self.channels[channel].topic, []).append(payload)
        return gathered

    def _chunks(self) -> Iterator[Messages]:
        """Yield the messages of each chunk whose channels are described."""
        self._reset()
        with mapped(self.path) as data:
            self._look_up(data)
            for part in walk(data):
                if isinstance(part, Hole):
                    self._skip(part)
                elif part.opcode != Opcode.CHUNK:
                    self._note(part)
                elif (content := hash(part.body)) in self._contents:
                    self._skip(Hole(part.begin, part.end, _COPY))
                else:
                    self._contents.add(content)
                    yield self._described(part.body)
            self._conclude(data)

    def _look_up(self, data: Data) -> None:
        """Read schemas, channels and statistics from the summary, if its checksum proves it."""
        start = summary_start(data)
        self._indexed = start is not None
        for part in walk(data, start) if start is not None else ():
            body = part.body if isinstance(part, FileRecord) else None
            if isinstance(body, Statistics):
                self._statistics = body
                return
            self._describe(body)

    def _describe(self, record: object) -> None:
        if isinstance(record, Channel):
            self.channels[record.id] = record
            if of_plant(record.topic):
                self._of_plant.add(record.id)
            with suppress(BusError):  # of a topic that is not in the table
                if of(record.topic).message == "Block":
                    self._of_blocks.add(record.id)
        elif isinstance(record, Schema):
            self.schemas[record.id] = record

    def _described(self, content: bytes) -> Messages:
        """The messages of a chunk, counted; those whose channel was described in damaged chunks are left out."""
        descriptions, chunk = inside(content)
        for description in descriptions:
            self._describe(description)
        known = np.isin(chunk.head["channel"], list(self.channels))
        self._undescribed += int(np.count_nonzero(~known))
        chunk = chunk.only(known)
        if chunk.head.size:
            self._count(chunk)
        return chunk

    @property
    def last_ns(self) -> int:
        """Simulated time [ns] of the plant's last message or sample so far."""
        times_ns = [self._begun_ns]
        for channel, (chunk, place) in self._blocks.items():
            with suppress(BusError):  # not decodable: whoever reads the message reports it
                times_ns += times(decode(self.channels[channel].topic, chunk.payload(place)))[-1:].tolist()
        return max(times_ns)

    def _count(self, chunk: Messages) -> None:
        head = chunk.head
        self.count += head.size
        t_ns, wall_ns = chunk.only(np.isin(head["channel"], list(self._of_plant))).times()  # others may state any time
        if t_ns.size:
            self._begun_ns = max(self._begun_ns, int(t_ns.max()))
        if t_ns.size and not self.began_ns:
            apart = wall_ns - t_ns
            self.began_ns = int(apart[np.argmax(apart != 0)])
        channels = head["channel"].tolist()
        numbers = head["sequence"].tolist()
        first = dict(zip(reversed(channels), reversed(numbers)))
        last = dict(zip(channels, range(head.size)))
        here = len(self.skipped)
        for channel, number in first.items():
            before, holes = self._seen.get(channel, (number, here))
            gap = (number - before - 1) % _SEQUENCE
            if holes != here and gap < _SEQUENCE // 2:
                self._gaps += gap
            self._seen[channel] = numbers[last[channel]], here
            if channel in self._of_blocks:
                self._blocks[channel] = chunk, last[channel]

    def _skip(self, hole: Hole) -> None:
        what = hole.what
        if self._footer:
            what = "its last bytes"
        elif self._end is not None:
            what = "the index at its end"
        self.skipped.append(Skipped(hole.begin, hole.end, what, self.last_ns))

    def _note(self, part: FileRecord) -> None:
        body = part.body
        if isinstance(body, Footer):
            self._footer = True
        elif self._end is not None:  # the summary: read before
            pass
        elif isinstance(body, Header):
            self._header = body
        elif isinstance(body, DataEnd):
            self._end = part
        elif isinstance(body, Attachment):
            body.name = body.name.removeprefix(COPY)
            self.attachments[body.name] = body
        elif isinstance(body, Metadata):
            values = dict(body.metadata)
            name = body.name.removeprefix(COPY)
            if values.pop(CRC, None) not in (None, checksum(body.name, values)):
                self._skip(Hole(part.begin, part.end, "metadata"))
            elif name == DIGEST:
                self._digest_at = part.begin
                self.metadata[DIGEST] = values
            else:
                self.metadata[name] = values
                if name == "log":
                    refuse_newer(self.path, values)
        else:
            self._describe(body)

    def _conclude(self, data: Data) -> None:
        """Check the checksums of the whole file, and describe the damage in words."""
        records = (self.attachments, self.metadata, self.schemas.values(), self.channels.values())
        if reason := why(data, self._header, *records):
            raise LogError(f"{self.path} is not a recording of a run: {reason}")
        stated = self._end.body.data_section_crc if self._end is not None else 0
        proved = self._end is not None and stated == crc_of(data, 0, self._end.begin)
        digest = self.metadata.pop(DIGEST, {}).get("sha256", "")
        right = digest == sha256_of(data, self._digest_at) if digest else False
        self.sealed = proved and right and self._indexed and not self.skipped
        if self._end is not None and not self.skipped and ((stated and not proved) or (digest and not right)):
            self.skipped.append(Skipped(0, self._end.begin, _UNPROVED, 0))
        if self._end is None and self._footer and not self.skipped:
            self.skipped.append(Skipped(0, len(data), "the record that ends its messages", self.last_ns))
        cut = self._end is None and not self._footer
        known = self._gaps + self._undescribed
        # Gaps in the numbers do not show losses before the first and after the last message of a channel.
        self.missing = known if self._header is not None and not cut and self._taking() is None else None
        if self._statistics is not None:
            self.missing = self._statistics.message_count - self.count
        self.whole = not cut and self.missing == 0 and not self.skipped and self._indexed
        self.fault = "" if self.whole else self._damage_text(cut, data[-len(MAGIC) :] == MAGIC)

    def _taking(self) -> Skipped | None:
        """The first damaged place that may have contained messages; None if there is none."""
        end = self._end.begin if self._end is not None else math.inf
        return next(
            (skipped for skipped in self.skipped if skipped.begin < end and skipped.what not in _NO_MESSAGES), None
        )

    def _damage_text(self, cut: bool, ended: bool) -> str:
        known = self._gaps + self._undescribed
        if cut:
            front = "" if self._header is not None else "its beginning is damaged or missing; "
            before = f"; before that {_missing(known)}" if known else ""
            return f"{front}it breaks off after t = {self.last_ns * 1e-9:.3f} s{before}"
        place = self._taking() if self.missing is None and self._header is not None else None
        if place is not None:
            least = f"at least {_missing(known)}" if known else "how many messages are missing is unknown"
            what = place.what or "a record"
            return f"{what} {'are' if what.endswith('bytes') else 'is'} damaged; {least}"
        if self.missing is None:
            after = f"; after that {_missing(known)}" if known else ""
            return f"its beginning is damaged or missing{after}"
        if self.missing and self._statistics is not None:
            are = "is" if self.missing == 1 else "are"
            return f"{self.missing} of its {counted(self._statistics.message_count, 'message')} {are} missing"
        if self.missing:
            return f"{self.missing} of its messages {'is' if self.missing == 1 else 'are'} missing"
        end = self._end
        if not self.skipped or (end is not None and all(skipped.begin >= end.end for skipped in self.skipped)):
            return "the index at its end is damaged" if ended else "it breaks off in the index at its end"
        if all(skipped.what == _COPY for skipped in self.skipped):
            return "a chunk is in it twice; no message is missing"
        if self.skipped[0].what == _UNPROVED:
            return (
                f"{_UNPROVED} is damaged, or another program has written it again; "
                "no message that its index counts is missing"
            )
        what = self.skipped[0].what or "a record"
        return f"{what} {'are' if what.endswith('bytes') else 'is'} damaged; no message is missing"
