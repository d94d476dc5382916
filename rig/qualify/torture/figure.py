"""The matrix as a picture: a row for each case, a column for each method and step, colour and reason."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

from rig.qualify.torture.cells import METHODS, Cell
from rig.view.save_figure import put

COLOURS = {"green": "#bfe0cb", "amber": "#f6dfae", "red": "#e59c90"}
NOTE = "Steps are side by side, the coarsest first. Blank: not run (it is the default, or not in the quick matrix)."
_STYLE: dict[str, Any] = {"font.size": 9.0, "axes.titlelocation": "left"}
_ROW, _COLUMN, _NAMES, _ABOVE, _BELOW = 0.24, 1.2, 2.75, 1.0, 0.55  # inches


def draw(cells: Sequence[Cell], path: Path, machine: str) -> None:
    """Draw the matrix (PNG, SVG, or as `path` ends); cases first, then the shipped scenes of the case for every
    scene.
    """
    import matplotlib as mpl
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    rows = _rows(cells)
    methods = [m for m in ("default", *METHODS) if any(m in _columns(cell) for cell in cells)]
    size = (_NAMES + _COLUMN * len(methods) + 0.2, _ROW * len(rows) + _ABOVE + _BELOW)
    with mpl.rc_context(_STYLE):  # type: ignore[arg-type]
        figure = Figure(figsize=size, dpi=125, facecolor="white")
        FigureCanvasAgg(figure)
        axes = figure.add_axes(
            (_NAMES / size[0], _BELOW / size[1], _COLUMN * len(methods) / size[0], _ROW * len(rows) / size[1])
        )
        for row, (case, _) in enumerate(rows):
            for column, method in enumerate(methods):
                own = [cell for cell in cells if cell.case == case and method in _columns(cell)]
                for at, cell in enumerate(own):
                    _box(axes, column + at / len(own), row, 1.0 / len(own), cell)
        axes.set(xlim=(0, len(methods)), ylim=(len(rows), 0))
        axes.set_yticks([row + 0.5 for row in range(len(rows))], [name for _, name in rows])
        for (case, _), label in zip(rows, axes.get_yticklabels()):
            label.set_fontweight("normal" if case else "bold")
        axes.set_xticks([column + 0.5 for column in range(len(methods))], methods)
        axes.xaxis.tick_top()
        axes.tick_params(length=0)
        for spine in axes.spines.values():
            spine.set_visible(False)
        bad = sum(not cell.good for cell in cells)
        few = "one cell of the default is" if bad == 1 else f"{bad} cells of the default are"
        counted = f"{few} not green" if bad else "the default is green everywhere"
        figure.text(0.02, 1.0 - 0.25 / size[1], f"Hard cases by methods: {counted}", fontsize=12, fontweight="bold")
        figure.text(0.02, 1.0 - 0.45 / size[1], NOTE, fontsize=8, color="0.3")
        figure.text(0.02, 0.15 / size[1], machine, fontsize=7.5, color="0.4")
        put(figure, path)


def _rows(cells: Sequence[Cell]) -> list[tuple[str, str]]:
    """Cases in order, each with the name of its row; cases of every scene follow a heading, which has no case."""
    cases = list(dict.fromkeys(cell.case for cell in cells))
    rows = [(case, case.replace("_", " ")) for case in cases if ":" not in case]
    for group in dict.fromkeys(case.split(":")[0] for case in cases if ":" in case):
        rows.append(("", group.replace("_", " ")))
        rows += [(case, case.split(":")[1].replace("_", " ")) for case in cases if case.startswith(f"{group}:")]
    return rows


def _columns(cell: Cell) -> tuple[str, ...]:
    """The columns of a cell: the default has one column."""
    return ("default",) if cell.default else (cell.method,)


def _box(axes: Any, x: float, y: int, width: float, cell: Cell) -> None:
    from matplotlib.patches import Rectangle

    colour = COLOURS[cell.result.colour]
    axes.add_patch(Rectangle((x + 0.015, y + 0.06), width - 0.03, 0.88, facecolor=colour, edgecolor="none"))
    text = cell.result.reason or (cell.method if cell.default else "")
    if text:
        narrow = width < 0.6
        axes.text(
            x + 0.5 * width,
            y + 0.52,
            text.replace(" ", "\n") if narrow else text,
            ha="center",
            va="center",
            fontsize=7.0 if width > 0.3 and not (narrow and " " in text) else 5.5,
            linespacing=0.9,
        )
