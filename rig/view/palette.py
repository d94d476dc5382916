"""What all figures have in common: colours, style, the empty figure to draw on, and its file.

Colour-blind readers can distinguish the colours. Source: M. Okabe, K. Ito, Color Universal Design, 2008.
"""

from __future__ import annotations

import io
import re
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from functools import cache, wraps
from pathlib import Path
from typing import TYPE_CHECKING, Any, Concatenate, ParamSpec

from rig.machine.files import figure_format, write_file

if TYPE_CHECKING:
    from matplotlib.figure import Figure


P = ParamSpec("P")
BLUE = "#0072b2"
VERMILION = "#d55e00"
GREEN = "#009e73"
PURPLE = "#cc79a7"
AMBER = "#e69f00"
SKY = "#56b4e9"
LINES = (BLUE, VERMILION, GREEN, PURPLE, AMBER, SKY)
"""Colours of curves, in the order in which they are used."""
GREY = "#666666"
"""Guide lines, and what belongs to no curve."""
ALARM = "#9b2226"
"""Critical values, limits, faults."""
STYLE: dict[str, Any] = {
    "font.size": 10.5,
    "figure.titlesize": 13,
    "figure.titleweight": "bold",
    "axes.titlesize": 11,
    "axes.titlelocation": "left",
    "axes.labelsize": 10.5,
    "axes.spines.top": False,
    "axes.spines.right": False,
    "axes.grid": True,
    "grid.color": "#e3e3e3",
    "grid.linewidth": 0.7,
    "legend.frameon": False,
    "legend.fontsize": 9.5,
    "lines.linewidth": 1.1,
    "agg.path.chunksize": 20000,
}
"""The style of figures, for matplotlib's rc_context."""
BARE = STYLE | {"axes.grid": False, "lines.linewidth": 1.3, "agg.path.chunksize": 0}
"""The style of maps and of the figures of the papers: without a grid."""

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


@contextmanager
def page(
    width: float,
    height: float,
    title: str = "",
    *,
    style: Mapping[str, Any] = STYLE,
    lasting: bool = True,
    **options: Any,
) -> Iterator[Figure]:
    """A white figure of `width` x `height` [inches] to draw on in a `style`, which also holds whenever it is written.

    `title`: written above it. `lasting`: false for a style that only holds meanwhile. `options`: of matplotlib's
    Figure. A notebook shows the figure where it is the last value of a cell.
    """
    import matplotlib as mpl
    from matplotlib.backends.backend_agg import FigureCanvasAgg

    with mpl.rc_context(dict(style)):  # type: ignore[arg-type]
        usual = {"figsize": (width, height), "dpi": 125, "facecolor": "white"}
        figure: Any = _kind()(**usual | options)
        FigureCanvasAgg(figure)
        figure.style = style if lasting else {}
        if title:
            headline(figure, title)
        yield figure


def drawn(
    width: float, height: float, **options: Any
) -> Callable[[Callable[Concatenate[Figure, P], None]], Callable[P, Figure]]:
    """Make of a function that draws a result on a figure one that returns the figure; arguments as of `page`."""

    def of(draw: Callable[Concatenate[Figure, P], None]) -> Callable[P, Figure]:
        @wraps(draw)
        def figure_of(*result: P.args, **how: P.kwargs) -> Figure:
            with page(width, height, **options) as figure:
                draw(figure, *result, **how)
            return figure

        return figure_of

    return of


def headline(figure: Figure, text: str) -> None:
    """Write the title of a figure, at its left edge."""
    figure.suptitle(text, x=0.01, ha="left")


@cache
def _kind() -> Any:
    """The class of the figures of `page`; matplotlib is imported where something is drawn."""
    import matplotlib as mpl
    from matplotlib.figure import Figure

    class Page(Figure):
        style: Mapping[str, Any] = {}

        def draw(self, renderer: Any) -> None:
            with mpl.rc_context(dict(self.style)):  # type: ignore[arg-type] # ticks are made when they are drawn
                super().draw(renderer)

        def _repr_png_(self) -> bytes:
            return encoded(self, "png")

    return Page


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

    print_units(figure)
    drawn = io.BytesIO()
    with mpl.rc_context({"svg.hashsalt": "friction-rig"}):
        figure.savefig(drawn, format=kind, metadata=_UNDATED.get(kind))
    return drawn.getvalue()


def print_units(figure: Figure) -> None:
    """Give units in the texts of `figure` their printed form."""
    from matplotlib.text import Text

    for text in figure.findobj(Text):
        assert isinstance(text, Text)
        text.set_text(_UNIT.sub(lambda unit: printed(unit[0]), text.get_text()))


def printed(unit: str) -> str:
    """Return a unit as it is printed: [N/Hz^0.5] is [N/√Hz], [um] is [µm]."""
    for typed, sign in _SIGNS:
        unit = typed.sub(sign, unit)
    return unit
