"""Writes a figure, completely or not at all."""

from __future__ import annotations

import io
import re
from pathlib import Path
from typing import TYPE_CHECKING

from rig.user_files import figure_format, write_file

if TYPE_CHECKING:
    from matplotlib.figure import Figure

_UNIT = re.compile(r"\[[^\]$]+\]")
_SIGNS = (
    (re.compile(r"(\w+)\^0\.5"), r"√\1"),
    (re.compile(r"\^2"), "²"),
    (re.compile(r"\^3"), "³"),
    (re.compile(r"\bu(?=(?:m|s|Pa|N|V|A|C)\b)"), "µ"),
    (re.compile(r"\*"), " "),
    (re.compile(r"(?<=\[)C(?=\])"), "°C"),
)
"""How units are printed, for what is typed on a keyboard."""
_UNDATED = {"svg": {"Date": None}, "pdf": {"CreationDate": None}}


def put(figure: Figure, path: Path | str) -> None:
    """Write `figure` to the file `path` as PNG, SVG or PDF, by its suffix.

    Raises OutputError if that fails, UsageError for another suffix.
    """
    path = Path(path)
    write_file(path, encoded(figure, figure_format(path)))


def encoded(figure: Figure, kind: str) -> bytes:
    """Return the content of a file of `kind` ("png", "svg", "pdf"): without a date, the same for the same figure.

    Units in the texts of `figure` get their printed form, as m/s² for m/s^2.
    """
    import matplotlib as mpl
    from matplotlib.text import Text

    for text in figure.findobj(Text):
        assert isinstance(text, Text)
        text.set_text(_UNIT.sub(lambda unit: printed(unit[0]), text.get_text()))

    drawn = io.BytesIO()
    with mpl.rc_context({"svg.hashsalt": "friction-rig"}):
        figure.savefig(drawn, format=kind, metadata=_UNDATED.get(kind))
    return drawn.getvalue()


def printed(unit: str) -> str:
    """Return a unit as it is printed: [N/Hz^0.5] is [N/√Hz], [um] is [µm]."""
    for typed, sign in _SIGNS:
        unit = typed.sub(sign, unit)
    return unit
