"""Writes a figure, completely or not at all."""

from __future__ import annotations

import io
from pathlib import Path
from typing import TYPE_CHECKING

from rig.user_files import figure_format, write_file

if TYPE_CHECKING:
    from matplotlib.figure import Figure

_UNDATED = {"svg": {"Date": None}, "pdf": {"CreationDate": None}}


def put(figure: Figure, path: Path | str) -> None:
    """Write `figure` to the file `path` as PNG, SVG or PDF, by its suffix.

    Raises OutputError if that fails, UsageError for another suffix.
    """
    path = Path(path)
    write_file(path, encoded(figure, figure_format(path)))


def encoded(figure: Figure, kind: str) -> bytes:
    """Return the content of a file of `kind` ("png", "svg", "pdf"): without a date, the same for the same figure."""
    import matplotlib as mpl

    drawn = io.BytesIO()
    with mpl.rc_context({"svg.hashsalt": "friction-rig"}):
        figure.savefig(drawn, format=kind, metadata=_UNDATED.get(kind))
    return drawn.getvalue()
