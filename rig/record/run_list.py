"""The list of the recordings in a folder, with an index so that only new and changed files are read.

The outputs of a run by their roles, as the parts of its scene declare them: the drives, the phase portrait.

Nothing is known for a run whose scene is lost. Both functions raise Untrusted if the scene needs code that is not
trusted, and PartError if that code is damaged.
"""

from __future__ import annotations

import json
import os
import stat
from collections.abc import Callable, Iterator
from contextlib import suppress
from dataclasses import asdict, dataclass, fields
from pathlib import Path
from typing import Any

from rig.errors import LogError, SceneError
from rig.machine.files import DATA
from rig.machine.files import contents as read_file
from rig.model.assembly import Output, portrait
from rig.record import user_notes
from rig.record.contents import SUFFIX, Contents, contents
from rig.record.recorded_setup import head, setup_of
from rig.record.run import Run
from rig.record.user_notes import Notes
from rig.scenes.scene import Scene


def drives(run: Run) -> list[str]:
    """Return the outputs of `run` that are the speed of a drive, those in rad/s first."""
    names = [name for name, output in _outputs(run).items() if output.role == "drive"]
    return sorted(names, key=lambda name: run.units.get(name) != "rad/s")


def portrait_pair(run: Run) -> tuple[str, str] | None:
    """Return displacement and velocity of the phase portrait among the outputs of `run`; None without such a pair."""
    return portrait(_outputs(run))


def _outputs(run: Run) -> dict[str, Output]:
    """The declared outputs that the run holds."""
    try:
        rows = Scene.from_json(run.scene).assemble().outputs
    except SceneError:
        return {}
    return {name: output for name, output in rows.items() if name in run.signals}


INDEX = ".runs.json"
_FORMAT = 2
_KINDS: dict[str, Any] = {"str": str, "int": int, "float | None": float | None, "int | None": int | None}
"""Types of the fields of `Contents`, as it declares them."""


@dataclass(frozen=True)
class Listed:
    """A recording in a folder, or a folder in it that cannot be read."""

    path: Path
    size: int
    """bytes"""
    contents: Contents | None
    """None if it states nothing of itself; of a file with a `fault`, what stands at its begin."""
    fault: str
    """Damage; empty if there is none."""
    notes: Notes


def runs(
    folder: Path, rebuild: bool = False, progress: Callable[[int, int], object] = lambda done, total: None
) -> list[Listed]:
    """The recordings in `folder` and the folders in it, oldest first; those of which nothing is known last.

    What is read is kept in the file `INDEX` of the folder, if the folder can be written; `rebuild` reads all again.
    Raises LogError if the folder cannot be read.
    """
    listed, entries = list[Listed](), dict[str, Any]()
    paths = sorted(_recordings(folder, listed))
    known = {} if rebuild else _index(folder)
    for done, path in enumerate(paths):
        progress(done, len(paths))
        try:
            state = path.stat()
        except FileNotFoundError:  # it went meanwhile, or a link leads nowhere
            continue
        except OSError as fault:
            listed.append(_unreadable(path, fault))
            continue
        if not stat.S_ISREG(state.st_mode):
            continue
        name = path.relative_to(folder).as_posix()
        entry = known.get(name)
        if entry is None or (entry["size"], entry["mtime_ns"]) != (state.st_size, state.st_mtime_ns):
            entry = {"size": state.st_size, "mtime_ns": state.st_mtime_ns, **_read(path)}
        entries[name] = entry
        read = Contents(**entry["contents"]) if entry["contents"] else None
        listed.append(Listed(path, state.st_size, read, entry["fault"], _notes(path)))
    if entries != known:
        _keep(folder, entries)
    return sorted(listed, key=_age)


def one(path: Path) -> Listed:
    """The recording `path` as it would be in a list; it is read, and no index is made. Raises LogError if it is no
    recording; one that was cut off is.
    """
    setup_of(head(path))
    read = _read(path)
    return Listed(
        path,
        path.stat().st_size,
        Contents(**read["contents"]) if read["contents"] else None,
        read["fault"],
        _notes(path),
    )


def _recordings(folder: Path, refused: list[Listed]) -> Iterator[Path]:
    """Paths that may be recordings; folders that cannot be read are added to `refused`."""

    def refuse(fault: OSError) -> None:
        place = Path(fault.filename or folder)
        if place == folder:
            raise LogError(f"{folder} cannot be read: {fault.strerror}") from None
        if not isinstance(fault, FileNotFoundError):
            refused.append(_unreadable(place, fault))

    for place, _, names in os.walk(folder, onerror=refuse):
        yield from (Path(place, name) for name in names if name.endswith(SUFFIX))


def _unreadable(path: Path, fault: OSError) -> Listed:
    return Listed(path, 0, None, f"cannot be read: {fault.strerror}", Notes(user_notes.path_of(path)))


def _read(path: Path) -> dict[str, Any]:
    try:
        return {"contents": asdict(contents(path)), "fault": ""}
    except LogError as fault:
        begun = _begun(path)
        return {"contents": asdict(begun) if begun else None, "fault": str(fault).removeprefix(f"{path} ")}


def _begun(path: Path) -> Contents | None:
    """What a recording without an index says at its begin; None if that is damaged too, or if it is no recording."""
    try:
        scan = head(path)
        setup = setup_of(scan)
        scene = json.loads(setup.scene)
        name, title = str(scene["name"]), str(scene.get("title", ""))
    except (LogError, ValueError, KeyError, TypeError, AttributeError, RecursionError):
        return None
    return Contents(name, title, scan.began_ns, None, "", None, setup.run, "")


def _notes(path: Path) -> Notes:
    try:
        return user_notes.read(path)
    except LogError:
        return Notes(user_notes.path_of(path), unreadable=1)


def _age(recording: Listed) -> tuple[bool, int, Path]:
    return recording.contents is None, recording.contents.began_ns if recording.contents else 0, recording.path


def _index(folder: Path) -> dict[str, Any]:
    """What the index of a folder says of each file; nothing if it is missing, damaged or of another version."""
    try:
        index = json.loads(read_file(folder / INDEX, DATA))
        if index["format"] != _FORMAT:
            return {}
        return {name: entry for name, entry in index["files"].items() if _complete(entry)}
    except (OSError, ValueError, KeyError, TypeError, AttributeError, RecursionError):
        return {}


def _complete(entry: Any) -> bool:
    kinds = {field.name: _KINDS[str(field.type)] for field in fields(Contents)}
    contents = entry["contents"]
    return (
        {"size", "mtime_ns", "contents", "fault"} == entry.keys()
        and isinstance(entry["fault"], str)
        and (
            contents is None
            or (kinds.keys() == contents.keys() and all(isinstance(contents[name], kinds[name]) for name in kinds))
        )
    )


def _keep(folder: Path, entries: dict[str, Any]) -> None:
    """Write the index, completely or not at all. A folder that cannot be written gets none: the list is the same."""
    draft = folder / f"{INDEX}.{os.getpid()}"
    with suppress(OSError):
        try:
            draft.write_text(json.dumps({"format": _FORMAT, "files": entries}))
            draft.replace(folder / INDEX)
        finally:
            draft.unlink(missing_ok=True)
