"""What a recording says of itself at its begin and its end, read without its messages."""

from __future__ import annotations

import json
import os
import struct
from dataclasses import dataclass
from pathlib import Path
from typing import Any, BinaryIO

from mcap.exceptions import McapError
from mcap.reader import SeekingReader

from rig.errors import LogError
from rig.record.mcap_file import DIGEST, MAGIC, PROFILE, refuse_newer
from rig.user_files import regular

SUFFIX = ".mcap"


@dataclass(frozen=True)
class Contents:
    """A summary of one recording."""

    scene: str
    """Name of the scene; empty if the recording does not state it."""
    title: str
    began_ns: int
    """The wall clock at simulated time 0, in ns since 1970 (UTC)."""
    seconds: float | None
    """Simulated time [s], of a window its length; None if unknown: it was cut off, or an older version saved it."""
    timing: str
    """Timing verdict, "simulated" for a run that followed no clock, empty if unknown."""
    messages: int | None
    """None if unknown: it was cut off or is damaged."""
    run: str
    digest: str
    """SHA-256 of the recording, as it states it."""


def contents(path: Path) -> Contents:
    """Read a summary of a recording from its index.

    Raises LogError for a file that cannot be read, is no recording of this project, or was cut off: such a file has no
    index, and `rig.open` reads what it has. The messages are not read, and no damage to them is found.
    """
    with _opened(path) as file:
        return _contents(path, file)


def digest(path: Path) -> str:
    """Return the SHA-256 that a recording states of itself; empty if it states none, e.g. because it was cut off."""
    try:
        return contents(path).digest
    except LogError:
        if not os.path.exists(path):
            raise
        return ""


def _opened(path: Path) -> BinaryIO:
    try:
        regular(path)
        file = path.open("rb")
    except OSError as fault:
        raise LogError(f"{path} cannot be read: {fault.strerror}") from None
    try:
        if file.read(len(MAGIC)) != MAGIC:
            raise LogError(f"{path} is not an MCAP file")
    except BaseException:
        file.close()
        raise
    return file


def _contents(path: Path, file: BinaryIO) -> Contents:
    try:
        size = file.seek(0, os.SEEK_END)
        file.seek(max(0, size - len(MAGIC)))
        if size < 2 * len(MAGIC) or file.read() != MAGIC:
            raise LogError(f"{path} was cut off, or a run is writing it: it has no index yet")
        file.seek(0)
        log = SeekingReader(file, record_size_limit=size)
        profile = log.get_header().profile
        summary = log.get_summary()
        if profile != PROFILE:
            raise LogError(f"{path} is an MCAP file of another program (profile {profile!r}), not of friction-rig")
        if summary is None or summary.statistics is None:
            raise LogError(f"{path} has no index; rig recover writes one")
        noted = {one.name: one.metadata for one in log.iter_metadata()}
        scene = next((one.data for one in log.iter_attachments() if one.name == "scene.json"), b"{}")
    except (McapError, OSError, ValueError, EOFError, MemoryError, struct.error) as fault:
        raise LogError(f"{path} is cut off or damaged: {fault or type(fault).__name__}") from None
    refuse_newer(path, noted.get("log", {}))
    described = _json(scene.decode(errors="replace"), {})
    stored_summary = noted.get("summary", {})
    seconds = _json(noted.get("recording", {}).get("seconds", "null"), None)
    began = _json(noted.get("recording", {}).get("began", "null"), None)
    begin = _json(noted.get("trigger", {}).get("begin", "0"), 0.0)
    simulated = noted.get("log", {}).get("made") == "saved"
    return Contents(
        scene=str(described.get("name", "")) if isinstance(described, dict) else "",
        title=str(described.get("title", "")) if isinstance(described, dict) else "",
        began_ns=began if isinstance(began, int) else summary.statistics.message_start_time,  # as in format 1
        seconds=seconds - begin if isinstance(seconds, float) and isinstance(begin, int | float) else None,
        timing="simulated" if simulated else str(_json(stored_summary.get("verdict", '""'), "")),
        messages=summary.statistics.message_count,
        run=noted.get("log", {}).get("run", ""),
        digest=noted.get(DIGEST, {}).get("sha256", ""),
    )


def _json(text: str, otherwise: Any) -> Any:
    try:
        return json.loads(text)
    except (ValueError, RecursionError):
        return otherwise
