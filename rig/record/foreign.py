"""Why a file is not a recording of this project, in words that say what it is instead."""

from __future__ import annotations

from collections.abc import Iterable, Mapping

from mcap.records import Attachment, Channel, Header, Schema

from rig.record.byte_scan import Data
from rig.record.mcap_file import MAGIC, PROFILE

_OURS = {"scene.json", "setup.json"}
_SHOWN = 3


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
    if _OURS & attachments.keys() or "log" in metadata or any(one.name.startswith("rig.") for one in schemas):
        return ""
    topics = sorted(one.topic for one in channels)
    if header is not None and header.profile == PROFILE:
        return "" if topics else "it breaks off before the description of its run, and nothing of it can be read"
    if not len(data):
        return "the file is empty"
    if header is None and not topics:
        if data[: len(MAGIC)] == MAGIC:
            return "it breaks off before the description of its run, and nothing of it can be read"
        return f"it is not an MCAP file: it begins with the bytes {data[:4].hex(' ')}, not {MAGIC[:4].hex(' ')}"
    profile, library = (header.profile, header.library) if header is not None else ("", "")
    made = " and ".join(
        [
            *([f"profile {profile[:40]!r}"] if profile else ["no profile"]),
            *([f"library {library[:40]!r}"] * bool(library)),
        ]
    )
    more = ", ..." if len(topics) > _SHOWN else ""
    channel = f"; its channels: {', '.join(one[:40] for one in topics[:_SHOWN])}{more}" if topics else ""
    return f"it is an MCAP file of another program ({made}{channel}); read it with that program"
