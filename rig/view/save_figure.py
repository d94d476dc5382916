"""Writes a figure, completely or not at all."""

from __future__ import annotations

import io
from pathlib import Path
from typing import TYPE_CHECKING

from rig.user_files import figure_format, write_file

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
