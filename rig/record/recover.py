"""Recovery of a cut off or damaged recording: writes a whole copy and reads it back before success is reported.

Every message that checksums prove is kept. Skipped parts are reported: where, why and how much.
"""

from __future__ import annotations

import errno
from contextlib import suppress
from dataclasses import dataclass, field
from pathlib import Path
from typing import BinaryIO

from mcap.reader import make_reader

from rig.errors import LogError, OutputError, UsageError
from rig.machine.files import draft_of, regular, unused
from rig.printable import counted
from rig.record import mcap_file, mcap_writer, message_scan, reader, recorded_setup, writer


@dataclass(frozen=True)
class Recovered:
    """The result of a recovery."""

    path: str
    messages: int
    seconds: float
    """Simulated time of the last message."""
    fault: str
    """The damage of the original."""
    lost: int | None
    """Number of lost messages; None if unknown."""
    skipped: list[str] = field(default_factory=list)
    """Damaged places of the original."""

    @property
    def complete(self) -> bool:
        """Whether every message was saved."""
        return self.lost == 0

    def losses(self) -> str:
        """Return the losses in words."""
        if self.lost is None:
            return "lost: an unknown number of messages where the file is cut off or damaged"
        return (
            f"lost: {self.lost} of {counted(self.messages + self.lost, 'message')}" if self.lost else "no message lost"
        )


def recover(source: Path, target: Path | None = None, replace: bool = False) -> Recovered:
    """Copy the readable part of `source` to `target` (default: NAME.recovered.mcap).

    Raises LogError for a whole file and for a file that is not a recording, UsageError if the target is the source or
    exists and may not be `replace`d, OutputError if it cannot be written.
    """
    target = target or source.with_suffix(".recovered.mcap")
    with suppress(OSError):  # a missing or impossible path is reported by the function that opens it
        if target.samefile(source):
            raise UsageError(f"--out {target}: is the damaged file itself; name another one")
    scan = message_scan.Scan(source)
    decode, topics = _surveyed(scan)
    lacking = reader.absent(scan, topics, recorded_setup.setup_of(scan))
    if scan.whole and not decode.refused:
        raise LogError(f"{source} {_undamaged(scan, lacking)}; there is nothing to recover")
    lost = None if scan.missing is None else max(scan.missing, 0) + decode.refused.total()
    damage = "; ".join(filter(None, (scan.fault, decode.refused_text(), lacking)))
    recovered = Recovered(
        str(target),
        scan.count - decode.refused.total(),
        scan.last_ns * 1e-9,
        damage,
        lost,
        [str(skipped) for skipped in scan.skipped],
    )
    try:
        if target.exists():
            regular(target)  # otherwise the copy would replace a device or a pipe
            unused(target)
            if not replace and target.stat().st_size:
                raise OSError(errno.EEXIST, "it exists; name another file, or add --force to replace it")
    except OSError as fault:
        kind = UsageError if fault.errno == errno.EEXIST else OutputError
        raise kind(f"{target} cannot be written: {fault.strerror}") from None
    with draft_of(target) as draft:
        with draft.open("wb") as file:
            _copy(recovered, scan, file)
        if (read := _readable(draft)) != recovered.messages:
            raise LogError(f"{source}: {recovered.messages} messages were copied, {read} can be read; nothing was kept")
    return recovered


def _undamaged(scan: message_scan.Scan, lacking: str) -> str:
    """What a file without damage is: whole, as rig verify means it, or without messages that its run had."""
    if lacking:
        return f"has no damage, but is not complete: {lacking}"
    if lost := scan.metadata.get("recovered", {}).get("lost", ""):
        return f"is a copy that rig recover wrote, and has no damage of its own ({lost})"
    return "is whole" if scan.sealed else "has no digest (an older version recorded it) and shows no damage"


def _surveyed(scan: message_scan.Scan) -> tuple[reader.Decoder, set[str]]:
    """Scan the whole of `scan`; return a decoder that has counted undecodable messages, and the topics in the file."""
    for _ in scan:
        pass
    decode = reader.Decoder(recorded_setup.setup_of(scan))
    topics = set()
    for record in scan:
        topics.add(record.topic)
        decode(record.topic, record.payload)
    return decode, topics


def _copy(recovered: Recovered, scan: message_scan.Scan, file: BinaryIO) -> None:
    decode = reader.Decoder(recorded_setup.setup_of(scan))
    attachments = dict(scan.attachments)
    metadata = dict(scan.metadata)
    known = dict(scan.schemas)
    metadata["recovered"] = {"from": scan.path.name, "fault": recovered.fault, "lost": recovered.losses()}
    metadata["recording"] = {"began": str(scan.began_ns), **metadata.get("recording", {})}
    out = mcap_writer.Writer(file, writer.CHUNK, Path(file.name).parent)
    schemas: dict[int, int] = {}
    channels: dict[str, int] = {}

    def describe(copy: str) -> None:
        for name, attachment in attachments.items():
            out.attach(copy + name, attachment.media_type, attachment.data, attachment.create_time, attachment.log_time)
        for name, values in metadata.items():
            out.note(copy + name, values)

    def number(topic: str) -> int:
        if topic not in channels:
            channel = next(channel for channel in scan.channels.values() if channel.topic == topic)
            if channel.schema_id not in schemas and channel.schema_id in known:
                schema = known[channel.schema_id]
                schemas[schema.id] = out.schema(schema.name, schema.encoding, schema.data)
            described = schemas.get(channel.schema_id, 0)
            channels[topic] = out.channel(topic, channel.message_encoding, described, channel.metadata)
        return channels[topic]

    try:
        describe("")
        for topic, payload, t_ns, seq, wall_ns in scan:
            if decode(topic, payload) is not None:
                out.add(number(topic), t_ns, payload, wall_ns, seq)
        describe(mcap_file.COPY)
        out.finish()
        writer.synced(file)
    finally:
        out.discard()


def _readable(path: Path) -> int:
    """Number of messages that an ordinary reader finds by the index; 0 if our own reader finds damage."""
    scan = message_scan.Scan(path)
    for _ in scan:
        pass
    if not scan.sealed:
        return 0
    with path.open("rb") as file:
        return sum(1 for _ in make_reader(file, validate_crcs=True).iter_messages())
