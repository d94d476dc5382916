"""The list of the recordings in a folder, with an index so that only new and changed files are read.

A list shows some outputs of a run by their roles, as the parts of its scene declare them: `drives`, `portrait_pair`.
Nothing is known for a run whose scene is lost. Both functions raise Untrusted if the scene needs code that is not
trusted, and PartError if that code is damaged.
"""

from __future__ import annotations

import json
import os
import stat
from collections.abc import Callable, Iterator
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Literal

from pydantic import BaseModel, ConfigDict

from rig.errors import LogError, OutputError, SceneError
from rig.machine import files
from rig.model.assembly import Output, portrait
from rig.record import recorded_setup, user_notes
from rig.record.contents import SUFFIX, Contents, contents
from rig.record.run import Run
from rig.scenes.scene import Scene

INDEX = ".runs.json"


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


class _Entry(BaseModel):
    """What the index says of a file as it was then."""

    size: int
    mtime_ns: int
    contents: Contents | None
    fault: str


class _Index(BaseModel):
    """The index of a folder: its files by path."""

    model_config = ConfigDict(strict=True)

    format: Literal[2] = 2
    files: dict[str, _Entry] = {}


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
    notes: user_notes.Notes


def runs(
    folder: Path, rebuild: bool = False, progress: Callable[[int, int], object] = lambda done, total: None
) -> list[Listed]:
    """The recordings in `folder` and the folders in it, oldest first; those of which nothing is known last.

    What is read is kept in the file `INDEX` of the folder, if the folder can be written; `rebuild` reads all again.
    Raises LogError if the folder cannot be read.
    """
    listed = list[Listed]()
    paths = sorted(_recordings(folder, listed))
    known = _Index() if rebuild else _index(folder)
    index = _Index()
    for done, path in enumerate(paths):
        progress(done, len(paths))
        try:
            state = path.stat()
        except FileNotFoundError:  # it went meanwhile, or a link leads nowhere
            continue
        except OSError as fault:
            listed.append(_unreadable(path, fault))
            continue
        if not stat.S_ISREG(state.st_mode) or not state.st_size:  # an empty one waits for its run to begin
            continue
        name = path.relative_to(folder).as_posix()
        entry = known.files.get(name)
        if entry is None or (entry.size, entry.mtime_ns) != (state.st_size, state.st_mtime_ns):
            entry = _read(path, state)
        index.files[name] = entry
        listed.append(_listed(path, entry))
    if index != known:
        with suppress(OutputError):  # a folder that cannot be written gets no index: the list is the same
            files.write_file(folder / INDEX, index.model_dump_json().encode())
    return sorted(listed, key=lambda of: (of.contents is None, of.contents.began_ns if of.contents else 0, of.path))


def of_file(path: Path) -> Listed:
    """The recording `path` as it would be in a list; it is read, and no index is made. Raises LogError if it is no
    recording; one that was cut off is.
    """
    recorded_setup.setup_of(recorded_setup.head(path))
    return _listed(path, _read(path, path.stat()))


def _listed(path: Path, entry: _Entry) -> Listed:
    try:
        notes = user_notes.read(path)
    except LogError:
        notes = user_notes.Notes(user_notes.path_of(path), unreadable=1)
    return Listed(path, entry.size, entry.contents, entry.fault, notes)


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
    return Listed(path, 0, None, f"cannot be read: {fault.strerror}", user_notes.Notes(user_notes.path_of(path)))


def _read(path: Path, state: os.stat_result) -> _Entry:
    entry = _Entry(size=state.st_size, mtime_ns=state.st_mtime_ns, contents=None, fault="")
    try:
        entry.contents = contents(path)
    except LogError as fault:
        entry.contents = _begun(path)
        entry.fault = str(fault).removeprefix(f"{path} ")
    return entry


def _begun(path: Path) -> Contents | None:
    """What a recording without an index says at its begin; None if that is damaged too, or if it is no recording."""
    try:
        scan = recorded_setup.head(path)
        setup = recorded_setup.setup_of(scan)
        scene = json.loads(setup.scene)
        name = str(scene["name"])
        title = str(scene.get("title", ""))
    except (LogError, ValueError, KeyError, TypeError, AttributeError, RecursionError):
        return None
    return Contents(name, title, scan.began_ns, None, "", None, setup.run, "")


def _index(folder: Path) -> _Index:
    """The index of a folder; an empty one if it is missing, damaged or of another version."""
    try:
        return _Index.model_validate_json(files.contents(folder / INDEX, files.DATA))
    except (OSError, ValueError):
        return _Index()
