"""Scanner of a recording, whole, cut off or damaged: yields every message proved by checksums and reports missing ones.

The file is read from front to back and not through its index, because a file that was cut off has none.
"""

from __future__ import annotations

import hashlib
import json
import math
import mmap
import stat
import struct
import zlib
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import replace as changed
from pathlib import Path
from typing import NamedTuple

from mcap.opcode import Opcode
from mcap.records import Attachment, Channel, DataEnd, Footer, Header, Metadata, Schema, Statistics

from rig.bus.run_setup import Setup
from rig.errors import LogError
from rig.record import model_attachments
from rig.record.byte_scan import Data, Found, Hole, Message, inside, walk
from rig.record.mcap_file import CRC, DIGEST, FORMAT, MAGIC, checksum

_FOOTER = 29  # bytes
_OFFSET_HEAD = struct.pack("<BQ", Opcode.SUMMARY_OFFSET, 17)
_OFFSET = len(_OFFSET_HEAD) + 17  # bytes of a summary offset
_SLICE = 1 << 20
_SEQUENCE = 1 << 32
_COPY = "a copy of a chunk that stands before it,"
_NO_MESSAGES = (_COPY, "an attachment", "metadata")
"""Damaged places that contain no message."""


class Record(NamedTuple):
    """One message of a recording."""

    topic: str
    payload: bytes
    t_ns: int
    seq: int
    log_ns: int


