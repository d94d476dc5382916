"""Writes a figure to its file, completely or not at all."""

from __future__ import annotations

import io
import os
from pathlib import Path
from typing import TYPE_CHECKING

from rig.errors import OutputError

if TYPE_CHECKING:
    from matplotlib.figure import Figure


def put(figure: Figure, path: Path | str) -> None:
    """Write `figure` to the file `path`, in the format of its ending; PNG without one. Raises OutputError.

    The figure is written to a temporary file first: if the disk is full, the old file stays.
    """
    path = Path(path)
    drawn = io.BytesIO()
    figure.savefig(drawn, format=path.suffix[1:] or "png")
    try:
        target = path.resolve()  # a symbolic link stays a link
        if target.exists() and not target.is_file():  # a device, such as /dev/null
            target.write_bytes(drawn.getvalue())
            return
        draft = target.with_name(f".figure-{os.getpid()}")
        try:
            draft.write_bytes(drawn.getvalue())
            if target.exists():
                draft.chmod(target.stat().st_mode)
            draft.replace(target)
        except BaseException:
            draft.unlink(missing_ok=True)
            raise
    except OSError as fault:
        raise OutputError(f"{path} cannot be written: {fault.strerror}") from None
