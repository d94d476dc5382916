"""Files that a command writes for its user: nothing that is there is overwritten unless the user says --force."""

from __future__ import annotations

import os
from collections.abc import Iterable, Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

import typer

from rig.errors import UsageError
from rig.files import takes

FIGURES = (".png", ".svg", ".pdf")
"""How the name of a figure may end: by it, it is drawn."""
_TAKEN = "rig.cli.outputs"


def new(context: typer.Context, option: typer.CallbackParam, path: Path | None) -> Path | None:
    """Hold the file that an option names while its command runs, from before the command computes anything."""
    if path is not None:
        try:
            _hold(context, option.opts[0], path)
        except UsageError:
            context.close()  # what the options before it made goes again: nobody enters a context that is not complete
            raise
    return path


def _hold(context: typer.Context, option: str, path: Path) -> None:
    if option == "--figure" and path.suffix.lower() not in FIGURES:
        raise UsageError(f"{option} {path}: the name of a figure ends in {', '.join(FIGURES[:-1])} or {FIGURES[-1]}")
    taken: dict[str, Path] = context.meta.setdefault(_TAKEN, {})
    for other, file in taken.items():
        if path.is_file() and path.samefile(file):  # the other one is there: it is held
            raise UsageError(f"{option} {path}: is the file of {other} too; name another one")
    context.with_resource(held(option, path, bool(context.params.get("force"))))
    taken[option] = path


@contextmanager
def held(option: str, path: Path, force: bool) -> Iterator[None]:
    """Make an empty file at `path`; it goes again if nothing has been written to it in the end.

    Raises UsageError for a file with something in it, unless `force`, and for a place that cannot be written.
    """
    made = False
    try:
        if path.is_dir():
            raise UsageError(f"{option} {path} is a folder; name a file")
        takes(path)
        if path.exists() and path.stat().st_size and not force:
            raise UsageError(f"{option} {path} exists; name another file, or add --force to replace it")
        path.parent.mkdir(parents=True, exist_ok=True)
        with suppress(FileExistsError):
            path.open("xb").close()
            made = True
        os.close(os.open(path, os.O_WRONLY))
    except OSError as fault:
        raise UsageError(f"{option} {path} cannot be written: {fault.strerror}") from None
    try:
        yield
    finally:
        with suppress(OSError):
            if made and not path.stat().st_size:
                path.unlink()


def refuse(folder: Path, names: Iterable[str], force: bool) -> None:
    """Raise UsageError if `folder` has files of these names, unless `force`."""
    there = [name for name in names if (folder / name).exists()]
    if there and not force:
        raise UsageError(f"{folder}: has {', '.join(there)}; name another folder, or add --force to replace them")