class Skipped(NamedTuple):
    """Damaged bytes of a recording that were skipped."""

    begin: int
    end: int
    what: str
    after_ns: int
    """Simulated time [ns] reached before them."""

    def __str__(self) -> str:
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
        self.whole = False
        self.sealed = False
        """Whether checksums prove every byte of the file; older recordings have no digest."""
        self.fault = ""
        self.skipped: list[Skipped] = []
        self.last_ns = 0
        self.count = 0
        self.missing: int | None = 0
        """Number of missing messages; None if unknown: the end is cut off, or the statistics are damaged too."""
        self._statistics: Statistics | None = None
        self._indexed = False
        """Whether the summary section exists and is intact."""
        self._end: Found | None = None
        self._footer = False
        self._digest_at = -1
        self._headed = False
        """Whether the record at the begin of every file exists."""
        self._chunks: set[bytes] = set()
        """Digests of the chunks so far: no two are equal, since messages are numbered."""
        self._gaps = 0
        self._undescribed = 0
        """Number of intact messages whose channel description is lost."""
        self._seen: dict[int, tuple[int, int]] = {}
        """Channel -> number of its latest message, and the number of skipped places before it."""

    def __iter__(self) -> Iterator[Record]:
        for message in self.messages():
            topic = self.channels[message.channel_id].topic
            yield Record(topic, message.data, message.publish_time, message.sequence, message.log_time)

    def messages(self) -> Iterator[Message]:
        """Yield the messages in the order of the file. Raises LogError for a file that is not a recording."""
        self._reset()
        with _mapped(self.path) as data:
            self._look_up(data)
            for part in walk(data):
                if isinstance(part, Hole):
                    self._skip(part)
                elif part.opcode == Opcode.CHUNK and self._is_copy(part.body):
                    self._skip(Hole(part.begin, part.end, _COPY))
                elif part.opcode == Opcode.CHUNK:
                    yield from self._messages(part.body)
                else:
                    self._note(part)
            self._conclude(data)

    def _look_up(self, data: Data) -> None:
        """Read schemas, channels and statistics from the summary, if its checksum proves it."""
        at = len(data) - _FOOTER - len(MAGIC)
        found = next(walk(data, at), None) if at > 0 else None
        if not isinstance(found, Found) or not isinstance(found.body, Footer):
            return
        start, crc = _shifted(data, at, found.body), found.body.summary_crc
        if not 0 < start <= at or crc == 0 or _crc(data, start, found.end - 4) != crc:
            return
        self._indexed = True
        for part in walk(data, start):
            body = part.body if isinstance(part, Found) else None
            if isinstance(body, Statistics):
                self._statistics = body
                return
            self._describe(body)

    def _describe(self, record: object) -> None:
        if isinstance(record, Channel):
            self.channels[record.id] = record
        elif isinstance(record, Schema):
            self.schemas[record.id] = record

    def _is_copy(self, content: bytes) -> bool:
        """Whether this chunk was read before."""
        known, digest = len(self._chunks), hashlib.blake2b(content, digest_size=16).digest()
        self._chunks.add(digest)
        return len(self._chunks) == known

    def _messages(self, content: bytes) -> Iterator[Message]:
        for one in inside(content):
            if not isinstance(one, Message):
                self._describe(one)
            elif one.channel_id in self.channels:
                self._count(one)
                yield one
            else:  # its description was in damaged chunks
                self._undescribed += 1

    def _count(self, message: Message) -> None:
        self.count += 1
        self.last_ns = max(self.last_ns, message.publish_time)
        now = (message.sequence, len(self.skipped))
        last, before = self._seen.get(message.channel_id, now)
        self._seen[message.channel_id] = now
        if before != now[1] and (gap := (now[0] - last - 1) % _SEQUENCE) < _SEQUENCE // 2:
            self._gaps += gap

    def _skip(self, hole: Hole) -> None:
        if self._footer:
            hole = Hole(hole.begin, hole.end, "its last bytes")
        elif self._end is not None:
            hole = Hole(hole.begin, hole.end, "the index at its end")
        self.skipped.append(Skipped(hole.begin, hole.end, hole.what, self.last_ns))

    def _note(self, part: Found) -> None:
        body = part.body
        if isinstance(body, Footer):
            self._footer = True
        elif self._end is not None:  # the summary: read before
            pass
        elif isinstance(body, Header):
            self._headed = True
        elif isinstance(body, DataEnd):
            self._end = part
        elif isinstance(body, Attachment):
            self.attachments[body.name] = body
        elif isinstance(body, Metadata):
            values = dict(body.metadata)
            if values.pop(CRC, None) not in (None, checksum(body.name, values)):
                self._skip(Hole(part.begin, part.end, "metadata"))
            elif body.name == DIGEST:
                self._digest_at, self.metadata[DIGEST] = part.begin, values
            else:
                self.metadata[body.name] = values
                self._accept(values.get("format", "1") if body.name == "log" else "1")
        else:
            self._describe(body)

    def _accept(self, written: str) -> None:
        """Raise LogError for a recording of a format that only newer versions can read."""
        if not written.isdecimal() or int(written) > FORMAT:
            raise LogError(
                f"{self.path} is a recording of format {written[:20]}, written by a newer version of friction-rig; "
                f"this version reads recordings up to format {FORMAT}: install a newer version"
            )

    def _conclude(self, data: Data) -> None:
        """Check the checksums of the whole file, and describe the damage in words."""
        if not (self.attachments or self.metadata or self.channels):
            raise LogError(f"{self.path} is not a recording of a run")
        told = self._end.body.data_section_crc if self._end is not None else 0
        proved = self._end is not None and told == _crc(data, 0, self._end.begin)
        digest = self.metadata.pop(DIGEST, {}).get("sha256", "")
        right = digest == _sha256(data, self._digest_at) if digest else False
        self.sealed = proved and right and self._indexed and not self.skipped
        if self._end is not None and not self.skipped and ((told and not proved) or (digest and not right)):
            self.skipped.append(Skipped(0, self._end.begin, "its header or an index", 0))
        if self._end is None and self._footer and not self.skipped:
            self.skipped.append(Skipped(0, len(data), "the record that ends its messages", self.last_ns))
        cut = self._end is None and not self._footer
        known = self._gaps + self._undescribed
        # Gaps in the numbers do not show losses before the first and after the last message of a channel.
        self.missing = known if self._headed and not cut and self._taking() is None else None
        if self._statistics is not None:
            self.missing = self._statistics.message_count - self.count
        self.whole = not cut and self.missing == 0 and not self.skipped and self._indexed
        self.fault = "" if self.whole else self._told(cut, data[-len(MAGIC) :] == MAGIC)

    def _taking(self) -> Skipped | None:
        """The first damaged place that may have contained messages; None if there is none."""
        end = self._end.begin if self._end is not None else math.inf
        return next((one for one in self.skipped if one.begin < end and one.what not in _NO_MESSAGES), None)

    def _told(self, cut: bool, ended: bool) -> str:
        known = self._gaps + self._undescribed
        if cut:
            front = "" if self._headed else "its beginning is damaged or missing; "
            before = f"; before that {known} messages are missing" if known else ""
            return f"{front}it breaks off after t = {self.last_ns * 1e-9:.3f} s{before}"
        if self.missing is None and self._headed and (place := self._taking()) is not None:
            least = f"at least {known} messages are missing" if known else "how many messages are missing is unknown"
            return f"{place.what or 'a record'} is damaged; {least}"
        if self.missing is None:
            after = f"; after that {known} messages are missing" if known else ""
            return f"its beginning is damaged or missing{after}"
        if self.missing and self._statistics is not None:
            return f"{self.missing} of its {self._statistics.message_count} messages are missing"
        if self.missing:
            return f"{self.missing} of its messages are missing"
        if not self.skipped or all(self._end is not None and one.begin >= self._end.end for one in self.skipped):
            return "the index at its end is damaged" if ended else "it breaks off in the index at its end"
        if all(one.what == _COPY for one in self.skipped):
            return "a chunk stands in it twice; no message is missing"
        return f"{self.skipped[0].what or 'a record'} is damaged; no message is missing"

    @property
    def described(self) -> bool:
        """Whether setup and scene have been read."""
        return {"setup.json", "scene.json"} <= self.attachments.keys()

    def setup(self) -> Setup:
        """Return the description of the plant; damaged parts, except the scene, are derived from the channels.

        Raises LogError if nothing describes a run.
        """
        scene = self.attachments.get("scene.json")
        given = {"scene": scene.data.decode() if scene else ""}
        models = tuple(model_attachments.models(self.attachments.values()))
        if (told := self.attachments.get("setup.json")) is None:
            return changed(self._derived(given["scene"]), models=models)
        try:
            return changed(Setup.from_json({**json.loads(told.data), **given}), models=models)
        except (KeyError, TypeError, ValueError) as fault:
            raise LogError(f"{self.path} does not describe its run: {fault!r} is missing or unreadable") from None

    def _derived(self, scene: str) -> Setup:
        outputs, sensors, controllers = dict[str, str](), dict[str, tuple[str, int]](), dict[str, dict[str, str]]()
        for channel in self.channels.values():
            first, _, name = channel.topic.partition("/")
            unit = channel.metadata.get("v", "")
            if first == "state":
                outputs |= channel.metadata
            elif first == "truth" and name != "mode":
                outputs[name] = unit
            elif first == "meas":
                sensors[name] = (unit, 0)
            elif first == "applied":
                controllers[name] = {}
        if not (outputs or sensors):
            raise LogError(f"{self.path} does not describe its run")
        run = self.metadata.get("log", {}).get("run", self.path.stem)
        return Setup(run, scene, 0, 0, outputs, sensors, controllers)


