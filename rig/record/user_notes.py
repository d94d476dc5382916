"""Notes and tags that a user adds to a recording, in a text file beside it: run.mcap has run.notes.jsonl.

The recording stays as it is: its checksums prove what was measured, the notes are comments of users on it. Each
line of the file is one note (JSON). It contains the digest of its recording, so that a note on another file of the same
name is recognised.
"""

from __future__ import annotations

import json
from collections.abc import Sequence
from dataclasses import asdict, dataclass
from datetime import UTC, datetime
from pathlib import Path

from rig.errors import LogError, OutputError, UsageError
from rig.machine.files import contents, write_file
from rig.printable import unprintable
from rig.record import recorded_setup
from rig.record.contents import digest

LONGEST = 10_000
"""Most characters of one note."""
_MOST = 1 << 20  # bytes of a file of notes. chosen


@dataclass(frozen=True)
class Note:
    """One note on a recording."""

    date: str
    """When it was written, as ISO 8601 (UTC)."""
    text: str
    tags: tuple[str, ...] = ()
    digest: str = ""
    """SHA-256 of the recording, as the recording states it; empty if it states none."""

    def __str__(self) -> str:
        tags = " ".join(f"#{tag}" for tag in self.tags)
        return f"{self.date}  {' '.join(filter(None, (self.text, tags)))}"


@dataclass(frozen=True)
class Notes:
    """All notes on a recording."""

    path: Path
    entries: tuple[Note, ...] = ()
    other: tuple[Note, ...] = ()
    """Notes on another recording that had this name."""
    unreadable: int = 0
    """Lines of the file that contain no note."""

    @property
    def tags(self) -> tuple[str, ...]:
        """All tags, each once, in order of the notes."""
        return tuple(dict.fromkeys(tag for note in self.entries for tag in note.tags))


def path_of(log: Path) -> Path:
    """The file with the notes on a recording."""
    return log.with_suffix(".notes.jsonl")


def read(log: Path) -> Notes:
    """Read the notes on the recording `log`. Raises LogError if their file exists and cannot be read."""
    path = path_of(log)
    try:
        lines = contents(path, _MOST).splitlines()
    except FileNotFoundError:
        return Notes(path)
    except OSError as fault:
        raise LogError(f"{path} cannot be read: {fault.strerror}") from None
    notes = [_note(line) for line in lines if line.strip()]
    known = [note for note in notes if note is not None]
    present = digest(log)
    mine = tuple(note for note in known if note.digest in ("", present) or not present)
    return Notes(path, mine, tuple(note for note in known if note not in mine), len(notes) - len(known))


def add(log: Path, text: str, tags: Sequence[str] = ()) -> Note:
    """Add a note to the recording `log` and return it.

    Raises UsageError for a note without text and tags, one of more than `LONGEST` characters, one with control
    characters, and a tag that is not one word; LogError if the recording cannot be read or is another file, OutputError
    if the file of notes is full or cannot be written.
    """
    text = " ".join(text.split())
    tags = tuple(dict.fromkeys(tag.removeprefix("#") for tag in tags))
    wrong = [tag for tag in tags if not _is_tag(tag)]
    if wrong:
        raise UsageError(f"--tag {wrong[0]!r}: a tag is one word of at most 64 characters, such as squeal")
    if not text and not tags:
        raise UsageError("the note is empty: write a text, or a tag (--tag squeal)")
    if len(text) > LONGEST:
        raise UsageError(f"the note has {len(text)} characters; at most {LONGEST} are allowed")
    if wrong := unprintable(text):
        raise UsageError(f"the note contains {', '.join(map(repr, wrong))}; control characters are not allowed")
    recorded_setup.setup_of(recorded_setup.head(log))  # a note is on a recording, whole or damaged
    note = Note(datetime.now(UTC).isoformat(timespec="seconds"), text, tags, digest(log))
    path = path_of(log)
    line = json.dumps({key: value for key, value in asdict(note).items() if value}, ensure_ascii=False).encode() + b"\n"
    try:
        before = contents(path, _MOST) if path.exists() else b""
    except OSError as fault:
        raise OutputError(f"{path} cannot be written: {fault.strerror}") from None
    if len(before) + len(line) > _MOST:
        raise OutputError(f"{path} is full: with this note it would be larger than {_MOST >> 20} MiB; move it away")
    if not before.endswith(b"\n") and before:  # the last line was cut off: this note does not become a part of it
        before += b"\n"
    write_file(path, before + line)
    return note


def _note(line: bytes) -> Note | None:
    try:
        values = json.loads(line.decode(errors="replace"))
        return Note(
            str(values["date"]),
            str(values.get("text", "")),
            tuple(map(str, values.get("tags", ()))),
            str(values.get("digest", "")),
        )
    except (ValueError, KeyError, TypeError, AttributeError, RecursionError):
        return None


def _is_tag(text: str) -> bool:
    """Whether a text is one word of printable characters that is not too long."""
    if any(character.isspace() or not character.isprintable() for character in text):
        return False
    return 0 < len(text) <= 64
