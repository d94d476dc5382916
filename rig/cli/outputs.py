"""Files that a command writes for its user: nothing that is there is overwritten unless the user says --force.

What the command reads is never overwritten.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

import typer

from rig.errors import UsageError
from rig.results import Result
from rig.user_files import figure_format, recording_name, takes, unused

_TAKEN = "rig.cli.outputs"
_READ = "what is read"


def named(what: str, path: Path) -> None:
    """Raise UsageError for a name that is empty; as a path it is the same as "."."""
    if path == Path():
        raise UsageError(f"{what}: the name is empty, or it is this folder; name a file")


def new(context: typer.Context, option: typer.CallbackParam, path: Path | None) -> Path | None:
    """Hold the file that an option names while its command runs, from before the command computes anything."""
    if path is not None:
        try:
            hold(context, option.opts[0], path)
        except UsageError:
            context.close()  # what the options before it made goes again: nobody enters a context that is not complete
            raise
    return path


def new_recording(context: typer.Context, option: typer.CallbackParam, path: Path | None) -> Path | None:
    """Like `new`, for a recording."""
    new(context, option, path)
    try:
        if path is not None:
            recording_name(path)
    except UsageError as fault:
        context.close()
        raise UsageError(f"{option.opts[0]} {fault}") from None
    return path


def reads(context: typer.Context, path: Path) -> None:
    """Note that the command reads `path`. Raises UsageError where an option has named it as a file to write."""
    try:
        _claim(context, _READ, path)
    except UsageError:
        context.close()
        raise


def _claim(context: typer.Context, what: str, path: Path) -> None:
    """Note what a file is for. Raises UsageError if it is for something else too; what is written is there: it is held.

    An option may come before or after the argument that names what is read.
    """
    taken: dict[str, Path] = context.meta.setdefault(_TAKEN, {})
    for other, file in taken.items():
        if what == other or not _same(path, file):
            continue
        if _READ in (what, other):
            option, written = (other, file) if what == _READ else (what, path)
            raise UsageError(f"{option} {written}: is also the input file; name another one")
        raise UsageError(f"{what} {path}: is also the file of {other}; name another one")
    taken[what] = path


def _same(one: Path, other: Path) -> bool:
    try:
        return one.is_file() and one.samefile(other)
    except OSError:  # a name that is too long
        return False


def hold(context: typer.Context, option: str, path: Path) -> None:
    """Hold the file of an option until the command ends. Raises UsageError, as `held` does, for an input file too."""
    named(option, path)
    if option == "--figure":
        try:
            figure_format(path)
        except UsageError as fault:
            raise UsageError(f"{option} {fault}") from None
    _claim(context, option, path)
    context.with_resource(held(option, path, bool(context.params.get("force"))))


@contextmanager
def held(option: str, path: Path, force: bool) -> Iterator[None]:
    """Make an empty file at `path`; it goes again if nothing has been written to it in the end.

    Raises UsageError for a file with something in it, unless `force`, for a file that another process is writing, for
    a folder that does not exist (it may be a slip of the keyboard), and for a place that cannot be written.
    """
    made = False
    try:
        if path.is_dir():
            raise UsageError(f"{option} {path} is a folder; name a file")
        takes(path)
        if path.exists() and path.stat().st_size and not force:
            raise UsageError(f"{option} {path} exists; name another file, or add --force to replace it")
        if not path.parent.exists():
            raise UsageError(f"{option} {path}: there is no folder {path.parent}; make it, or name another one")
        with suppress(FileExistsError):
            path.open("xb").close()
            made = True
        unused(path)
    except OSError as fault:
        raise UsageError(f"{option} {path} cannot be written: {fault.strerror}") from None
    try:
        yield
    finally:
        with suppress(OSError):
            if made and not path.stat().st_size:
                path.unlink()


@contextmanager
def parents(path: Path) -> Iterator[None]:
    """Take away the folders above `path` that are not there yet, if they are there and empty in the end."""
    try:
        new = [folder for folder in path.parents if not folder.exists()]
    except OSError:  # a name that is too long: nothing can be made
        new = []
    try:
        yield
    finally:
        for folder in new:
            with suppress(OSError):  # something is in it
                folder.rmdir()


def refuse(folder: Path, names: Iterable[str], force: bool) -> None:
    """Raise UsageError if `folder` has files of these names, unless `force`."""
    there = [name for name in names if (folder / name).exists()]
    if there and not force:
        raise UsageError(f"{folder}: has {', '.join(there)}; name another folder, or add --force to replace them")


def draw(found: Result, figure: Path | None, *how: object) -> None:
    """Write the figure of a result to a file, if one is given; `how`: arguments of its `plot`."""
    if figure is not None:
        from rig.view.save_figure import put

        put(found.plot(*how), figure)