def head(path: Path) -> Scan:
    """Return a scan up to setup and provenance: before the first message, or at the end if that part is damaged."""
    scan = Scan(path)
    for _ in scan:
        if scan.described:
            break
    return scan


@contextmanager
def _mapped(path: Path) -> Iterator[Data]:
    """The bytes of a file. Raises LogError if they cannot be read."""
    try:
        with path.open("rb") as file:
            if not stat.S_ISREG(path.stat().st_mode):
                raise LogError(f"{path} is not a file")
            if not path.stat().st_size:  # an empty file cannot be mapped
                yield b""
                return
            with mmap.mmap(file.fileno(), 0, access=mmap.ACCESS_READ) as data:
                yield data
    except OSError as fault:
        raise LogError(f"{path} cannot be read: {fault.strerror}") from None


def _shifted(data: Data, at: int, footer: Footer) -> int:
    """Begin of the summary of the footer at byte `at`, also in a file that lost or gained bytes before it."""
    offsets = at
    while offsets >= _OFFSET and data[offsets - _OFFSET : offsets - _OFFSET + 9] == _OFFSET_HEAD:
        offsets -= _OFFSET
    begin = footer.summary_offset_start
    return footer.summary_start + (offsets - begin if begin else 0)


def _slices(data: Data, begin: int, end: int) -> Iterator[bytes]:
    return (data[at : min(at + _SLICE, end)] for at in range(begin, end, _SLICE))


def _crc(data: Data, begin: int, end: int) -> int:
    found = 0
    for part in _slices(data, begin, end):
        found = zlib.crc32(part, found)
    return found


def _sha256(data: Data, end: int) -> str:
    found = hashlib.sha256()
    for part in _slices(data, 0, end):
        found.update(part)
    return found.hexdigest()
