"""Makes a clean file from a recording that was cut off, and reads it back before it calls it done."""

from __future__ import annotations

import os
from dataclasses import dataclass
from pathlib import Path

from mcap.reader import make_reader
from mcap.records import Message
from mcap.writer import CompressionType
from mcap.writer import Writer as Mcap

from rig.errors import LogError
from rig.record.reader import Scan
from rig.record.writer import CHUNK


@dataclass(frozen=True)
class Recovered:
    """What could be saved."""

    path: str
    messages: int
    seconds: float
    fault: str
    """What was wrong with the original."""


def recover(source: Path, target: Path | None = None) -> Recovered:
    """Copy what is readable of `source` to `target` (default: NAME.recovered.mcap); a whole file is refused."""
    target = target or source.with_suffix(".recovered.mcap")
    made = target.with_suffix(".part")
    scan = Scan(source)
    try:
        count = _copy(scan, made)
        if scan.whole:
            raise LogError(f"{source} is whole; there is nothing to recover")
        if (found := _readable(made)) != count:
            raise LogError(f"{source}: {count} messages were copied but {found} can be read back; nothing was kept")
        os.replace(made, target)
    except OSError as fault:
        raise LogError(f"{target} cannot be written: {fault.strerror}") from None
    finally:
        made.unlink(missing_ok=True)
    return Recovered(str(target), count, scan.last_ns * 1e-9, scan.fault)


def _copy(scan: Scan, made: Path) -> int:
    count = 0
    with made.open("wb") as file:
        out = Mcap(file, chunk_size=CHUNK, compression=CompressionType.ZSTD)
        out.start(profile="friction-rig", library="friction-rig")
        schemas: dict[int, int] = {}
        channels: dict[int, int] = {}
        noted: set[str] = set()
        for message in scan.messages():
            _front(scan, out, noted)
            channel = message.channel_id
            if channel not in channels:
                known = scan.channels[channel]
                if known.schema_id not in schemas:
                    schema = scan.schemas[known.schema_id]
                    schemas[known.schema_id] = out.register_schema(schema.name, schema.encoding, schema.data)
                channels[channel] = out.register_channel(
                    known.topic, known.message_encoding, schemas[known.schema_id], known.metadata
                )
            _add(out, channels[channel], message)
            count += 1
        _front(scan, out, noted)
        out.add_metadata("recovered", {"from": scan.path.name, "fault": scan.fault})
        out.finish()  # type: ignore[no-untyped-call]
    return count


def _front(scan: Scan, out: Mcap, noted: set[str]) -> None:
    """Copy attachments and metadata as soon as they have been met: they belong before the messages."""
    for name, attached in scan.attachments.items():
        if name not in noted:
            out.add_attachment(attached.create_time, attached.log_time, name, attached.media_type, attached.data)
    for name, found in scan.metadata.items():
        if name not in noted:
            out.add_metadata(name, found)
    noted |= {*scan.attachments, *scan.metadata}


def _add(out: Mcap, channel: int, message: Message) -> None:
    out.add_message(channel, message.log_time, message.data, message.publish_time, message.sequence)


def _readable(path: Path) -> int:
    """How many messages an ordinary reader finds by the index."""
    with path.open("rb") as file:
        return sum(1 for _ in make_reader(file, validate_crcs=True).iter_messages())
