"""Files that a command writes for its user: nothing that is there is overwritten unless the user says so."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping
from contextlib import contextmanager, suppress
from pathlib import Path

from rig.errors import UsageError


@contextmanager
def reserved(outputs: Mapping[str, Path | None], force: bool) -> Iterator[None]:
    """Hold the places of files that a command is going to write, option -> path, before it computes anything.

    Each is made, empty; those that are empty at the end, because the command failed, go again. Raises UsageError, with
    all faults at once, for files that have something in them (unless `force`) and for places that cannot be written.
    """
    faults, made = [], list[Path]()
    try:
        for option, path in outputs.items():
            if path is not None and (fault := _hold(path, force, made)):
                faults.append(f"{option} {path}: {fault}")
        if faults:
            raise UsageError("\n".join(faults))
        yield
    finally:
        for path in made:
            with suppress(OSError):
                if not path.stat().st_size:
                    path.unlink()


def _hold(path: Path, force: bool, made: list[Path]) -> str:
    """Make an empty file at `path` unless there is one; why it cannot be written, or ""."""
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        path.open("xb").close()
        made.append(path)
    except FileExistsError:
        if path in made:
            return "is named twice"
        if path.is_dir():
            return "is a folder; name a file"
        if path.stat().st_size and not force:
            return "exists; name another file, or add --force to replace it"
    except OSError as fault:
        return f"cannot be written: {fault.strerror}"
    return ""


def refuse(folder: Path, names: Iterable[str], force: bool) -> None:
    """Raise UsageError if `folder` has files of these names, unless `force`."""
    there = [name for name in names if (folder / name).exists()]
    if there and not force:
        raise UsageError(f"--out {folder}: has {', '.join(there)}; name another folder, or add --force to replace them")
