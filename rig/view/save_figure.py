"""Writes a figure, or another file that shows a run, completely or not at all."""

from __future__ import annotations

import io
import os
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING

from rig.errors import OutputError
from rig.user_files import figure_format

if TYPE_CHECKING:
    from matplotlib.figure import Figure


def put(figure: Figure, path: Path | str) -> None:
    """Write `figure` to the file `path` as PNG, SVG or PDF, by its suffix.

    Raises OutputError if that fails, UsageError for another suffix.
    """
    path = Path(path)
    drawn = io.BytesIO()
    figure.savefig(drawn, format=figure_format(path))
    write_file(path, drawn.getvalue())


def write_file(path: Path, content: bytes) -> None:
    """Write a file, completely or not at all. Raises OutputError."""
    with draft_of(path) as draft:
        draft.write_bytes(content)


@contextmanager
def draft_of(path: Path) -> Iterator[Path]:
    """A file beside `path` that takes its place if all goes well: a full disk or Ctrl-C leaves what was there.

    Raises OutputError if it cannot be written.
    """
    try:
        target = path.resolve()  # a symbolic link stays a link
        if target.exists() and not target.is_file():  # a device, such as /dev/null
            yield target
            return
        draft = target.with_name(f".draft-{os.getpid()}")  # short, whatever the length of the name
        try:
            yield draft
            if target.exists():
                draft.chmod(target.stat().st_mode)
            draft.replace(target)
        finally:
            draft.unlink(missing_ok=True)
    except OSError as fault:
        raise OutputError(f"{path} cannot be written: {fault.strerror}") from None
