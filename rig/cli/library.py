"""Commands that find recordings and note what they are."""

from __future__ import annotations

from datetime import UTC, datetime
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from rig.cli import printing
from rig.cli.logs import Log
from rig.cli.options import Json
from rig.errors import UsageError
from rig.user_files import RUNS

if TYPE_CHECKING:
    from rig.record.run_list import Listed
    from rig.record.user_notes import Notes

_SHOWN = 60
"""Most characters of a note in the list."""


def runs(
    folder: Annotated[Path, typer.Argument(metavar="[FOLDER]", help="Where to look, or one recording.")] = RUNS,
    tag: Annotated[
        list[str] | None, typer.Option("--tag", metavar="TAG", help="Only runs with this tag. Repeatable.")
    ] = None,
    scene: Annotated[str | None, typer.Option(metavar="SCENE", help="Only runs of this scene.")] = None,
    rebuild: Annotated[
        bool, typer.Option("--rebuild", help="Read all files again, not only new and changed ones.")
    ] = False,
    as_json: Json = False,
) -> None:
    """List recordings: scene, date, length, timing verdict, notes and tags."""
    from rig.record import run_list

    if folder == RUNS and not folder.exists():
        printing.line(f"{folder}: no recordings yet; rig run SCENE makes one, and rig runs FOLDER looks elsewhere")
        return
    if not folder.exists():
        raise UsageError(f"{folder}: no such folder or recording")
    if folder.is_dir():
        with printing.bar("reading") as progress:
            found = run_list.runs(folder, rebuild, progress)
    else:
        found, folder = [run_list.one(folder)], folder.parent
    wanted = [one for one in found if _wanted(one, tag or [], scene)]
    for one in wanted:
        _warn(one.notes)
    if as_json:
        printing.report([_plain(one) for one in wanted])
        return
    if not wanted:
        printing.line(f"{folder}: {f'none of {len(found)} recordings fits' if found else 'no recordings'}")
        return
    columns = ("recording", "scene", "date", "length", "timing", "notes")
    printing.table(f"recordings in {folder}", columns, [_row(one, folder) for one in wanted])


def _wanted(one: Listed, tags: list[str], scene: str | None) -> bool:
    here = one.contents.scene if one.contents else ""
    return set(tags) <= set(one.notes.tags) and scene in (None, here)


def _row(one: Listed, folder: Path) -> tuple[str, ...]:
    name = str(one.path.relative_to(folder))
    notes = one.notes.found
    last = next((note.text for note in reversed(notes) if note.text), "")
    short = last if len(last) <= _SHOWN else f"{last[: _SHOWN - 1]}…"
    noted = " ".join(filter(None, (short, *(f"#{tag}" for tag in one.notes.tags))))
    said = "; ".join(filter(None, (one.fault, noted)))
    if (contents := one.contents) is None:
        return name, "", "", "", "", said
    return (
        name,
        contents.scene or "unknown",
        _date(contents.began_ns),
        f"{contents.seconds:.3f} s" if contents.seconds is not None else "unknown",
        contents.timing or "unknown",
        said,
    )


def _date(began_ns: int) -> str:
    return datetime.fromtimestamp(began_ns * 1e-9, UTC).astimezone().strftime("%Y-%m-%d %H:%M:%S")


def _plain(one: Listed) -> dict[str, Any]:
    contents = vars(one.contents) if one.contents else {}
    notes = [vars(note) for note in one.notes.found]
    return {"path": one.path, "size": one.size, **contents, "fault": one.fault, "notes": notes, "tags": one.notes.tags}


def note(
    log: Log,
    text: Annotated[
        str | None, typer.Argument(metavar="TEXT", help="What to note. Without it the notes are printed.")
    ] = None,
    tag: Annotated[list[str] | None, typer.Option("--tag", metavar="TAG", help="Add a tag. Repeatable.")] = None,
    as_json: Json = False,
) -> None:
    """Add a note or tags to a recording, or print its notes. They are kept in a file beside it."""
    from rig.record import user_notes

    if text is not None or tag:
        user_notes.add(log, text or "", tag or ())
    elif not log.exists():
        raise UsageError(f"{log}: no such file")
    found = user_notes.read(log)
    if as_json:
        printing.report({"path": found.path, "notes": [vars(one) for one in found.found],
                         "other": [vars(one) for one in found.other], "unreadable": found.unreadable})  # fmt: skip
        return
    for one in found.found:
        printing.line(str(one))
    if not found.found:
        printing.line(f"{log}: no notes")
    _warn(found)


def _warn(notes: Notes) -> None:
    """Print what a reader of notes should know about their file."""
    if other := len(notes.other):
        printing.note(f"{notes.path}: {other} of its notes are on another recording that had this name")
    if notes.unreadable:
        printing.note(f"{notes.path}: {notes.unreadable} of its lines contain no note")


COMMANDS = {
    "runs": (runs, "rig runs recordings/runs --tag squeal"),
    "note": (note, 'rig note recordings/runs/mine.mcap "new pad, second day" --tag squeal'),
}
